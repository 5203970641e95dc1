# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wheel radius by the topics of single wheels and axles, as `adk import` writes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.auxiliary_bags import drive_with_wheels, with_auxiliary_topics
from helpers.calibration import VEHICLE, existing

from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.check import CheckResult, check
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.from_bag import BagContent, read_streams
from adk_ros.calibration.grid import on_grid
from adk_ros.calibration.streams import Stream
from adk_ros.calibration.wheel_radius import check_joints, check_wheels

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
RADIUS = VEHICLE.wheel_radius


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> BagContent:
    """A minute in town; the topics of the four wheels in place of joints."""
    path = tmp_path_factory.mktemp("wheels") / "bag"
    return read_streams(with_auxiliary_topics(drive_with_wheels(), path), RecordingOptions())


def with_factors(content: BagContent, **factors: float) -> BagContent:
    """Return the content with other wheel speeds."""
    wheels = dict(content.streams.wheel_speeds)
    for at, factor in factors.items():
        wheels[at] = wheels[at].having(velocity=factor * wheels[at]["velocity"])
    return replace(content, streams=replace(content.streams, wheel_speeds=wheels))


def radii(result: CheckResult) -> dict[str, Finding]:
    found = [x for x in result.findings if x.name.startswith("wheel_radius")]
    return {x.name.removeprefix("wheel_radius_"): x for x in found}


def test_the_topics_of_single_wheels_are_read(recorded: BagContent) -> None:
    wheels = recorded.streams.wheel_speeds
    assert tuple(wheels) == WHEELS
    assert not recorded.streams.wheels
    v_x = existing(recorded.streams, "odometry")
    left, right = wheels["rear_left"], wheels["rear_right"]
    mean = 0.5 * (left["velocity"] + np.interp(left.at_s, right.at_s, right["velocity"]))
    error = RADIUS * mean - np.interp(left.at_s, v_x.at_s, v_x["v_x"])
    assert float(np.sqrt(np.mean(error**2))) < 0.2


def test_wheels_of_the_nominal_radius_are_ok(recorded: BagContent) -> None:
    result = check(recorded, VEHICLE)
    found = radii(result)
    assert {at: x.verdict for at, x in found.items()} == dict.fromkeys(WHEELS, Verdict.OK)
    assert not result.of(Verdict.FINDING)


@pytest.mark.parametrize("command_type", ["joint_state", "ackermann", ""])
def test_other_tyres_give_one_radius_whatever_the_command(
    recorded: BagContent, command_type: str
) -> None:
    smaller = replace(
        with_factors(recorded, **dict.fromkeys(WHEELS, 1.0 / 0.95)), command_type=command_type
    )
    if not command_type:
        smaller = replace(smaller, streams=replace(smaller.streams, command=None))
    result = check(smaller, VEHICLE)
    for at, finding in radii(result).items():
        assert finding.verdict is Verdict.FINDING, at
        assert finding.value == pytest.approx(0.95, abs=0.006)
    assert result.parameters["wheel_radius"] == pytest.approx(0.95 * RADIUS, rel=0.006)


def test_a_single_worn_tyre_is_named_and_proposes_nothing(recorded: BagContent) -> None:
    result = check(with_factors(recorded, rear_right=1.0 / 0.95), VEHICLE)
    (finding,) = result.of(Verdict.FINDING)
    assert finding.name == "wheel_radius_rear_right"
    assert "rear right wheel" in finding.text
    assert "pressures" in finding.remedy
    assert result.parameters == {}


def test_without_a_vehicle_the_radius_is_said_and_not_judged(recorded: BagContent) -> None:
    found = radii(check(recorded))
    assert {x.verdict for x in found.values()} == {Verdict.NOT_DECIDABLE}
    assert "0.32" in found["rear_left"].text
    assert "--vehicle" in found["rear_left"].text


def test_a_bend_to_one_side_is_no_other_radius(recorded: BagContent) -> None:
    """Wheels on a circle of 20 m: the outer ones run 4 % ahead of v_x, the front ones in delta."""
    odometry = existing(recorded.streams, "odometry")
    at = odometry.at_s
    random = np.random.default_rng(0)
    curvature = 0.05 * (1.0 + 0.3 * np.sin(0.3 * at))
    v_x = 8.0 + 3.0 * np.sin(0.2 * at)
    yaw_rate = curvature * v_x
    delta = np.arctan(2.8 * curvature)
    wheels = {}
    for i, position in enumerate(WHEELS):
        side = -1.0 if i % 2 == 0 else 1.0
        ahead = v_x + side * 0.8 * yaw_rate
        rolling = ahead / np.cos(delta) if position.startswith("front") else ahead
        noise = 0.02 * random.standard_normal(at.size)
        wheels[position] = Stream(position, at, {"velocity": rolling / RADIUS + noise})
    command = Stream("the command", at, {"torque": 0.0 * at, "steering": delta})
    moving = odometry.having(v_x=v_x, v_y=0.0 * at, yaw_rate=yaw_rate, heading=0.0 * at)
    streams = replace(recorded.streams, imu=None, odometry=moving, command=command)
    signals = on_grid(streams, ())
    assert signals is not None
    for finding in check_wheels(signals, wheels, RADIUS):
        assert finding.verdict is Verdict.OK, finding.text
        assert finding.value == pytest.approx(1.0, abs=0.004)


def test_joints_propose_a_radius_only_if_all_deviate(recorded: BagContent) -> None:
    streams = recorded.streams
    s = on_grid(streams, ())
    assert s is not None
    assert s.v_x is not None
    nominal = VEHICLE.wheel_radius

    def joint(factor: float) -> Stream:
        assert s.v_x is not None
        return Stream("joints", s.at_s, {"velocity": s.v_x / (factor * nominal)})

    one_low = list(check_joints(s, {"a": joint(1.0), "b": joint(0.95)}, nominal))
    assert [x.verdict for x in one_low] == [Verdict.OK, Verdict.FINDING]
    assert not any(x.parameters for x in one_low)
    both = list(check_joints(s, {"a": joint(0.95), "b": joint(0.95)}, nominal))
    for each in both:
        assert each.parameters["wheel_radius"] == pytest.approx(0.95 * nominal, rel=1e-3)
    (motor,) = check_joints(s, {"motor": joint(1.0 / 9.0)}, nominal)
    assert motor.verdict is Verdict.NOT_DECIDABLE
    assert "turns 9 times as fast as a wheel" in motor.text
