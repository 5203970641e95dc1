# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What comparisons of similar effects say in later passes, and what a selection makes of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pytest
from helpers.numerical_fleets import with_same_derivatives

from adk_ros.fleet.inference import effect_comparisons
from adk_ros.fleet.inference.effect_comparisons import EffectComparisons
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.exchange import plainer_levels
from adk_ros.fleet.inference.fleet_candidates import Identity
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CONDITION, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

DRAG, TYRE, FRICTION = "aero_drag.cda", "front_tyre_stiffness.scale", "low_friction.mu_scale"
DELAY, LAG = "steering_delay.delay", "steering_lag.tau"
OLD, NEW = (Level(CONDITION, tag="software", value=v) for v in ("2.0", "2.1"))
EVERYWHERE = Level(SHARED)


def fleet_with(*keys: str, size: float = 6.0) -> FleetEvidence:
    injected = tuple(Injection(key, EVERYWHERE, size) for key in keys)
    plan = FleetPlan(effects=7, bias=0.0, deviation=0.3, injections=injected)
    return draw_fleet(4, plan)


def about(fleet: FleetEvidence, key: str, level: Level = EVERYWHERE) -> Identity:
    return fleet.columns.effects.index(key), level


def everywhere(fleet: FleetEvidence, key: str) -> Candidate:
    return Candidate(about(fleet, key)[0], EVERYWHERE, np.ones(len(fleet.names)))


def claimed(selection: Selection, model: FleetModel) -> set[str]:
    return {selection.fleet.columns.effects[c.effect] for c in model.claimed}


@pytest.mark.parametrize(
    ("injected", "is_claimed"), [((DRAG,), False), ((DRAG, TYRE), True), ((TYRE,), False)]
)
def test_what_is_worse_is_claimed_next_to_what_is_better(
    injected: tuple[str, ...], is_claimed: bool
) -> None:
    fleet = fleet_with(*injected)
    worse_drag = {about(fleet, DRAG): about(fleet, TYRE)}
    selection = Selection(fleet, beside=worse_drag)
    assert (DRAG in claimed(selection, selection.select())) is is_claimed
    # It is about one level: of a software it says nothing.
    assert selection.is_allowed(FleetModel((), {}), about(fleet, DRAG, NEW))


def test_what_is_worse_goes_with_what_is_better() -> None:
    fleet = fleet_with(DRAG, TYRE, FRICTION)
    selection = Selection(fleet, beside={about(fleet, DRAG): about(fleet, TYRE)})
    worse, better, other = (everywhere(fleet, key) for key in (DRAG, TYRE, FRICTION))
    model = selection.refitted(FleetModel((worse, better, other), {}))
    assert claimed(selection, selection.without(model, better)) == {FRICTION}
    assert claimed(selection, selection.without(model, worse)) == {TYRE, FRICTION}


def test_what_is_worse_goes_first() -> None:
    """Next to it the better one may look needless, as a delay does next to a lag."""
    fleet = fleet_with(TYRE)
    # Both have the derivatives of the tyre.
    first = fleet.columns.first_effect
    worse, better = (first + about(fleet, key)[0] for key in (TYRE, DRAG))
    fleet = with_same_derivatives(fleet, better, worse)
    selection = Selection(fleet, beside={about(fleet, TYRE): about(fleet, DRAG)})
    claims = everywhere(fleet, DRAG), everywhere(fleet, TYRE)
    model, dropped = selection.without_insignificant(selection.refitted(FleetModel(claims, {})))
    assert claimed(selection, model) == {DRAG}
    assert dropped == [claims[1]]


def test_a_level_is_not_exchanged_for_one_of_a_worse_effect() -> None:
    """40 ms in all cars and 28 with a software are not 68 in all and 28 less with the other."""
    injected = (Injection(TYRE, EVERYWHERE, 9.0), Injection(TYRE, OLD, -6.0))
    fleet = draw_fleet(
        5, FleetPlan(effects=8, bias=0.0, deviation=0.3, value_share=0.5, injections=injected)
    )
    claims = tuple(
        Candidate(about(fleet, TYRE)[0], level, level.design(fleet)) for level in (EVERYWHERE, OLD)
    )
    for beside, level in (
        ({}, NEW),
        ({about(fleet, TYRE, NEW): about(fleet, DRAG, NEW)}, OLD),
    ):
        selection = Selection(fleet, beside=beside)
        plain = plainer_levels(selection, selection.refitted(FleetModel(claims, {})))
        assert level in {c.level for c in plain.claimed}


class Comparison:
    """Says each time which of two effects is worse, and keeps what it was not to compare."""

    def __init__(self, worse: Mapping[Identity, Identity]) -> None:
        self.worse = dict(worse)
        self.kept: list[set[Identity]] = []

    def __call__(
        self, estimate: FleetEstimate, rows: object, of: object, kept: Collection[Identity]
    ) -> tuple[FleetEstimate, dict[Identity, Identity]]:
        self.kept.append(set(kept))
        return estimate, self.worse


def comparisons_with(
    monkeypatch: pytest.MonkeyPatch, worse: Mapping[Identity, Identity]
) -> tuple[EffectComparisons, Comparison]:
    comparison = Comparison(worse)
    monkeypatch.setattr(effect_comparisons, "exchanged_for_competing", comparison)
    return EffectComparisons(), comparison


def no_evidence(*_: object) -> tuple[list[Row], dict[str, str]]:
    return [], {}


def estimate_with(fleet: FleetEvidence, *claims: tuple[str, Level]) -> FleetEstimate:
    selection = Selection(fleet)
    candidates = tuple(
        Candidate(about(fleet, key)[0], level, level.design(fleet)) for key, level in claims
    )
    model = selection.refitted(FleetModel(candidates, {}))
    return FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), {}, {})


@pytest.fixture(scope="module")
def delayed() -> FleetEvidence:
    return draw_fleet(4, FleetPlan(effects=41, bias=0.0, deviation=0.3, value_share=0.5))


def test_far_from_the_estimate_nothing_is_settled(
    delayed: FleetEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    worse = {about(delayed, LAG): about(delayed, DELAY)}
    comparisons, comparison = comparisons_with(monkeypatch, worse)
    estimate = estimate_with(delayed, (DELAY, EVERYWHERE))
    comparisons.exchanged(estimate, {}, no_evidence, is_near=False)
    assert comparisons.beside == {}
    comparisons.exchanged(estimate, {}, no_evidence, is_near=True)
    assert comparisons.beside == worse
    assert comparison.kept == [set(), set()]


def test_a_comparison_is_repeated_when_similar_claims_have_changed(
    delayed: FleetEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    comparisons, comparison = comparisons_with(monkeypatch, {})
    delay, drag, lag = ((DELAY, NEW), (DRAG, EVERYWHERE), (LAG, EVERYWHERE))
    for claims in ((delay,), (delay,), (delay, drag), (delay, lag)):
        estimate = estimate_with(delayed, *claims)
        comparisons.exchanged(estimate, {}, no_evidence, is_near=True)
    known = about(delayed, DELAY, NEW)
    assert comparison.kept == [set(), {known}, {known}, set()]


def test_of_a_condition_the_other_values_are_settled_as_well(
    delayed: FleetEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    delay = about(delayed, DELAY, NEW)
    comparisons, _ = comparisons_with(monkeypatch, {about(delayed, LAG, NEW): delay})
    comparisons.exchanged(estimate_with(delayed, (DELAY, NEW)), {}, no_evidence, is_near=True)
    assert comparisons.beside == {about(delayed, LAG, level): delay for level in (OLD, NEW)}


def test_the_last_comparison_counts(
    delayed: FleetEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what was worse than a loser is worse than its winner."""
    delay, lag, clock = (about(delayed, key) for key in (DELAY, LAG, "clock_offset.offset"))
    comparisons, comparison = comparisons_with(monkeypatch, {clock: delay, lag: delay})
    comparisons.exchanged(
        estimate_with(delayed, (DELAY, EVERYWHERE)), {}, no_evidence, is_near=True
    )
    assert comparisons.beside == {clock: delay, lag: delay}
    comparison.worse = {delay: lag}
    comparisons.exchanged(
        estimate_with(delayed, (DELAY, EVERYWHERE), (DRAG, EVERYWHERE)),
        {},
        no_evidence,
        is_near=True,
    )
    assert comparisons.beside == {delay: lag, clock: lag}
