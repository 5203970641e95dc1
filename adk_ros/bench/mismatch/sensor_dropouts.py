# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Intermittent dropouts of a sensor: messages that are missing, or that repeat the last value.

They are faults of a sensor and not of the car: a result may call the recording unexplained, but a
named effect is wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

DROPOUTS = {
    "odometry_missing": 0.06,
    "odometry_frozen": 0.03,
    "imu_missing": 0.06,
    "imu_frozen": 0.03,
}
"""Dropout -> share of the time that it lasts, at strength 1; by choice."""
_SHORTEST_S, _LONGEST_S = 0.2, 1.0
"""Durations of one dropout, s, by choice: those of a loose connector or a busy network."""


def with_dropouts(
    log: SensorLog, dropouts: dict[str, float], rng: np.random.Generator
) -> SensorLog:
    """Return the log with dropouts: name -> share of the time."""
    for name, share in dropouts.items():
        sensor, fault = name.split("_")
        at_s = log.imu_s if sensor == "imu" else log.odometry_s
        out = _in_dropout(at_s, share, rng)
        rows = np.flatnonzero(~out) if fault == "missing" else _held(out)
        times = at_s[rows] if fault == "missing" else at_s
        if sensor == "imu":
            log = replace(log, imu_s=times, imu=log.imu[rows])
        else:
            log = replace(log, odometry_s=times, odometry=log.odometry[rows], pose=log.pose[rows])
    return log


def _in_dropout(at_s: FloatArray, share: float, rng: np.random.Generator) -> BoolArray:
    """Return which of the messages are in a dropout; the first is not."""
    end_s = float(at_s[-1])
    count = round(share * end_s / (0.5 * (_SHORTEST_S + _LONGEST_S)))
    out = np.zeros(at_s.size, dtype=bool)
    for begin in rng.uniform(at_s[0], end_s, count):
        out |= (at_s > begin) & (at_s < begin + rng.uniform(_SHORTEST_S, _LONGEST_S))
    return out


def _held(out: BoolArray) -> IntArray:
    """Return for each message the index of the last one that was not in a dropout."""
    rows = np.where(out, 0, np.arange(out.size))
    return np.asarray(np.maximum.accumulate(rows))
