# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a vehicle can move as a horizon says: bounds of speed, yaw rate and acceleration."""

from __future__ import annotations

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.channels import TICK_NS
from adk_ros.signals.decode import MAX_SPEED, MAX_YAW_RATE

MAX_ACCELERATION = 60.0
"""m/s²; six times gravity, what a Formula 1 car brakes and corners with. By choice."""
_MARGIN = 1.0
"""m/s; noise of the state that the horizon starts from. By choice."""
_TICK_S = TICK_NS * 1e-9


@strict_kernel
def is_drivable(state: FloatArray, horizon: FloatArray) -> bool:
    """
    Return whether `horizon` (h, 3), SI, can follow `state` (3,), one row per tick.

    Speeds and yaw rates are those that the decoder accepts from sensors. In body axes a velocity
    changes by its rotation as well, so the change of speed counts and not that of each component.
    """
    speed = (state[0] * state[0] + state[1] * state[1]) ** 0.5
    for i in range(horizon.shape[0]):
        v_x, v_y = horizon[i, 0], horizon[i, 1]
        ahead = (v_x * v_x + v_y * v_y) ** 0.5
        if not (abs(v_x) <= MAX_SPEED and abs(v_y) <= MAX_SPEED):
            return False
        if not abs(horizon[i, 2]) <= MAX_YAW_RATE:
            return False
        if not abs(ahead - speed) <= MAX_ACCELERATION * _TICK_S * (i + 1) + _MARGIN:
            return False
    return True
