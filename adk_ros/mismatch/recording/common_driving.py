# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Signals of two recordings on a common grid, weighted so that their driving is comparable.

A regression of an approximate equation depends on the driving that it is fitted to. Samples are
therefore counted by speed and lateral acceleration, and each recording gets weights with which
both have the same share of each class; classes that only one of them visits do not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.criteria import MIN_SPEED
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.differentiation import savitzky_golay

PERIOD_S = 0.02
"""Period of the grid, s: that of 50 Hz odometry."""
BLOCK_ROWS = 250
"""Rows of a bootstrap block: 5 s, longer than the memory of the car's response."""
MAX_LATERAL = 3.5
"""m/s². Above it the side force is no longer proportional to the slip angle (ISO 4138: 4 m/s²)."""
SPEED_CLASS, LATERAL_CLASS = 2.0, 0.7
"""
Widths of a class of driving, m/s and m/s²: narrow against the range, wide against noise. That of
the speed is for a full-size car.
"""


@dataclass(frozen=True)
class DrivingSignals:
    """
    Signals (n,) on a grid of `PERIOD_S`, each smoothed with the same filter, SI.

    `steering`, `torque` are the commands before smoothing, to be delayed; `pose_speed`: speed
    along the heading from the pose.
    """

    v_x: FloatArray
    v_y: FloatArray
    yaw_rate: FloatArray
    a_x: FloatArray
    a_y: FloatArray
    gyro: FloatArray
    pose_speed: FloatArray
    torque: FloatArray
    steering: FloatArray
    min_speed: float = MIN_SPEED
    """m/s. Slower samples do not count."""

    @classmethod
    def of(cls, log: SensorLog) -> DrivingSignals:
        """Return the signals of a recording; those of a missing IMU are zero."""
        at_s = np.arange(log.odometry_s[0], log.odometry_s[-1], PERIOD_S)

        def on_grid(stamps: FloatArray, values: FloatArray) -> FloatArray:
            return np.interp(at_s, stamps, values) if stamps.size else np.zeros_like(at_s)

        v_x, v_y, yaw_rate, x, y, heading = (
            smooth(on_grid(log.odometry_s, values))
            for values in (*log.odometry.T[:3], *log.pose.T[:3])
        )
        a_x, a_y, gyro = (smooth(on_grid(log.imu_s, values)) for values in log.imu.T[:3])
        along = np.gradient(x, PERIOD_S) * np.cos(heading)
        along += np.gradient(y, PERIOD_S) * np.sin(heading)
        # A command is held until the next; its value at a time is that of the last stamp.
        latest = np.searchsorted(log.command_s, at_s, side="right") - 1
        held = log.command[np.maximum(latest, 0)]
        return cls(
            *(v_x, v_y, yaw_rate, a_x, a_y, gyro, along, held[:, 0], held[:, 1]),
            log.similar(MIN_SPEED),
        )

    @property
    def has_imu(self) -> bool:
        """Whether the recording has an IMU."""
        return bool(np.ptp(self.gyro) > 0.0)

    @property
    def lateral(self) -> FloatArray:
        """Lateral acceleration (n,) from speed and yaw rate, m/s²."""
        return np.asarray(self.v_x * self.yaw_rate)


def smooth(values: FloatArray) -> FloatArray:
    """Return values on the grid, smoothed over 0.5 s without a phase shift."""
    return savitzky_golay(values, PERIOD_S)


def delayed(values: FloatArray, delay_s: float) -> FloatArray:
    """Return values on the grid, later by `delay_s`."""
    at = np.arange(values.shape[0], dtype=np.float64)
    return np.asarray(np.interp(at - delay_s / PERIOD_S, at, values))


def common_weights(first: DrivingSignals, second: DrivingSignals) -> tuple[FloatArray, FloatArray]:
    """
    Return weights (n,) and (m,) of the samples of two recordings.

    In each class of speed and lateral acceleration the sums of the weights are in proportion to
    the same share: the smaller of the two recordings' shares. A sample weighs at most one.
    """
    classes = [_classes(signals) for signals in (first, second)]
    size = 1 + max(int(c.max(initial=0)) for c in classes)
    counts = [np.bincount(c[c >= 0], minlength=size).astype(np.float64) for c in classes]
    shares = [c / max(c.sum(), 1.0) for c in counts]
    both = np.minimum(*shares)
    out = []
    for own, share in zip(classes, shares, strict=True):
        ratio = np.divide(both, share, out=np.zeros(size), where=share > 0.0)
        out.append(np.where(own >= 0, ratio[np.maximum(own, 0)], 0.0))
    return out[0], out[1]


def _classes(signals: DrivingSignals) -> IntArray:
    """Return the class (n,) of each sample; -1 for one that does not count."""
    lateral = signals.lateral
    per_speed = int(2.0 * MAX_LATERAL / LATERAL_CLASS) + 1
    row = np.floor(signals.v_x / (SPEED_CLASS * signals.min_speed / MIN_SPEED)).astype(np.int64)
    column = np.floor((lateral + MAX_LATERAL) / LATERAL_CLASS).astype(np.int64)
    counts = (signals.v_x > signals.min_speed) & (np.abs(lateral) < MAX_LATERAL)
    return np.asarray(np.where(counts, row * per_speed + column, -1), dtype=np.int64)
