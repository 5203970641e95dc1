# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions of sensors on a 1:10 car: what is material there is a tenth of a full-size car's."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from helpers.calibration import (
    VEHICLE,
    WHEELBASE,
    Fault,
    at_rear_axle,
    checked,
    displaced,
    driven,
    existing,
)

import adk_ros.calibration.check as check_module
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.similarity import REFERENCE_WHEELBASE, UNIT_EXPONENTS, length_scale
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions

WHEELBASE_M = 0.3
RATIO = WHEELBASE_M / WHEELBASE
ROOT = math.sqrt(RATIO)
FACTORS = {
    "v_x": ROOT, "v_y": ROOT, "yaw_rate": 1.0 / ROOT, "x": RATIO, "y": RATIO,
    "w_x": 1.0 / ROOT, "w_y": 1.0 / ROOT, "w_z": 1.0 / ROOT,
    "torque": RATIO ** UNIT_EXPONENTS["N m"],
}  # fmt: skip
SMALL = Dimensions(
    mass=VEHICLE.mass * RATIO**3,
    yaw_inertia=VEHICLE.yaw_inertia * RATIO**5,
    cg_to_front_axle=VEHICLE.cg_to_front_axle * RATIO,
    cg_to_rear_axle=VEHICLE.cg_to_rear_axle * RATIO,
    track_width=VEHICLE.track_width * RATIO,
    cg_height=VEHICLE.cg_height * RATIO,
    wheel_radius=VEHICLE.wheel_radius * RATIO,
)


@pytest.fixture(autouse=True)
def no_road(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out grade and bank, which take most of the time."""
    monkeypatch.setattr(check_module, "check_road", lambda *_: ([], None))


def small(streams: Streams) -> Streams:
    """Return a drive of a dynamically similar 1:10 car."""

    def scaled(stream: Stream) -> Stream:
        columns = {name: x * FACTORS.get(name, 1.0) for name, x in stream.columns.items()}
        return Stream(stream.name, stream.at_s * ROOT, columns)

    return replace(
        streams,
        seconds=streams.seconds * ROOT,
        imu=scaled(existing(streams, "imu")),
        odometry=scaled(existing(streams, "odometry")),
        command=scaled(existing(streams, "command")),
    )


def findings(fault: Fault | None) -> dict[str, Finding]:
    streams = driven()
    result = checked(small(streams if fault is None else fault(streams)), SMALL)
    return {x.name: x for x in result.findings}


def test_the_car_is_a_scale_model() -> None:
    assert length_scale(WHEELBASE_M) == pytest.approx(WHEELBASE_M / REFERENCE_WHEELBASE)


def test_sensors_in_place_are_no_finding() -> None:
    found = findings(None)
    assert [x.text for x in found.values() if x.verdict is Verdict.FINDING] == []
    for name in ("imu_position", "reference_point", "acceleration_scale"):
        assert found[name].verdict is Verdict.OK, found[name].text


@pytest.mark.parametrize("ahead", [-1.0, 1.5])
def test_a_lever_arm_of_centimetres_is_found(ahead: float) -> None:
    found = findings(displaced(ahead, 0.8))["imu_position"]
    assert found.verdict is Verdict.FINDING
    assert found.value == pytest.approx(ahead * RATIO, abs=0.03)
    assert found.parameters["imu_position"] == pytest.approx(
        [ahead * RATIO, 0.8 * RATIO], abs=0.03
    )


def test_the_twist_of_the_rear_axle_is_found() -> None:
    found = findings(at_rear_axle)["reference_point"]
    assert found.verdict is Verdict.FINDING
    assert found.parameters["reference_point"][0] == pytest.approx(SMALL.cg_to_rear_axle, abs=0.02)
