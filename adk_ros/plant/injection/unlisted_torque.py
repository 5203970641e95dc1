# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Unlisted changes of driveline and brakes: the torque that reaches the wheels."""

from __future__ import annotations

import math

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.injection import unlisted_changes as constants
from adk_ros.plant.injection.unlisted_changes import (
    FRICTION,
    HEAT,
    LAST_TORQUE,
    WHEEL_ANGLE,
    Motion,
    UnlistedChanges,
)
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.vehicle_parameters import Constants


@strict_kernel
def wheel_torque(
    c: Constants, u: UnlistedChanges, motion: Motion, torque: float, memory: FloatArray
) -> float:
    """Return the torque at the wheels, N·m, for one at the driveline; updates `memory`."""
    if torque > 0.0:
        torque *= _drive_share(u, motion)
    elif torque < 0.0:
        torque *= _brake_share(c, u, motion, torque, memory)
    memory[HEAT] -= STEP / constants.FADE_COOLING_S * memory[HEAT]
    torque *= 1.0 + u.torque_ripple * math.sin(2.0 * math.pi * constants.RIPPLE_HZ * motion.time_s)
    # Dahl's friction: z' = T' / travel (1 - z sign(T')).
    change = (torque - memory[LAST_TORQUE]) / constants.FRICTION_TORQUE_TRAVEL
    memory[LAST_TORQUE] = torque
    grown = memory[FRICTION] + change - abs(change) * memory[FRICTION]
    memory[FRICTION] = min(max(grown, -1.0), 1.0)
    return float(torque - u.torque_hysteresis * memory[FRICTION])


@strict_kernel
def _drive_share(u: UnlistedChanges, motion: Motion) -> float:
    """Return the share of the drive torque that reaches the wheels."""
    share = 1.0
    if abs(motion.a_y) > constants.TORQUE_CUT_FROM:
        share *= 1.0 - u.torque_cut
    over = (motion.v_x - constants.LIMITED_FROM) / constants.LIMITED_OVER
    share *= 1.0 - u.speed_limiter * min(max(over, 0.0), 1.0)
    if motion.v_x < constants.LOW_GEAR_BELOW:
        share *= 1.0 + u.low_gear_gain
    return share * (1.0 - u.battery_sag * (1.0 - math.exp(-motion.time_s / constants.SAG_S)))


@strict_kernel
def _brake_share(
    c: Constants, u: UnlistedChanges, motion: Motion, torque: float, memory: FloatArray
) -> float:
    """Return the share of the brake torque that reaches the wheels; heats the brakes."""
    specific_force = -torque / (c.wheel_radius * c.mass)
    memory[HEAT] += STEP * specific_force * motion.v_x / constants.FADE_ENERGY
    share = 1.0 - u.brake_fade * (1.0 - math.exp(-memory[HEAT]))
    share *= 1.0 + u.brake_judder * math.sin(memory[WHEEL_ANGLE])
    turns = constants.RELEASE_HZ * motion.time_s
    if specific_force > constants.RELEASE_FROM and turns - math.floor(turns) < 0.5:
        share *= 1.0 - u.abs_release
    return share
