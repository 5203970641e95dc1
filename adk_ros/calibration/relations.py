# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Relations between the channels of a recording, whose coefficients a fault of a sensor changes.

Signals are those of `smoothed`. Each is a linear regression of one channel on what other channels
imply for it, with columns for whatever the same car always has (understeer, a lever arm, a lag).
Its coefficients need not be those of a perfect sensor: two recordings of one car have the same.

    velocity      distance by v_x over 5 s = s (displacement of the pose) + e (change of v_x)
    gyro          r = s w_z + b + T dw_z/dt + c d²w_z/dt²,   r: of the heading, else of odometry
    yaw_rate      r, on odometry's yaw rate in the same way
    gyro_x, _y    w_x, w_y = c r + b
    a_x           = s u + b - T du/dt - x r² - y dr/dt,   u = dv_x/dt - v_y r
    a_y           = s u + b - T du/dt + x dr/dt - y r²,   u = v_x r + dv_y/dt
    steering      v_x delta = L r + K v_x² r + o v_x + T v_x dr/dt - D dr/dt, in the linear range
    fast_steering the same of all driving, where the linear range is left most of the time
    drive         dv_x/dt - v_y r = p T+ + n T- + d dT+/dt + e dT-/dt + c v_x² + o
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.criteria import (
    BLOCK_S,
    MAX_COPY,
    MIN_BLOCK_S,
    MIN_LINEAR_SHARE,
    PERIOD_S,
    USUAL_BLOCKS,
)
from adk_ros.calibration.grid import Signals, by_speed, smooth
from adk_ros.calibration.lag import WINDOW_S
from adk_ros.calibration.odometry_calibration import distances
from adk_ros.calibration.regression import regress
from adk_ros.calibration.steering_fit import linear_range
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Design:
    """Columns (n, k), target (n,) and weights (n,) of a relation, in steps of `period_s`."""

    columns: FloatArray
    target: FloatArray
    weights: FloatArray
    period_s: float = PERIOD_S


@dataclass(frozen=True)
class RelationEstimate:
    """
    Coefficients (k,) of a relation with their covariance (k, k), from `seconds` of driving.

    `unexplained`: share of the power of the target that they leave.
    """

    values: FloatArray
    covariance: FloatArray
    seconds: float
    unexplained: float


def smoothed(s: Signals) -> Signals:
    """Return the signals smoothed once more, over `WINDOW_S`, for their derivatives."""

    def each(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else smooth(values, WINDOW_S)

    def axes(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else np.vstack([smooth(x, WINDOW_S) for x in values])

    def held(values: FloatArray | None) -> FloatArray | None:
        # A command is not yet smoothed at all.
        return None if values is None else smooth(smooth(values), WINDOW_S)

    return replace(
        s,
        v_x=each(s.v_x),
        v_y=each(s.v_y),
        yaw_rate=each(s.yaw_rate),
        heading_rate=each(s.heading_rate),
        a=axes(s.a),
        w=axes(s.w),
        torque=held(s.torque),
        steering=held(s.steering),
    )


def relations_of(s: Signals) -> dict[str, RelationEstimate]:
    """Return the relations that a recording has the channels and the length for, by name."""
    block_s = block_length(s)
    out = {}
    for name, design_of in RELATIONS.items():
        design = design_of(s)
        if design is None:
            continue
        fit = regress(
            design.columns,
            design.target,
            design.weights,
            period_s=design.period_s,
            block_s=block_s,
        )
        if fit is not None:
            covariance = np.atleast_2d(np.cov(fit.resampled.T))
            residual = design.target - design.columns @ fit.values
            power = float(design.weights @ design.target**2)
            left = float(design.weights @ residual**2) / max(power, 1e-300)
            out[name] = RelationEstimate(fit.values, covariance, fit.seconds, left)
    return out


def relations_of_both(
    reference: Signals, tested: Signals
) -> tuple[dict[str, RelationEstimate], dict[str, RelationEstimate]]:
    """Return the relations that two recordings share and that measure anything, of each."""
    known, seen = relations_of(reference), relations_of(tested)
    is_fast = min(_linear_share(reference), _linear_share(tested)) < MIN_LINEAR_SHARE
    left_out = {"steering" if is_fast else "fast_steering"}
    # A channel that follows exactly from another is no second sensor: a fault of one would look
    # like a disagreement that no car has.
    left_out |= {
        name
        for both in (known, seen)
        for name in _BETWEEN_SENSORS
        if name in both and both[name].unexplained < MAX_COPY
    }
    names = [name for name in known if name in seen and name not in left_out]
    return {name: known[name] for name in names}, {name: seen[name] for name in names}


_BETWEEN_SENSORS = ("gyro", "a_x", "a_y")
"""Relations of the IMU with odometry; the channels of odometry may follow from each other."""


def _linear_share(s: Signals) -> float:
    """Return the share of the driving in the linear range of the tyres."""
    if s.v_x is None or s.turning is None:
        return 0.0
    return float((linear_range(s, False)).sum() / max(float(s.moving.sum()), 1.0))


def block_length(s: Signals) -> float:
    """Return the length of a bootstrap block, s: shorter where the recording has few of 5 s."""
    return float(np.clip(s.moving_s / USUAL_BLOCKS, MIN_BLOCK_S, BLOCK_S))


def coefficients(s: Signals, name: str) -> FloatArray:
    """Return the coefficients (k,) of one relation, without their covariance."""
    design = RELATIONS[name](s)
    assert design is not None
    weighted = design.columns * design.weights[:, None]
    matrix, vector = weighted.T @ design.columns, weighted.T @ design.target
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    solved = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-10) @ (vector / scale)
    return np.asarray(solved / scale)


def _rate(values: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(values, PERIOD_S))


def _velocity(s: Signals) -> Design | None:
    compared = distances(s, block_length(s))
    return None if compared is None else Design(*compared)


def _of_rate(rate: FloatArray | None, reference: FloatArray | None, s: Signals) -> Design | None:
    """Return a reference on a yaw rate and its derivatives, which take up delay and filter."""
    if rate is None or reference is None or rate is reference:
        return None
    # The rate of a heading is the noisier one, and in the target its noise biases nothing.
    first = _rate(rate)
    columns = np.column_stack([rate, np.ones_like(rate), first, _rate(first)])
    return Design(columns, reference, by_speed(s))


def _gyro(s: Signals) -> Design | None:
    reference = s.heading_rate if s.heading_rate is not None else s.yaw_rate
    return _of_rate(s.gyro, reference, s)


def _yaw_rate(s: Signals) -> Design | None:
    return _of_rate(s.yaw_rate, s.heading_rate, s)


def _of_gyro_axis(s: Signals, axis: int) -> Design | None:
    if s.w is None or s.gyro is None or float(np.ptp(s.w[axis])) == 0.0:
        return None
    columns = np.column_stack([s.gyro, np.ones_like(s.gyro)])
    return Design(columns, s.w[axis], s.moving)


def _of_acceleration(s: Signals, axis: int) -> Design | None:
    """Return a_x or a_y on what odometry implies for it, with columns for lag and lever arm."""
    expected = s.longitudinal if axis == 0 else s.lateral
    if s.a is None or expected is None or s.turning is None or float(np.ptp(s.a[axis])) == 0.0:
        return None
    r = s.turning
    columns = np.column_stack([expected, np.ones_like(r), _rate(expected), r**2, _rate(r)])
    return Design(columns, s.a[axis], s.moving)


def _steering(s: Signals, is_linear: bool) -> Design | None:
    if s.steering is None or s.v_x is None or s.turning is None:
        return None
    r, v_x = s.turning, s.v_x
    rate = _rate(r)
    columns = np.column_stack([r, v_x**2 * r, v_x, v_x * rate, rate])
    weights = linear_range(s) if is_linear else by_speed(s) * (v_x > 0.0)
    return Design(columns, v_x * s.steering, weights)


def _drive(s: Signals) -> Design | None:
    if s.torque is None or s.v_x is None or s.longitudinal is None:
        return None
    driving, braking = np.maximum(s.torque, 0.0), np.minimum(s.torque, 0.0)
    ones = np.ones_like(s.torque)
    columns = [driving, braking, _rate(driving), _rate(braking), s.v_x**2, ones]
    return Design(np.column_stack(columns), s.longitudinal, s.moving)


RELATIONS: dict[str, Callable[[Signals], Design | None]] = {
    "velocity": _velocity,
    "gyro": _gyro,
    "yaw_rate": _yaw_rate,
    "gyro_x": lambda s: _of_gyro_axis(s, 0),
    "gyro_y": lambda s: _of_gyro_axis(s, 1),
    "a_x": lambda s: _of_acceleration(s, 0),
    "a_y": lambda s: _of_acceleration(s, 1),
    "steering": lambda s: _steering(s, True),
    "fast_steering": lambda s: _steering(s, False),
    "drive": _drive,
}
