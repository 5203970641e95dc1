# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that no finding can be drawn from are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.errors import DataError
from adk_ros.mismatch.recording.checks import (
    check_recording,
    check_same_vehicle,
    check_vehicle,
    effective_mass,
)
from adk_ros.mismatch.recording.sensor_log import SensorLog


def scaled(which: str, column: int, factor: float) -> Callable[[SensorLog], SensorLog]:
    def change(e: SensorLog) -> SensorLog:
        values = getattr(e, which).copy()
        values[:, column] *= factor
        return replace(e, **{which: values})

    return change


def still(e: SensorLog) -> SensorLog:
    return replace(e, odometry=0.001 * e.odometry)


def test_a_good_recording_passes() -> None:
    check_recording(case().simulation)
    check_recording(case().recording)
    check_same_vehicle(case().simulation, case().recording)
    check_vehicle(case().nominal, case().simulation)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda e: e.between(0.0, 10.0), "overlap for 10.0 s"),
        (still, "stands still"),
        (scaled("imu", 1, -1.0), "the IMU's a_y has its sign flipped"),
        (scaled("imu", 0, -1.0), "the IMU's a_x has its sign flipped"),
        (scaled("imu", 2, -1.0), "gyro's yaw rate has its sign flipped"),
        (scaled("odometry", 2, -1.0), "odometry's yaw rate has its sign flipped"),
        (scaled("command", 1, -1.0), "steering angle has its sign flipped"),
        (scaled("command", 0, -1.0), "torque has its sign flipped"),
        (scaled("imu", 2, 180.0 / np.pi), "its unit is not SI"),
        (scaled("odometry", 2, 180.0 / np.pi), "its unit is not SI"),
        (scaled("odometry", 0, 3.6), "its unit is not SI"),
        (scaled("command", 1, 57.3), "its unit is not rad at the wheels"),
        (scaled("imu", 1, 1.0 / 9.81), "its unit is not SI"),
        (scaled("odometry", 1, 0.0), "v_y is 0 throughout"),
        (scaled("command", 0, 0.0), "torque is 0 throughout"),
    ],
)
def test_a_bad_one_is_refused(change: Callable[[SensorLog], SensorLog], said: str) -> None:
    with pytest.raises(DataError) as error:
        check_recording(change(case().recording))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_drives_that_have_no_speed_in_common() -> None:
    with pytest.raises(DataError, match="like driving"):
        check_same_vehicle(case().simulation, scaled("odometry", 0, 4.0)(case().recording))


def test_a_drive_at_its_most_power_does_not_contradict_the_vehicle() -> None:
    c = case("power_limit", power=3e4)
    whole = effective_mass(c.recording, c.nominal.wheel_radius)
    gentle = effective_mass(c.recording, c.nominal.wheel_radius, power=0.3)
    assert whole is not None
    assert gentle is not None
    # What is asked for beyond the limit moves nothing: the car seems heavier than it is.
    assert whole > 1.5 * gentle
    assert gentle == pytest.approx(c.nominal.mass, rel=0.15)
    check_vehicle(c.nominal, c.recording)


def test_a_vehicle_that_contradicts_the_bag() -> None:
    other = case().nominal.model_copy(update={"mass": 9000.0})
    with pytest.raises(DataError, match="another car's"):
        check_vehicle(other, case().simulation)
