# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Injected changes of actuators, forces and air, and their effect in one integration step.

They act between the recorded commands and the vehicle, for every simulator in the same way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.injection.unlisted_changes import (
    BACKLASH,
    DELTA,
    LAST_TORQUE,
    TORQUE,
    Motion,
    UnlistedChanges,
)
from adk_ros.plant.injection.unlisted_motion import added_accelerations, road_wheel_angle
from adk_ros.plant.injection.unlisted_torque import wheel_torque
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.vehicle_parameters import Constants

STEPS_PER_COMMAND = 25
"""Integration steps of 1 ms between commands."""


class InjectedChanges(NamedTuple):
    """Injected changes, active from `onset`, s; the defaults change nothing. SI, delays in ms."""

    onset: float = 0.0
    torque_gain: float = 1.0
    brake_gain: float = 1.0
    torque_offset: float = 0.0
    torque_delay_ms: int = 0
    torque_lag: float = 0.0
    power: float = 1e12
    steer_gain: float = 1.0
    steer_offset: float = 0.0
    steer_delay_ms: int = 0
    steer_lag: float = 0.0
    half_backlash: float = 0.0
    """Half of the steering backlash, rad at the road wheels."""
    compliance: float = 0.0
    one_side_brake_torque: float = 0.0
    """Torque of dragging brakes, N·m per wheel; left side positive, right side negative."""
    wind_x: float = 0.0
    wind_y: float = 0.0
    wind_from: float = -1.0
    """The crosswind acts between these arc lengths of the lap, m; negative: everywhere."""
    wind_to: float = -1.0
    lift_area: float = 0.0
    """Lift area, m²; sprung car only, like `rear_steer`."""
    rear_steer: float = 0.0
    unlisted: UnlistedChanges = UnlistedChanges()


class Action(NamedTuple):
    """Torque (N·m) and road-wheel angle (rad), added accelerations, and wind along x and y."""

    torque: float
    delta: float
    added_x: float
    added_y: float
    added_yaw: float
    wind_x: float
    wind_y: float


@strict_kernel
def start_memory(memory: FloatArray, torque: float, delta: float) -> None:
    """Set the memory of the actuators to the first command."""
    memory[:] = 0.0
    memory[BACKLASH] = memory[DELTA] = delta
    memory[TORQUE] = memory[LAST_TORQUE] = torque


@strict_kernel
def act(
    c: Constants,
    h: InjectedChanges,
    motion: Motion,
    commands: FloatArray,
    n: int,
    memory: FloatArray,
) -> Action:
    """Return what acts on the vehicle in step `n`; `commands` (m, 2) are those until now."""
    active = n * STEP >= h.onset
    row = n // STEPS_PER_COMMAND
    torque_row = max(n - h.torque_delay_ms, 0) // STEPS_PER_COMMAND if active else row
    delta_row = max(n - h.steer_delay_ms, 0) // STEPS_PER_COMMAND if active else row
    torque, delta = commands[torque_row, 0], commands[delta_row, 1]
    if active:
        torque *= h.torque_gain * (h.brake_gain if torque < 0.0 else 1.0)
        delta *= h.steer_gain
        gap = h.half_backlash
        memory[BACKLASH] = min(max(memory[BACKLASH], delta - gap), delta + gap)
        delta = memory[BACKLASH]
    keep = math.exp(-STEP / h.steer_lag) if active and h.steer_lag > 0.0 else 0.0
    memory[DELTA] = delta + (memory[DELTA] - delta) * keep
    keep = math.exp(-STEP / h.torque_lag) if active and h.torque_lag > 0.0 else 0.0
    memory[TORQUE] = torque + (memory[TORQUE] - torque) * keep
    torque, delta = memory[TORQUE], memory[DELTA]
    if not active:
        return Action(torque, delta, 0.0, 0.0, 0.0, 0.0, 0.0)
    added_x, added_y, added_yaw = added_accelerations(
        c, h.unlisted, motion, (torque, delta, commands[row, 0]), memory
    )
    drag = h.one_side_brake_torque / c.wheel_radius
    added_x -= 2.0 * abs(drag) / c.mass
    added_yaw += drag * c.track_width / c.yaw_inertia
    torque = min(torque + h.torque_offset, h.power * c.wheel_radius / max(motion.v_x, 1.0))
    torque = wheel_torque(c, h.unlisted, motion, torque, memory)
    delta = road_wheel_angle(h.unlisted, motion, delta)
    delta += h.steer_offset - h.compliance * motion.a_y
    in_wind = h.wind_from < 0.0 or h.wind_from <= motion.distance % motion.lap <= h.wind_to
    crosswind = h.wind_y if in_wind else 0.0
    cos, sin = math.cos(motion.heading), math.sin(motion.heading)
    return Action(
        torque,
        delta,
        added_x,
        added_y,
        added_yaw,
        h.wind_x * cos - crosswind * sin,
        h.wind_x * sin + crosswind * cos,
    )
