# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors and steering, injected into a simulated drive, are found with their size."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.calibration import (
    VEHICLE,
    Fault,
    added,
    at_rear_axle,
    checked,
    displaced,
    driven,
    existing,
    frozen,
    jumped,
    late,
    low_passed,
    mounted,
    scaled,
    turned_odometry,
    without,
)

import adk_ros.calibration.check as check_module
from adk_ros.calibration.check import CheckResult
from adk_ros.calibration.finding import Finding, Verdict, found
from adk_ros.calibration.grid import on_grid
from adk_ros.calibration.known_errors import with_known_errors, without_known_errors
from adk_ros.calibration.relations import smoothed
from adk_ros.calibration.road import check_road
from adk_ros.calibration.streams import Streams
from adk_ros.signals.decode import SensorConfig

DEGREES = 180.0 / math.pi


@pytest.fixture(autouse=True)
def no_road(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out grade and bank, which take most of the time: test_road.py checks them."""
    monkeypatch.setattr(check_module, "check_road", lambda *_: ([], None))


def findings(fault: Fault) -> dict[str, Finding]:
    return {x.name: x for x in result(fault).of(Verdict.FINDING)}


def result(fault: Fault) -> CheckResult:
    return checked(fault(driven()))


@pytest.mark.parametrize(
    ("fault", "name", "said"),
    [
        (scaled("command", -1.0, "steering"), "steering", "sign flipped"),
        (scaled("command", -1.0, "torque"), "torque", "sign flipped"),
        (scaled("command", 1e-3, "torque"), "torque", "kN m"),
        (scaled("command", 2e-4, "torque"), "torque", "pedal"),
        (scaled("command", DEGREES, "steering"), "steering", "deg at the road wheel"),
        (scaled("imu", -1.0, "w_z"), "w_z", "sign flipped"),
        (scaled("imu", DEGREES, "w_z"), "w_z", "looks like deg"),
        (scaled("imu", -1.0, "a_x"), "imu_axes", "a_x has its sign flipped"),
        (scaled("imu", -1.0, "a_y"), "imu_axes", "a_y has its sign flipped"),
        (scaled("imu", -1.0, "a_x", "a_y", "a_z"), "imu_axes", "opposite sign"),
        (scaled("imu", 1.0 / 9.81, "a_x", "a_y", "a_z"), "acceleration_unit", "look like g"),
        (added("imu", a_z=-9.81), "gravity", "gravity is removed"),
        (scaled("odometry", -1.0, "v_x"), "v_x", "sign flipped"),
        (scaled("odometry", -1.0, "v_y"), "v_y", "sign flipped"),
        (scaled("odometry", 3.6, "v_x", "v_y"), "v_x", "km/h"),
        (scaled("odometry", -1.0, "yaw_rate"), "yaw_rate", "sign flipped"),
        (scaled("odometry", DEGREES, "yaw_rate"), "yaw_rate", "looks like deg"),
        (scaled("odometry", -1.0, "heading"), "heading", "sign flipped"),
        (frozen("imu", 50.0, 53.0), "imu_frozen", "3.00 s, from 50.0 s"),
        (frozen("odometry", 50.0, 53.0), "odometry_frozen", "2.98 s, from 50.0 s"),
        (without("odometry", 50.0, 52.0), "odometry_gaps", "2.02 s, from 50.0 s"),
        (jumped(60.0, 2.0), "pose_jumps", "at 60.0 s: 1.9"),
        (jumped(60.0, 0.0, 0.3), "pose_jumps", "17.2"),
        (late("imu", 1e6), "clocks", "do not overlap"),
    ],
)
def test_a_fault_is_the_only_finding(fault: Fault, name: str, said: str) -> None:
    found = findings(fault)
    # The map to force is no fault: it is what a pedal allows.
    assert [key for key in found if key != "pedal_map"] == [name]
    assert said in found[name].text
    assert found[name].evidence


@pytest.mark.parametrize(
    "fault",
    [
        scaled("imu", -1.0, "a_x"),
        scaled("odometry", 3.6, "v_x", "v_y"),
        mounted(0.0, 3.0, 0.0),
        late("odometry", 0.05),
    ],
)
def test_a_fault_is_no_slope(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_module, "check_road", check_road)
    of_road = [x for x in result(fault).findings if x.name.startswith("road_")]
    assert [x.name for x in of_road] == ["road_grade", "road_bank"]
    assert not [x for x in of_road if x.verdict is Verdict.FINDING]


@pytest.mark.parametrize(
    ("fault", "name", "size"),
    [
        (late("imu", 0.05), "gyro_delay", 0.05),
        (late("imu", 0.05), "accelerometer_delay", 0.05),
        (late("odometry", 0.05), "gyro_delay", -0.05),
        (low_passed("odometry", 0.3, "yaw_rate"), "odometry_yaw_rate_filter", 0.3),
        (low_passed("imu", 0.3, "w_z"), "gyro_filter", 0.3),
        (scaled("command", 0.93, "steering"), "steering_ratio", 0.93),
        (added("command", steering=0.02), "steering_offset", 0.02),
        (scaled("odometry", 1.03, "v_x", "v_y"), "odometry_scale", 1.03),
        # The simulated gyro has a bias of 0.0005 rad/s of its own.
        (added("imu", w_z=0.01), "gyro_bias", 0.0105),
        (scaled("imu", 1.03, "w_z"), "gyro_scale", 1.03),
        (scaled("imu", 0.97, "w_z"), "gyro_scale", 0.97),
        (displaced(1.5, 0.0), "imu_position", 1.5),
        (displaced(-1.0, 0.8), "imu_position", -1.0),
        (at_rear_axle, "reference_point", 0.0),
        (turned_odometry(0.009), "odometry_rotation", 0.009),
        (mounted(0.0, 3.0, 0.0), "imu_pitch", math.radians(3.0)),
        (mounted(-3.0, 0.0, 0.0), "imu_roll", math.radians(-3.0)),
        (mounted(0.0, 0.0, 10.0), "imu_yaw", math.sin(math.radians(10.0))),
    ],
)
def test_a_size_lies_within_its_interval(fault: Fault, name: str, size: float) -> None:
    found = findings(fault)[name]
    assert found.value is not None
    assert found.low is not None
    assert found.high is not None
    # Bias of the simulated sensors and discrete filters: 2 % and 1e-3 on top of the interval.
    slack = 0.02 * abs(size) + 1e-3 + (0.02 if name == "reference_point" else 0.0)
    assert found.low - slack <= size <= found.high + slack
    assert found.standard_errors is not None
    assert found.standard_errors >= 3.5
    assert found.seconds is not None
    assert found.seconds > 100.0


@pytest.mark.parametrize(
    ("fault", "angles"),
    [
        (mounted(0.0, 0.0, 90.0), (0.0, 0.0, 90.0)),
        (mounted(0.0, 0.0, -90.0), (0.0, 0.0, -90.0)),
        (mounted(0.0, 0.0, 180.0), (0.0, 0.0, 180.0)),
        (mounted(180.0, 0.0, 0.0), (180.0, 0.0, 0.0)),
        (mounted(90.0, 0.0, 0.0), (90.0, 0.0, 0.0)),
        (mounted(0.0, 3.0, 0.0), (0.0, 3.0, 0.0)),
        (mounted(-3.0, 3.0, 0.0), (-3.0, 3.0, 0.0)),
        (mounted(0.0, 0.0, 10.0), (0.0, 0.0, 10.0)),
    ],
)
def test_a_turned_imu_is_proposed_as_a_rotation(
    fault: Fault, angles: tuple[float, float, float]
) -> None:
    proposed = result(fault).parameters
    assert set(proposed) == {"imu_rotation"}
    assert np.degrees(proposed["imu_rotation"]) == pytest.approx(angles, abs=0.3)


@pytest.mark.parametrize(
    ("fault", "name", "value"),
    [
        (scaled("command", -1.0, "steering"), "steering_ratio", -1.0),
        (scaled("command", DEGREES, "steering"), "steering_ratio", DEGREES),
        (scaled("command", 16.0, "steering"), "steering_ratio", 16.0),
        (scaled("command", -16.0 * DEGREES, "steering"), "steering_ratio", -16.0 * DEGREES),
        (scaled("command", 0.93, "steering"), "steering_ratio", 0.93),
        (displaced(-1.0, 0.8), "imu_position", [-1.0, 0.8]),
        (at_rear_axle, "reference_point", [VEHICLE.cg_to_rear_axle, 0.0]),
        (turned_odometry(-0.02), "odometry_rotation", -0.02),
    ],
)
def test_parameters_that_are_proposed(fault: Fault, name: str, value: float) -> None:
    assert result(fault).parameters[name] == pytest.approx(value, rel=0.02, abs=0.03)


def test_the_reference_point_is_found_where_the_heading_is_the_course() -> None:
    """The lateral velocity of such a pose is zero, and contradicts no v_y."""
    ahead = 0.7

    def fault(streams: Streams) -> Streams:
        odometry = streams.odometry
        assert odometry is not None
        course = odometry["heading"] + np.arctan2(odometry["v_y"], odometry["v_x"])
        v_y = odometry["v_y"] + ahead * odometry["yaw_rate"]
        return replace(streams, odometry=odometry.having(v_y=v_y, heading=course))

    found = findings(fault)["reference_point"]
    assert found.value == pytest.approx(VEHICLE.cg_to_rear_axle + ahead, abs=0.05)
    assert result(fault).parameters["reference_point"] == pytest.approx([-ahead, 0.0], abs=0.05)


def test_a_v_y_that_a_measured_heading_contradicts_decides_nothing() -> None:
    def far_ahead(streams: Streams) -> Streams:
        odometry = streams.odometry
        assert odometry is not None
        return replace(
            streams, odometry=odometry.having(v_y=odometry["v_y"] + 5.0 * odometry["yaw_rate"])
        )

    found = {x.name: x for x in result(far_ahead).findings}["reference_point"]
    assert found.verdict is Verdict.NOT_DECIDABLE
    assert "contradict each other" in found.text


def test_a_filtered_yaw_rate_is_no_delay() -> None:
    found = findings(low_passed("odometry", 0.3, "yaw_rate"))
    assert list(found) == ["odometry_yaw_rate_filter"]
    assert "it is no delay" in found["odometry_yaw_rate_filter"].remedy


def test_a_filtered_imu_has_no_lever_arm_and_no_scale() -> None:
    found = findings(low_passed("imu", 0.3, "w_z", "a_x", "a_y"))
    assert set(found) == {"gyro_filter", "accelerometer_filter"}


def test_a_late_command_is_a_steering_delay() -> None:
    # The plant adds 0.03 s of actuator and 0.0125 s of hold.
    found = findings(late("command", -0.1))["steering_delay"]
    assert found.value == pytest.approx(0.1425, abs=0.02)
    # It is no error of a sensor: nothing to set.
    assert not found.parameters
    assert "`adk mismatch` names it as steering_delay" in found.remedy


def test_corrected_parameters_leave_nothing_to_find() -> None:
    from dataclasses import replace

    from adk_ros.calibration.from_bag import turned
    from adk_ros.signals.decode import SensorConfig
    from adk_ros.signals.frames import rotation

    fault = mounted(180.0, 0.0, 90.0)
    streams = scaled("command", -16.0, "steering")(fault(driven()))
    proposed = checked(streams).parameters
    sensors = SensorConfig(
        steering_ratio=proposed["steering_ratio"], imu_rotation=tuple(proposed["imu_rotation"])
    )
    assert streams.imu is not None
    read = scaled("command", 1.0 / sensors.steering_ratio, "steering")(
        replace(streams, imu=turned(streams.imu, rotation(*sensors.imu_rotation)))
    )
    assert not checked(read, sensors=sensors).of(Verdict.FINDING)


@pytest.mark.slow(seconds=40)
@pytest.mark.parametrize(
    ("faults", "proposed"),
    [
        ((scaled("command", 1e-3, "torque"),), {"torque_scale": 1e-3}),
        ((scaled("command", -1.0, "torque"),), {"torque_scale": -1.0}),
        ((added("command", steering=0.02),), {"steering_offset": 0.02}),
        (
            (scaled("imu", DEGREES * 1.03, "w_x", "w_y", "w_z"), added("imu", w_z=0.6)),
            # The simulated gyro has a bias of 0.0005 rad/s of its own.
            {"gyro_scale": DEGREES * 1.03, "gyro_bias": 0.6 + 0.0005 * DEGREES * 1.03},
        ),
        ((scaled("odometry", DEGREES, "yaw_rate"),), {"yaw_rate_scale": DEGREES}),
        ((scaled("odometry", 3.6, "v_x", "v_y"),), {"odometry_scale": 3.6}),
        ((scaled("odometry", 1.04, "v_x", "v_y"),), {"odometry_scale": 1.04}),
        # The steering ratio and wheel radii are relative to the speed: they do not repeat it.
        ((scaled("odometry", 1.08, "v_x", "v_y"),), {"odometry_scale": 1.08}),
        (
            (scaled("imu", 1.0 / 9.81, "a_x", "a_y", "a_z"), added("imu", a_y=0.05)),
            {"accelerometer_scale": 1.0 / 9.81, "accelerometer_bias": [0.0, 0.05]},
        ),
        ((turned_odometry(0.03),), {"odometry_rotation": 0.03}),
        ((late("imu", 0.06),), {"imu_delay": 0.06}),
        ((late("odometry", 0.06),), {"odometry_delay": 0.06}),
    ],
)
def test_an_error_of_a_sensor_is_proposed_and_then_known(
    faults: tuple[Fault, ...], proposed: dict[str, float | list[float]]
) -> None:
    streams = driven()
    for fault in faults:
        streams = fault(streams)
    found = checked(streams).parameters
    assert set(found) == set(proposed)
    for name, value in proposed.items():
        assert found[name] == pytest.approx(value, rel=0.03, abs=0.004)
    values: dict[str, Any] = {
        name: tuple(x) if isinstance(x, list) else x for name, x in found.items()
    }
    sensors = SensorConfig(**values)
    for role in ("imu", "odometry", "command"):
        stream = streams.of(role)
        assert stream is not None
        streams = streams.with_stream(role, without_known_errors(stream, role, sensors))
    assert not checked(streams, sensors=sensors).of(Verdict.FINDING)
    # Found again with these parameters, an error adds to the known one.
    again = checked(added("imu", w_z=0.02)(streams), sensors=sensors).parameters
    assert again == {"gyro_bias": pytest.approx(sensors.gyro_bias + 0.02 * sensors.gyro_scale,
                                                rel=0.1)}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "further_s", "before", "proposed"),
    [
        ("imu_delay", 0.02, SensorConfig(imu_delay=0.06), {"imu_delay": 0.08}),
        ("odometry_delay", 0.02, SensorConfig(imu_delay=0.06), {"imu_delay": 0.04}),
        (
            "odometry_delay",
            0.08,
            SensorConfig(imu_delay=0.06),
            {"imu_delay": 0.0, "odometry_delay": 0.02},
        ),
        ("imu_delay", 0.05, SensorConfig(odometry_delay=0.05), {"odometry_delay": 0.0}),
    ],
)
def test_a_further_delay_first_shortens_that_of_the_other_stream(
    name: str, further_s: float, before: SensorConfig, proposed: dict[str, float]
) -> None:
    (finding,), after = with_known_errors([found("gyro_delay", "", "", {name: further_s})], before)
    assert finding.parameters == pytest.approx(proposed)
    sign = 1.0 if name == "imu_delay" else -1.0
    assert after.imu_delay - after.odometry_delay == pytest.approx(
        before.imu_delay - before.odometry_delay + sign * further_s
    )


def test_a_known_delay_that_is_too_long_is_shortened() -> None:
    sensors = SensorConfig(imu_delay=0.1)
    streams = late("imu", 0.06)(driven())
    assert streams.imu is not None
    streams = streams.with_stream("imu", without_known_errors(streams.imu, "imu", sensors))
    proposed = checked(streams, sensors=sensors).parameters
    assert proposed == {"imu_delay": pytest.approx(0.06, abs=0.004)}


def without_heading(fault: Fault) -> Fault:
    """Of positions without a heading, such as those of a satellite receiver."""

    def apply(streams: Streams) -> Streams:
        streams = fault(streams)
        odometry = existing(streams, "odometry")
        unknown = np.full(odometry.at_s.size, np.nan)
        return replace(streams, odometry=odometry.having(heading=unknown))

    return apply


@pytest.mark.parametrize(
    ("fault", "flipped"),
    [
        (scaled("odometry", 1.0, "v_x"), set()),
        (scaled("odometry", -1.0, "yaw_rate"), {"yaw_rate"}),
        (scaled("imu", -1.0, "w_z"), {"w_z"}),
    ],
)
def test_the_course_of_positions_says_which_yaw_rate_is_flipped(
    fault: Fault, flipped: set[str]
) -> None:
    found = findings(without_heading(fault))
    assert {name for name in ("yaw_rate", "w_z", "steering", "imu_axes") if name in found} == (
        flipped
    )


def test_without_a_third_yaw_rate_nobody_says_which_is_flipped() -> None:
    def without_pose(streams: Streams) -> Streams:
        streams = scaled("imu", -1.0, "w_z")(streams)
        odometry = existing(streams, "odometry")
        unknown = np.full(odometry.at_s.size, np.nan)
        return replace(streams, odometry=odometry.having(x=unknown, y=unknown, heading=unknown))

    (gyro,) = [x for x in result(without_pose).findings if x.name == "w_z"]
    assert gyro.verdict is Verdict.NOT_DECIDABLE
    assert "opposite to odometry's yaw rate" in gyro.text
    assert not gyro.parameters


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_a_gyro_that_does_not_vary_is_none(value: float) -> None:
    """A missing gyro reports zeros; less a known bias they are a constant, and smoothed."""
    streams = driven()
    imu = existing(streams, "imu")
    constant = streams.with_stream("imu", imu.having(w_z=np.full(imu.at_s.size, value)))
    s = on_grid(constant, [])
    assert s is not None
    assert s.gyro is None
    assert s.turning is s.heading_rate
    without_pose = replace(s, heading_rate=None)
    assert without_pose.turning is without_pose.yaw_rate
    assert smoothed(without_pose).gyro is None


def test_a_steering_offset_is_that_of_the_road_wheels() -> None:
    """A servo that turns 1.4 times the angle of the wheels, with an offset of 0.028 rad of it."""
    fault = added("command", steering=0.028)
    turned = result(lambda streams: fault(scaled("command", 1.4, "steering")(streams)))
    assert turned.parameters["steering_ratio"] == pytest.approx(1.4, rel=0.03)
    assert turned.parameters["steering_offset"] == pytest.approx(0.02, abs=0.002)
    # The reading is then corrected for both, whatever was known before.
    known = SensorConfig(steering_ratio=2.0, steering_offset=0.01)
    again = checked(fault(scaled("command", 1.4, "steering")(driven())), sensors=known)
    assert again.parameters["steering_ratio"] == pytest.approx(2.8, rel=0.03)
    assert again.parameters["steering_offset"] == pytest.approx((0.01 + 0.028) / 1.4, abs=0.002)


def test_a_command_of_another_type_than_configured_gets_no_ratio() -> None:
    streams = scaled("command", -1.0, "steering")(driven())
    found = {x.name: x for x in checked(streams, command_type="ackermann").findings}
    assert found["steering"].verdict is Verdict.FINDING
    assert "steering_ratio" not in found["steering"].parameters
    assert "correct what publishes it" in found["steering"].remedy


def test_a_bias_next_to_a_scale_is_in_the_unit_of_the_reading() -> None:
    """A reading of 1.2 a + 0.3: the bias is 0.3, not 1.2 times that."""
    proposals = [
        found("a_scale", "", "", {"accelerometer_scale": 1.2}),
        found("a_bias", "", "", {"accelerometer_bias": [0.3, 0.0]}),
        found("g_scale", "", "", {"gyro_scale": 1.1}),
        found("g_bias", "", "", {"gyro_bias": 0.01}),
    ]
    _, sensors = with_known_errors(proposals, SensorConfig(accelerometer_scale=2.0))
    assert sensors.accelerometer_scale == pytest.approx(2.4)
    assert sensors.accelerometer_bias == pytest.approx((0.6, 0.0))
    assert sensors.gyro_bias == pytest.approx(0.011)


def test_a_recording_without_usable_stamps_is_said() -> None:
    nothing = replace(driven(), imu=None, odometry=None, command=None)
    found = {x.name: x for x in checked(nothing).findings}
    assert "no stream has ten messages with usable stamps" in found["clocks"].text
