# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Questions for effects: those that act, those that only mimic one, those that are absent."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.mismatch_drive import driven, likelihood_of, questioned

from adk_ros.mismatch.inference.fit_budget import FINAL
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.question import answer
from adk_ros.mismatch.inference.required_size import Reach, more_driving, sufficient_loss
from adk_ros.mismatch.inference.selection_path import SelectionPath, min_required_gain
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import MIN_FIRST_GAIN

DRAG = 1.6
"""m², of the recorded car: 1 m² more than simulated."""


def test_an_effect_that_acts_is_claimed_with_its_gain() -> None:
    answered = answer("aero_drag", questioned(driven(drag_area=DRAG), "aero_drag"))
    assert answered.claimed
    assert answered.next_to == ()
    assert answered.added is None
    assert answered.decisive is not None
    interval = answered.decisive.parameters["cda"]
    assert interval.low < 1.0 < interval.high
    assert answered.decisive.suffices
    detectable = answered.decisive.detectable["cda"]
    assert detectable is not None
    assert 0.0 < detectable < 0.5


def test_an_effect_that_mimics_the_identified_one_is_not_claimed() -> None:
    answered = answer("rolling_resistance", questioned(driven(drag_area=DRAG), "aero_drag"))
    assert not answered.claimed
    assert answered.next_to == ("aero_drag",)
    assert answered.alone is not None
    assert answered.alone.gain > answered.alone.required
    assert answered.added is not None
    assert answered.added.gain < answered.added.required
    assert "aero_drag explains the same data better" in answered.reason
    assert answered.distinguishing is not None
    assert {answered.distinguishing.of, answered.distinguishing.other} == {
        "aero_drag",
        "rolling_resistance",
    }


def test_an_absent_effect_has_an_interval_around_zero_and_a_manoeuvre() -> None:
    answered = answer("steering_lag", questioned(driven()))
    assert answered.decisive is answered.alone
    assert answered.alone is not None
    assert not answered.alone.is_significant
    assert not answered.alone.suffices
    assert answered.alone.more_driving is None or answered.alone.more_driving > 1.0
    assert answered.distinguishing is not None
    assert answered.distinguishing.other == answered.distinguishing.of == "steering_lag"
    assert (
        "steer" in answered.distinguishing.manoeuvre
        or "slalom" in answered.distinguishing.manoeuvre
    )


def test_effects_that_the_recording_cannot_show_are_not_fitted() -> None:
    about = questioned(driven())
    assert answer("road_bank", about).reason.startswith("it acts at places only")
    hidden = replace(about.likelihood, unobservable=frozenset({"imu_delay"}))
    answered = answer("imu_delay", replace(about, likelihood=hidden))
    assert answered.reason == "the channels of this recording do not show it"
    assert answered.decisive is None


def test_an_effect_of_the_detectable_size_is_found() -> None:
    size = answer("aero_drag", questioned(driven())).decisive
    assert size is not None
    least = size.detectable["cda"]
    assert least is not None
    for factor, found in ((2.0, True), (0.4, False)):
        log = driven(drag_area=0.6 + factor * abs(least))
        answered = answer("aero_drag", questioned(log)).decisive
        assert answered is not None
        assert answered.suffices == found


def test_required_loss_solves_the_selection_rule() -> None:
    path = SelectionPath([], [], 1000.0)
    active = ActiveEffect(EFFECTS["aero_drag"], (0.9,))
    h = Hypothesis((active,), questioned(driven()).decision.hypothesis.nuisances, 1400.0)

    def without(removed: float) -> Hypothesis:
        return replace(h, effects=(), loss=h.loss + removed)

    loss = sufficient_loss(h, path, 8.0)
    assert loss - 8.0 > min_required_gain(without(loss), path)
    lower = 0.95 * loss
    assert lower - 8.0 <= min_required_gain(without(lower), path)


def test_more_driving_helps_where_the_fixed_part_of_the_required_gain_decides() -> None:
    path = SelectionPath([], [], 1000.0)
    before = Hypothesis((), questioned(driven()).decision.hypothesis.nuisances, 1000.0)
    penalty = 8.0
    removed = (MIN_FIRST_GAIN + penalty) / 1.3
    factor = more_driving(EFFECTS["aero_drag"], before, path, removed, penalty, 2.0)
    assert factor == pytest.approx(1.3, rel=0.05)
    # An effect that is not significant needs the square of what is missing.
    needed = more_driving(EFFECTS["aero_drag"], before, path, removed, penalty, 0.5)
    assert needed == pytest.approx(4.0, rel=0.05)
    unexplained = replace(before, loss=2000.0)
    assert more_driving(EFFECTS["aero_drag"], unexplained, path, removed, penalty, 2.0) is None


def test_a_parameter_at_its_bound_has_no_detectable_size() -> None:
    active = ActiveEffect(EFFECTS["aero_drag"], (0.0,))
    assert Reach([0.0], [0.0], [4.0]).detectable(active, 50.0) == {"cda": None}
    assert Reach([0.01], [0.02], [4.0]).detectable(active, 100.0)["cda"] == pytest.approx(0.1)
    assert Reach([0.01], [0.1], [4.0]).detectable(active, 100.0)["cda"] == pytest.approx(0.4)


def test_the_reach_of_a_fit_has_one_entry_per_parameter() -> None:
    likelihood = likelihood_of(driven())
    active = ActiveEffect(EFFECTS["imu_tilt"], (0.001, 0.001))
    h = likelihood.fit([active], budget=FINAL, fit_activation=True)
    reach = Reach.of(likelihood, h, 100)
    assert len(reach.curvature) == len(reach.deviation) == len(reach.critical) == 2
    assert reach.significance(h.effects[0]) >= 0.0
