# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Limits of predicted motion, from what the training data and tyres on a dry road can do.

Far from its training data a model may feed its own error back: the yaw rate doubles with each
step, until nothing bounds it but the clamp of `compiled_rollout`. Such a prediction is worse than
that the state does not change. So no step changes a state by more than a vehicle can, and the yaw
rate does not raise the lateral acceleration above what the vehicle can reach.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import inlined_kernel
from adk_ros.signals.channels import TICK_NS, Record

N_LIMITS = 4
"""Limits of dv_x/dt, dv_y/dt (m/s²), dr/dt (rad/s²) and |v_x r| (m/s²)."""
_MARGIN = 2.0
"""Limit over the 99.9th percentile of the training data: tyres or load may change. By choice."""
_DRY_ROAD = np.array([12.0, 12.0, 9.0, 12.0])
"""
What every model may predict: 1.2 g is the grip of a road tyre on a dry road; one axle at that grip
turns a car, whose radius of gyration is close to the distances of its axles, with 9 rad/s².
"""
_UNLIMITED = 1e9
"""A limit that no state reaches, m/s² or rad/s²; finite, as the kernels require."""
MIN_LIMITED_SPEED = 0.5
"""m/s; below, the limit of the lateral acceleration is that of this speed."""


def motion_limits(records: Sequence[Record]) -> FloatArray:
    """Return the limits (4,), as `N_LIMITS` lists them, of a model trained on `records`."""
    reached = [_reached(record) for record in records]
    values = np.concatenate(reached) if reached else np.zeros((0, N_LIMITS))
    if not len(values):
        return np.array(_DRY_ROAD)
    return np.asarray(np.maximum(_MARGIN * np.percentile(values, 99.9, axis=0), _DRY_ROAD))


def _reached(record: Record) -> FloatArray:
    """Return the absolute values of the limited quantities at each learnable tick (n, 4)."""
    x = record.x_ref
    change = np.diff(x, axis=0) / (TICK_NS * 1e-9)
    values = np.abs(np.column_stack([change, x[1:, 0] * x[1:, 2]]))
    known = record.learnable[1:] & (np.diff(record.episode) == 0) & np.isfinite(values).all(axis=1)
    return np.asarray(values[known])


def step_bounds(limits: FloatArray, scaling: Scaling) -> FloatArray:
    """
    Return the bounds (4, 3) of a step of a rollout.

    Rows: largest change of each scaled state in a tick; mean and scale of the states; largest
    lateral acceleration, m/s², in the first column. Without `limits` (0,) no state reaches them.
    """
    if not len(limits):
        limits = np.full(N_LIMITS, _UNLIMITED)
    change = limits[:3] * (TICK_NS * 1e-9) / scaling.x_scale
    return np.ascontiguousarray([change, scaling.x_mean, scaling.x_scale, [limits[3], 0.0, 0.0]])


@inlined_kernel
def limited_state(
    before: tuple[float, float, float], x: tuple[float, float, float], bounds: FloatArray
) -> tuple[float, float, float]:
    """
    Return the scaled state `x` that follows `before`, limited by `bounds` of `step_bounds`.

    A lateral acceleration that is above its limit already is not raised. NaN stays NaN.
    """
    v_x = min(max(x[0], before[0] - bounds[0, 0]), before[0] + bounds[0, 0])
    v_y = min(max(x[1], before[1] - bounds[0, 1]), before[1] + bounds[0, 1])
    yaw_rate = min(max(x[2], before[2] - bounds[0, 2]), before[2] + bounds[0, 2])
    speed = max(abs(v_x * bounds[2, 0] + bounds[1, 0]), MIN_LIMITED_SPEED)
    speed_before = max(abs(before[0] * bounds[2, 0] + bounds[1, 0]), MIN_LIMITED_SPEED)
    rate_before = abs(before[2] * bounds[2, 2] + bounds[1, 2])
    largest = max(bounds[3, 0], speed_before * rate_before) / speed
    rate = yaw_rate * bounds[2, 2] + bounds[1, 2]
    limit = ((largest if rate > 0.0 else -largest) - bounds[1, 2]) / bounds[2, 2]
    return v_x, v_y, limit if abs(rate) > largest else yaw_rate


@inlined_kernel
def limit_step(before: tuple[float, float, float], x: FloatArray, bounds: FloatArray) -> None:
    """Run `limited_state` on `x` (3,) in place."""
    x[0], x[1], x[2] = limited_state(before, (x[0], x[1], x[2]), bounds)
