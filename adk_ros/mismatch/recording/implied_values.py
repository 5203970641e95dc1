# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Mass and steering ratio that a recording implies, to compare with files and units.

Without a slope, a_x = T / (R (m + I / R^2)) - c v^2 - d: a regression of the accelerometer on
torque and speed squared gives the accelerated mass. At low lateral acceleration, the road-wheel
angle is about wheelbase times yaw rate over speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay

_PERIOD_S = 0.02
_WINDOW_S = 1.02
"""Smoothing window, s, of all signals: longer than the lags of usual drives."""
_MIN_SPEED = 3.0
"""m/s. Slower, the noise of the yaw rate is a large angle; of a full-size car."""
_MAX_LATERAL = 2.5
"""m/s². Above it, tyre forces take part of the torque, and the steering angle is no ratio."""
_MIN_DETERMINATION = 0.25
"""Least share of the acceleration's variance that torque and speed explain."""
_ACCURATE_DETERMINATION = 0.95
"""
Share from which the mass is accurate: a torque limit, a slope or a pedal explains less. Empirical.
"""
_MIN_ROWS = 200
_BLOCK_ROWS, _MIN_BLOCKS = 500, 10
"""Rows of a bootstrap block, 10 s: longer than the residuals' memory; fewer for short data."""
_RESAMPLES = 100
_WHEELBASE = 2.7
"""m, of a mid-size car or its scale model; a unit is wrong by far more than wheelbases differ."""
_MIN_ANGLE = 0.003
_STEERING_UNITS = (
    (57.3, 1.35, "degrees at the road wheels"),
    (16.0, 1.6, "the hand-wheel angle in rad: a ratio of about {factor:.0f}"),
    (917.0, 1.6, "the hand-wheel angle in degrees: a ratio of about {ratio:.0f}"),
)
"""Factor of a usual wrong unit, the largest ratio to it, and what it is."""


class ImpliedMass(NamedTuple):
    """
    Mass in kg with a 90 % interval.

    `determination`: share of the acceleration's variance that torque and speed explain.
    """

    value: float
    low: float
    high: float
    determination: float

    @property
    def is_accurate(self) -> bool:
        """Whether torque and speed explain the acceleration well enough to correct a file."""
        return self.determination >= _ACCURATE_DETERMINATION

    def radius_at(self, mass: float, wheel_radius: float) -> tuple[float, float, float]:
        """
        Return the wheel radius with which `mass` is implied, m, and its 90 % interval.

        Torque and acceleration give only the product of mass and radius. `wheel_radius`: with
        which this mass is implied.
        """
        value, low, high = (wheel_radius * x / mass for x in self[:3])
        return value, low, high


def implied_mass(
    log: SensorLog, wheel_radius: float, wheel_inertia: float = 0.0, power_share: float = 1.0
) -> ImpliedMass | None:
    """
    Return the mass that the wheel torque accelerates, less that of the rotating wheels.

    `wheel_inertia` in kg·m² of all wheels. Uses the share `power_share` of the recording with the
    lowest power. None where torque and speed do not explain the acceleration. The interval is that
    of a block bootstrap.
    """
    at_s = np.arange(log.odometry_s[0], log.odometry_s[-1], _PERIOD_S)
    torque, a_x, a_y = (
        savitzky_golay(np.interp(at_s, stamps, values), _PERIOD_S, log.similar(_WINDOW_S))
        for stamps, values in (
            (log.command_s, log.command[:, 0]),
            (log.imu_s, log.imu[:, 0]),
            (log.imu_s, log.imu[:, 1]),
        )
    )
    v_x = np.interp(at_s, log.odometry_s, log.odometry[:, 0])
    power = np.abs(torque * v_x)
    used = (v_x > log.similar(_MIN_SPEED)) & (np.abs(a_y) < _MAX_LATERAL)
    used &= power <= np.quantile(power, power_share)
    if np.count_nonzero(used) < _MIN_ROWS:
        return None
    rows = np.column_stack([torque, v_x**2, np.ones_like(v_x)])[used]
    target = a_x[used]
    solved, *_ = np.linalg.lstsq(rows, target, rcond=None)
    determination = 1.0 - float((target - rows @ solved).var() / max(target.var(), 1e-12))
    if solved[0] <= 0.0 or determination < _MIN_DETERMINATION:
        return None
    rotating = wheel_inertia / wheel_radius**2
    slopes = _resampled(rows, target)
    low, high = np.quantile(1.0 / (np.maximum(slopes, 1e-9) * wheel_radius), [0.05, 0.95])
    value = 1.0 / (float(solved[0]) * wheel_radius)
    return ImpliedMass(
        value - rotating, float(low) - rotating, float(high) - rotating, determination
    )


def _resampled(rows: FloatArray, target: FloatArray) -> FloatArray:
    """Return the first coefficient of a regression for resampled blocks."""
    random = np.random.default_rng(0)
    size = min(_BLOCK_ROWS, rows.shape[0] // _MIN_BLOCKS)
    edges = np.arange(0, rows.shape[0], size)
    normal = [rows[i : i + size].T @ rows[i : i + size] for i in edges]
    right = [rows[i : i + size].T @ target[i : i + size] for i in edges]
    out = []
    for _ in range(_RESAMPLES):
        chosen = random.integers(0, edges.size, edges.size)
        matrix = np.sum([normal[i] for i in chosen], axis=0)
        vector = np.sum([right[i] for i in chosen], axis=0)
        out.append(np.linalg.lstsq(matrix, vector, rcond=None)[0][0])
    return np.array(out)


def steering_factor(log: SensorLog) -> float | None:
    """Return the command over the road-wheel angle that the yaw rate needs, or None."""
    at_s = np.arange(log.odometry_s[0], log.odometry_s[-1], _PERIOD_S)
    angle = np.interp(at_s, log.command_s, log.command[:, 1])
    v_x = np.interp(at_s, log.odometry_s, log.odometry[:, 0])
    rate = savitzky_golay(
        np.interp(at_s, log.odometry_s, log.odometry[:, 2]), _PERIOD_S, log.similar(_WINDOW_S)
    )
    used = (v_x > log.similar(_MIN_SPEED)) & (np.abs(rate * v_x) < _MAX_LATERAL)
    needed = _WHEELBASE * log.length_scale * rate[used] / v_x[used]
    if np.count_nonzero(np.abs(needed) > _MIN_ANGLE) < _MIN_ROWS:
        return None
    return float(np.abs(needed @ angle[used]) / (needed @ needed))


def steering_unit(log: SensorLog) -> str:
    """Return which unit the commanded steering angle may have, in words; empty if unclear."""
    factor = steering_factor(log)
    if factor is None:
        return ""
    for expected, widest, words in _STEERING_UNITS:
        if 1.0 / widest < factor / expected < widest:
            return words.format(factor=factor, ratio=factor / np.degrees(1.0))
    return ""
