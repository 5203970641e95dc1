# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Dropouts of a sensor: messages that repeat the last reading, and intervals without messages.

A repeated reading looks like a measurement, but is none; such messages are removed. With p the
share of messages that equal the one before, a sensor of coarse resolution repeats a reading k
times somewhere in n messages with a probability of at most n p^k. Longer runs are a frozen sensor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import BoolArray, FloatArray

_FALSE_ALARM = 0.01
"""Probability of a run that chance explains, per recording and sensor. Convention."""
_MIN_MOVING_SPEED = 2.0
"""m/s below which readings may rightly be constant, as in `recording.checks`."""
_MIN_GAP_S, _MIN_GAP_PERIODS = 0.1, 5.0
"""A gap lasts this long and this many periods at least: any network loses single messages."""


def without_frozen_readings(log: SensorLog) -> tuple[SensorLog, list[str]]:
    """Return the log without frozen messages, and notes on dropouts."""
    notes = []
    speed = np.interp(log.imu_s, log.odometry_s, np.abs(log.odometry[:, 0]))
    frozen = _frozen(log.imu, speed > log.similar(_MIN_MOVING_SPEED))
    notes += _note("the IMU", "repeats its last reading", _intervals(log.imu_s, frozen))
    log = replace(log, imu_s=log.imu_s[~frozen], imu=log.imu[~frozen])
    speed = np.abs(log.odometry[:, 0])
    frozen = _frozen(log.odometry, speed > log.similar(_MIN_MOVING_SPEED))
    notes += _note("odometry", "repeats its last reading", _intervals(log.odometry_s, frozen))
    log = replace(
        log,
        odometry_s=log.odometry_s[~frozen],
        odometry=log.odometry[~frozen],
        pose=log.pose[~frozen],
    )
    if not notes:
        notes += _note("the IMU", "is missing", gaps(log.imu_s))
        notes += _note("odometry", "is missing", gaps(log.odometry_s))
    return log, notes


def _frozen(readings: FloatArray, moving: BoolArray) -> BoolArray:
    """Return which messages (n,) belong to a run of readings (n, k) that chance cannot explain."""
    n = readings.shape[0]
    out = np.zeros(n, dtype=bool)
    if n < 2:
        return out
    equal = np.concatenate([[False], (np.diff(readings, axis=0) == 0.0).all(axis=1)])
    equal &= moving
    p = float(equal.mean())
    if not 0.0 < p < 1.0:
        return out
    longest = np.log(_FALSE_ALARM / n) / np.log(p)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], equal.astype(np.int8), [0]])))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        out[begin:end] = end - begin > longest
    return out


def _intervals(at_s: FloatArray, inside: BoolArray) -> list[tuple[float, float]]:
    """Return the times (begin, end) of the runs in `inside`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    return [
        (float(at_s[a]), float(at_s[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def gaps(at_s: FloatArray) -> list[tuple[float, float]]:
    """Return the times (begin, end) without messages."""
    if at_s.size < 2:
        return []
    interval = np.diff(at_s)
    long = interval > max(_MIN_GAP_S, _MIN_GAP_PERIODS * float(np.median(interval)))
    return [(float(at_s[i]), float(at_s[i + 1])) for i in np.flatnonzero(long)]


def _note(sensor: str, what: str, intervals: list[tuple[float, float]]) -> list[str]:
    if not intervals:
        return []
    durations = [end - begin for begin, end in intervals]
    count = f"{len(intervals)} intervals" if len(intervals) > 1 else "one interval"
    first, longest = intervals[0][0], max(durations)
    return [
        f"{sensor} {what} in {count}, {sum(durations):.1f} s in all, the longest {longest:.1f} s, "
        f"the first at {first:.1f} s: a dropout of the sensor, which counts as missing data"
    ]
