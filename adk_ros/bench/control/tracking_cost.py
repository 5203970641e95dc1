# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of following a path, the same for all controllers and prediction models.

    J = mean over the steps of
        (e_y / 0.1 m)² + (e_psi / w_psi)² + (e_v / w_v)² + (change of delta / w_delta)²
        + (change of torque / w_T)²

e_y, e_psi, e_v: lateral, heading and speed error against the path. Predicted velocities are
integrated to poses by the trapezoidal rule, as in `model.pose_horizon`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import ROAD_SPEED, locate, lookup
from adk_ros.signals.channels import TICK_NS

TICK_S = TICK_NS * 1e-9


class Weights(NamedTuple):
    """
    Error that costs as much as a lateral error of 0.1 m; changes are those from step to step.

    The defaults are of `adk bench control --tune` on the development seed.
    """

    lateral: float = 0.1
    """m"""
    heading: float = 0.1
    """rad"""
    speed: float = 1.0
    """m/s"""
    delta_change: float = 0.02
    """rad"""
    torque_change: float = 600.0
    """N·m"""


class TrackingStart(NamedTuple):
    """Measured `pose` (3,), `velocity` (3,) and arc length `s` at which a horizon begins, SI."""

    pose: FloatArray
    velocity: FloatArray
    s: float


@strict_kernel
def tracking_costs(
    states: FloatArray,
    commands: FloatArray,
    start: TrackingStart,
    table: FloatArray,
    spacing: float,
    w: Weights,
    out: FloatArray,
) -> None:
    """Write the costs (k,) of predicted `states` (k, h, 3) under `commands` (k, h, 2)."""
    steps = states.shape[1]
    for k in range(states.shape[0]):
        x, y, heading = start.pose[0], start.pose[1], start.pose[2]
        v_x, v_y, rate = start.velocity[0], start.velocity[1], start.velocity[2]
        s, cost = start.s, 0.0
        for j in range(steps):
            new_x, new_y, new_rate = states[k, j, 0], states[k, j, 1], states[k, j, 2]
            mean_x, mean_y, turn = (
                0.5 * (v_x + new_x),
                0.5 * (v_y + new_y),
                0.5 * (rate + new_rate),
            )
            middle = heading + 0.5 * turn * TICK_S
            cos, sin = math.cos(middle), math.sin(middle)
            x += TICK_S * (mean_x * cos - mean_y * sin)
            y += TICK_S * (mean_x * sin + mean_y * cos)
            heading += TICK_S * turn
            v_x, v_y, rate = new_x, new_y, new_rate
            s, across, road_heading = locate(table, spacing, s + TICK_S * mean_x, x, y)
            error = heading - road_heading
            error = math.atan2(math.sin(error), math.cos(error))
            e_v = v_x - lookup(table, spacing, s, ROAD_SPEED)
            cost += (across / w.lateral) ** 2 + (error / w.heading) ** 2 + (e_v / w.speed) ** 2
            if j > 0:
                cost += ((commands[k, j, 1] - commands[k, j - 1, 1]) / w.delta_change) ** 2
                cost += ((commands[k, j, 0] - commands[k, j - 1, 0]) / w.torque_change) ** 2
        out[k] = cost / steps
