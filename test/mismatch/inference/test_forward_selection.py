# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which hypotheses the forward selection keeps, and in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from adk_ros.mismatch.inference import forward_selection
from adk_ros.mismatch.inference.effect_screening import EffectScreening
from adk_ros.mismatch.inference.formula_choice import best_within_bounds
from adk_ros.mismatch.inference.forward_selection import _of_one_cause, refit_competitive
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import act_apart
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    is_improvement,
    min_required_gain,
)
from adk_ros.mismatch.library.catalogue import COMMON_CAUSES, EFFECTS
from adk_ros.mismatch.library.criteria import (
    MIN_FIRST_GAIN,
    MIN_GAIN_PER_EXCESS,
    PENALTY_PER_PARAMETER,
)
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.search_limits import MAX_REFITS
from adk_ros.numerics.arrays import FloatArray

EXPECTED_LOSS = 20_000.0
"""Of so many residuals: its standard deviation is 200."""


class Fitted(Likelihood):
    """Without any data: fits return what they start from."""

    def __init__(self) -> None:
        """Nothing is measured."""

    def fit(self, effects: Sequence[ActiveEffect], nuisances, **_):  # type: ignore[override]
        return next(h for h in self.known if h.effects == tuple(effects))

    known: Sequence[Hypothesis] = ()


def path() -> SelectionPath:
    return SelectionPath(expected_loss=EXPECTED_LOSS, null_excess_loss=100.0, examined=1000)


def single(name: str, loss: float, thresholds: float = 3.0) -> Hypothesis:
    """An effect of so many materiality thresholds."""
    effect = EFFECTS[name]
    theta = tuple(
        p.theta_neutral + thresholds * p.materiality_threshold for p in effect.parameters
    )
    return Hypothesis((ActiveEffect(effect, theta),), np.zeros(0), loss)


def kept(monkeypatch: pytest.MonkeyPatch, level: list[Hypothesis], *accidents: str) -> list[str]:
    """Names of what is left of a level; `accidents` are within chance."""
    likelihood = Fitted()
    likelihood.known = level
    monkeypatch.setattr(
        forward_selection,
        "significant_effects",
        lambda _, h, examined: [a for a in h.effects if a.effect.name not in accidents],
    )
    selected = path()
    selected.levels = [[Hypothesis((), np.zeros(0), 300.0)]]
    return [h.names[0] for h in refit_competitive(likelihood, level, selected)]


def test_effects_below_materiality_do_not_crowd_out_a_material_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Delays of a millisecond gain the most, and are no mismatch."""
    small = ["clock_offset", "imu_delay", "drive_torque_delay", "drive_torque_lag", "steering_lag",
             "steering_delay"]  # fmt: skip
    assert len(small) == MAX_REFITS
    level = [single(name, 100.0 + i, 0.1) for i, name in enumerate(small)]
    assert kept(monkeypatch, [*level, single("cg_shift", 200.0)]) == ["cg_shift"]


def test_an_accident_of_a_few_blocks_comes_after_what_is_significant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    level = [single("rotating_inertia", 100.0), single("cg_shift", 150.0)]
    assert kept(monkeypatch, level) == ["rotating_inertia", "cg_shift"]
    found = kept(monkeypatch, level, "rotating_inertia")
    assert found == ["cg_shift", "rotating_inertia"]
    # Nor does a significant one that gains too little come before one that gains enough.
    too_little = MIN_FIRST_GAIN + PENALTY_PER_PARAMETER - 1.0
    weak = [single("rotating_inertia", 100.0), single("cg_shift", 300.0 - too_little)]
    assert kept(monkeypatch, weak, "rotating_inertia") == ["rotating_inertia", "cg_shift"]


def test_a_pair_gains_over_each_of_its_effects() -> None:
    """Not only over the accepted single effect, which may leave more than one of the pair."""
    first, other = single("cg_shift", 20_150.0), single("rotating_inertia", 20_100.0)
    payload = single("payload", 20_090.0)
    selected = path()
    selected.levels = [[Hypothesis((), np.zeros(0), 20_300.0)], [first, other]]
    both = Hypothesis((*other.effects, *payload.effects), np.zeros(0), 20_080.0)
    assert is_improvement(both, first, selected)
    assert not selected.accepts(both, first)
    assert selected.accepts(replace(both, loss=20_000.0), first)


@pytest.mark.parametrize(
    ("excess", "required"),
    [
        (0.0, MIN_FIRST_GAIN),
        (320.0, MIN_FIRST_GAIN),
        (1329.0, 1000.0 * MIN_GAIN_PER_EXCESS),
    ],
)
def test_what_chance_leaves_unexplained_requires_nothing(excess: float, required: float) -> None:
    """One in twenty perfect models has an excess loss of 1.645 standard deviations, 329."""
    null = Hypothesis((), np.zeros(0), EXPECTED_LOSS + excess)
    assert min_required_gain(null, path()) == pytest.approx(required, rel=1e-3)


def test_chance_includes_the_estimate_of_the_noise() -> None:
    """With as much variance again, sqrt(2) times as much is within chance: 465."""
    null = Hypothesis((), np.zeros(0), EXPECTED_LOSS + 1465.0)
    uncertain = replace(path(), noise_loss_variance=2.0 * EXPECTED_LOSS)
    required = min_required_gain(null, uncertain)
    assert required == pytest.approx(1000.0 * MIN_GAIN_PER_EXCESS, rel=1e-3)


def test_a_further_effect_at_its_bound_does_not_speak_against_the_first() -> None:
    first = single("low_friction", 20_200.0, -3.0)
    bound = EFFECTS["crosswind"].parameters[0].bounds()[1]
    further = ActiveEffect(EFFECTS["crosswind"], (bound,))
    both = Hypothesis((*first.effects, further), np.zeros(0), 19_000.0)
    selected = path()
    selected.levels = [[Hypothesis((), np.zeros(0), 40_000.0)], [first], [both]]
    assert selected.best() is both
    assert best_within_bounds(selected) is first
    # A single one stays, and is described otherwise.
    alone = Hypothesis((further,), np.zeros(0), 19_000.0)
    selected.levels = [[Hypothesis((), np.zeros(0), 40_000.0)], [alone]]
    assert best_within_bounds(selected) is alone


def test_effects_of_one_cause_are_fitted_together() -> None:
    """The tyres of both axles: what one does to the yaw rate the other undoes."""
    null = Hypothesis((), np.zeros(0), 30_000.0)
    asked: list[tuple[str, ...]] = []
    hidden: set[str] = set()

    class Asked(Fitted):
        effects = EFFECTS
        unobservable = hidden  # type: ignore[assignment]

        def fit(self, effects, nuisances, **_):  # type: ignore[override]
            asked.append(tuple(active.effect.name for active in effects))
            return null

    class Linear(LinearisedProblem):
        def __init__(self, gain: float) -> None:
            """Nothing is linearised."""
            self.likelihood, self.hypothesis, self.gain = Asked(), null, gain

        def column(self, active: ActiveEffect) -> FloatArray:
            return np.zeros(1)

        def solve(self, columns: FloatArray) -> tuple[FloatArray, float]:
            return np.zeros(columns.shape[1]), self.gain

    nothing = np.zeros((0, 0))
    assert len(_of_one_cause(Linear(100.0), nothing)) == len(COMMON_CAUSES)
    assert asked == list(COMMON_CAUSES)
    # Not where they cannot gain enough, nor where one of them shows in no recorded channel.
    assert _of_one_cause(Linear(5.0), nothing) == []
    hidden.add("rear_tyre_stiffness")
    assert _of_one_cause(Linear(100.0), nothing) == []


@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        ("cg_shift", "rotating_inertia", True),
        ("aero_drag", "yaw_inertia", True),
        ("cg_shift", "yaw_inertia", False),
        ("payload", "aero_drag", False),
        ("payload", "cg_shift", False),
        ("road_grade", "imu_tilt", False),
        ("steering_delay", "clock_offset", False),
    ],
)
def test_only_effects_of_one_direction_compete(one: str, other: str, apart: bool) -> None:
    effects: list[Effect] = [EFFECTS[one], EFFECTS[other]]
    assert act_apart(*effects) is apart
    assert act_apart(*reversed(effects)) is apart


def test_what_acts_in_another_direction_is_compared_there() -> None:
    """A crosswind gains a fortieth of the drag, and more than it must beside a torque lag."""

    def candidate(name: str, gain: float) -> Candidate:
        return Candidate(single(name, 0.0).effects[0], gain)

    drag, wind, payload = (
        candidate(name, gain)
        for name, gain in (("aero_drag", 20_000.0), ("crosswind", 500.0), ("payload", 510.0))
    )
    screening = EffectScreening(always=[drag, wind, payload])
    arguments = (30.0, 0.3, 6)
    assert screening.leading(screening.always, [1], *arguments) == [drag.active, wind.active]
    # With no direction free, all are compared with the best.
    assert screening.leading(screening.always, [], *arguments) == [drag.active]
    weak = candidate("rear_wheel_steer", 100.0)
    screening.always.append(weak)
    assert weak.active not in screening.leading(screening.always, [1], *arguments)
