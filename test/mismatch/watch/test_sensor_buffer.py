# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The buffer of readings: order, faults, and its memory."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.watch.sensor_buffer import SensorBuffer
from adk_ros.signals.channels import Reading, Source

START_NS = 1_760_000_000_000_000_000


def reading(source: Source, at_s: float, *values: float) -> Reading:
    return Reading(source, START_NS + round(at_s * 1e9), values)


def filled(seconds: float = 10.0) -> SensorBuffer:
    buffer = SensorBuffer()
    for i in range(round(100 * seconds)):
        at_s = 0.01 * i
        if i % 5 == 0:
            buffer.push(reading(Source.COMMAND, at_s, at_s, 0.1))
        buffer.push(reading(Source.IMU, at_s + 0.001, 1.0, 2.0, at_s))
        if i % 2 == 0:
            heading = math.remainder(3.0 + 0.5 * at_s, math.tau)
            pose = (at_s, 0.0, heading)
            buffer.push(reading(Source.ODOMETRY, at_s + 0.002, 10.0, 0.0, at_s), pose)
    return buffer


def test_a_stretch_has_the_readings_of_its_time_and_the_command_in_force() -> None:
    log = filled().log(2.005, 4.0)
    assert log is not None
    assert log.imu_s[0] >= 2.005
    assert log.imu_s[-1] < 4.0
    np.testing.assert_allclose(log.imu[:, 2], log.imu_s - 0.001, atol=1e-6)
    assert log.command_s[0] <= 2.005
    np.testing.assert_allclose(log.command[0, 0], 2.0)
    assert np.abs(np.diff(log.pose[:, 2])).max() < 0.1  # The heading passes pi without a jump.


def test_readings_that_are_not_newer_or_not_finite_are_ignored() -> None:
    buffer = filled(5.0)
    before = buffer.log(1.0, 4.0)
    buffer.push(reading(Source.IMU, 2.0, 99.0, 99.0, 99.0))
    buffer.push(reading(Source.IMU, 5.1, math.nan, math.nan, 0.0))
    after = buffer.log(1.0, 4.0)
    assert buffer.ignored == 2
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(before.imu, after.imu)


def test_a_stretch_without_readings_of_a_stream_is_none() -> None:
    buffer = filled(5.0)
    assert buffer.log(20.0, 28.0) is None
    silent = SensorBuffer()
    for i in range(500):
        silent.push(reading(Source.IMU, 0.01 * i, 0.0, 0.0, 0.0))
        silent.push(reading(Source.ODOMETRY, 0.01 * i, 0.0, 0.0, 0.0))
    assert silent.log(1.0, 4.0) is None


def test_a_measured_steering_angle_replaces_the_commanded_one() -> None:
    buffer = filled(2.0)
    buffer.push(reading(Source.STEERING, 2.0, 0.3))
    buffer.push(reading(Source.COMMAND, 2.05, 7.0, 0.1))
    for i in range(100):
        buffer.push(reading(Source.IMU, 2.1 + 0.01 * i, 0.0, 0.0, 0.0))
        buffer.push(reading(Source.ODOMETRY, 2.1 + 0.01 * i, 0.0, 0.0, 0.0))
    log = buffer.log(2.06, 3.0)
    assert log is not None
    assert log.command[0].tolist() == [7.0, 0.3]


def test_memory_is_bounded() -> None:
    buffer = SensorBuffer()
    for i in range(400_000):
        buffer.push(reading(Source.IMU, 0.01 * i, 0.0, 0.0, 0.0))
    assert buffer._imu._rows.shape[0] <= 16_384
    assert buffer.newest_s > 3999.0
