# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings of one car: weaker effects, places per route, differences between them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from helpers.mismatch import moved

from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference import identifiability, likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, UNKNOWN, MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.agreement_table import agreement_text
from adk_ros.mismatch.report.effect_text import activation_text
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel

pytestmark = pytest.mark.slow(seconds=25)
EXAMINED = (
    "aero_drag", "rolling_resistance", "payload", "steering_ratio", "low_friction", "imu_bias",
    "brake_torque_gain", "rear_tyre_stiffness", "road_bank",
)  # fmt: skip
SECONDS = (60.0, 60.0, 60.0)


@pytest.fixture(autouse=True)
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part of the catalogue, for speed."""
    few = {name: EFFECTS[name] for name in EXAMINED}
    monkeypatch.setattr(likelihood, "effects_of", lambda _: few)
    monkeypatch.setattr(identifiability, "EFFECTS", few)


@cache
def drag(cda: float, noise: float = 1.0) -> GeneratedCase:
    """Two recordings of one car: `recording` and `held_out`."""
    injected = InjectedMismatch({"aero_drag": {"cda": cda}})
    return make_case("drag", injected, 5, seconds=SECONDS, noise=noise)


@cache
def surrogate() -> SurrogateModel:
    c = drag(0.9)
    return surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)[0]


def identified(*recordings: SensorLog) -> MismatchResult:
    return identify_mismatch(surrogate(), recordings)


def test_an_effect_too_weak_for_one_recording_is_found_in_two() -> None:
    weak = drag(0.22, noise=6.0)
    # Something is seen in it, and not what: a drag, or a rolling resistance.
    alone = identified(weak.recording)
    assert alone.verdict == UNKNOWN or [x.alternatives for x in alone.effects] == [["aero_drag"]]
    result = identified(weak.recording, weak.held_out)
    assert result.verdict == EXPLAINED
    (effect,) = result.effects
    assert effect.effect.name == "aero_drag"
    size = effect.parameters["cda"]
    assert size.low < 0.22 < size.high
    assert result.agreement is not None
    (row,) = result.agreement.parameters
    joint, *each = (x.high - x.low for x in (row.joint, *row.each) if x is not None)
    assert len(each) == 2
    assert joint < min(each)
    assert row.i_squared < 0.5
    assert "agree on the size of air drag" in agreement_text(result.agreement)
    # Each recording is predicted better with the size from the other one.
    for errors in result.agreement.left_out:
        assert errors.after["v_x"] < errors.before["v_x"]


def test_recordings_with_different_sizes_disagree() -> None:
    result = identified(drag(0.9).recording, replace(drag(0.4).held_out, name="second"))
    assert result.agreement is not None
    row = next(x for x in result.agreement.parameters if x.effect == "aero_drag")
    assert row.disagree
    assert row.p_value < 1e-6
    sizes = [x.value for x in row.each if x is not None]
    assert sizes == pytest.approx([0.9, 0.4], rel=0.05)
    text = agreement_text(result.agreement)
    assert "The recordings disagree on drag area" in text
    assert "in second" in text


def test_a_car_that_changed_between_two_recordings() -> None:
    clean = replace(drag(0.001).recording, name="before")
    result = identified(clean, replace(drag(0.9).held_out, name="after"))
    assert result.verdict == EXPLAINED
    (effect,) = result.effects
    assert activation_text(effect) == "from the start of after on"
    assert effect.parameters["cda"].value == pytest.approx(0.9, rel=0.05)
    assert result.agreement is not None
    first, second = result.agreement.parameters[0].each
    assert first is None
    assert second is not None
    # The effect does not act in the first recording, so no prediction of it is changed by it.
    unchanged = result.agreement.left_out[0]
    assert unchanged.after["v_x"] < 1.1 * unchanged.before["v_x"]


def test_places_on_two_routes() -> None:
    injected = InjectedMismatch({"road_bank": {"bank": 0.1}})
    c = make_case("bank", injected, 5, seconds=(60.0, 110.0, 110.0))
    model, _ = surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)
    second = replace(moved(c.held_out), name="second")
    result = identify_mismatch(model, [c.recording, second])
    (effect,) = result.effects
    assert effect.effect.name == "road_bank"
    assert effect.parameters["bank"].value == pytest.approx(0.1, rel=0.1)
    assert result.agreement is not None
    assert [span.route for span in result.agreement.recordings] == [0, 1]
    text = activation_text(effect)
    assert "of the route of recording" in text
    assert "of the route of second" in text
    assert result.corrected_yaml.count("effect: road_bank") == 2
    assert result.after["yaw_rate"] < 0.6 * result.before["yaw_rate"]
