# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Unlisted changes of steering, tyres, wind and load: a steering angle, and accelerations."""

from __future__ import annotations

import math

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.injection import unlisted_changes as constants
from adk_ros.plant.injection.unlisted_changes import (
    LOAD_SPEED,
    LOAD_Y,
    SWAY_SPEED,
    SWAY_Y,
    WHEEL_ANGLE,
    Motion,
    UnlistedChanges,
)
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.vehicle_parameters import Constants

Accelerations = tuple[float, float, float]
"""Longitudinal, lateral and yaw acceleration, m/s² and rad/s²."""


@strict_kernel
def road_wheel_angle(u: UnlistedChanges, motion: Motion, delta: float) -> float:
    """Return the road-wheel angle, rad, for one that the steering gives."""
    return delta * (1.0 - u.variable_steering_ratio * motion.v_x / constants.RATIO_SPEED)


@strict_kernel
def added_accelerations(
    c: Constants,
    u: UnlistedChanges,
    motion: Motion,
    command: tuple[float, float, float],
    memory: FloatArray,
) -> Accelerations:
    """
    Return the accelerations that the changes add; updates `memory`.

    `command`: torque and steering angle after the actuators, and the torque as commanded.
    """
    torque, delta, commanded = command
    x_f, y_f, yaw_f = _of_the_state(u, motion, torque, delta, commanded)
    x_t, y_t, yaw_t = _of_time_and_distance(c, u, motion, delta, memory)
    y_l, yaw_l = _of_moving_loads(c, u, motion.a_y + y_f + y_t, memory)
    return x_f + x_t, y_f + y_t + y_l, yaw_f + yaw_t + yaw_l


@strict_kernel
def _of_the_state(
    u: UnlistedChanges, motion: Motion, torque: float, delta: float, commanded: float
) -> Accelerations:
    """Return the accelerations that depend on the signals of the moment."""
    rate, speed = motion.yaw_rate, max(motion.v_x, 1.0)
    locking = u.locked_differential + u.torque_locking_differential * abs(torque)
    yaw = -locking * rate / speed
    yaw += u.shimmy * math.sin(1.5 * motion.v_x)
    yaw -= u.yaw_damping * rate
    yaw += u.torque_vectoring * torque * delta
    yaw += u.brake_pull * min(torque, 0.0)
    yaw -= u.yaw_limiter * math.copysign(max(abs(rate) - constants.YAW_LIMIT, 0.0), rate)
    along = -u.scrub_drag * motion.a_y * motion.a_y - u.steering_drag * abs(delta)
    if commanded < 0.0:
        along -= u.engine_braking
    return along, u.torque_steer * commanded, yaw


@strict_kernel
def _of_time_and_distance(
    c: Constants, u: UnlistedChanges, motion: Motion, delta: float, memory: FloatArray
) -> Accelerations:
    """Return the accelerations that depend on the time, the lap or the angle of the wheels."""
    t, speed = motion.time_s, max(motion.v_x, 1.0)
    memory[WHEEL_ANGLE] += STEP * motion.v_x / c.wheel_radius
    along = u.wheel_imbalance * (motion.v_x / 20.0) ** 2 * math.sin(memory[WHEEL_ANGLE])
    along -= u.warming_tyres * GRAVITY * math.exp(-t / constants.WARMING_S)
    along -= u.phantom_braking * _episode(t, constants.TOUCH_S)
    interval = math.floor(t / constants.EPISODE_EVERY_S)
    side = 1.0 if math.sin(2.4 * interval + 1.0) > 0.0 else -1.0
    across = side * u.gust_series * _episode(t, constants.GUST_S)
    yaw = constants.GUST_YAW * across
    yaw += u.lap_periodic_yaw * math.sin(
        2.0 * math.pi * constants.LAP_WAVES * motion.distance / motion.lap
    )
    if motion.v_x > constants.PERIODIC_YAW_FROM:
        yaw += u.time_periodic_yaw * math.cos(2.0 * math.pi * constants.PERIODIC_YAW_HZ * t)
    # Linear force of the front axle, C (delta - (v_y + l_f r) / v_x), of which a share is lost.
    lost = u.fading_front_tyre * (1.0 - math.exp(-t / constants.FADING_S))
    load = c.mass * GRAVITY * c.cg_to_rear_axle / (c.cg_to_front_axle + c.cg_to_rear_axle)
    slip = delta - (motion.v_y + c.cg_to_front_axle * motion.yaw_rate) / speed
    force = lost * c.b_y_f * c.c_y_f * c.mu_f * load * slip
    return along, across - force / c.mass, yaw - c.cg_to_front_axle * force / c.yaw_inertia


@strict_kernel
def _episode(time_s: float, duration_s: float) -> float:
    """
    Return the course of an episode, 0 to 1: one raised cosine in every interval.

    Its begin is spread evenly by the golden section.
    """
    interval = math.floor(time_s / constants.EPISODE_EVERY_S)
    share = 0.618034 * (interval + 1.0)
    begin = interval * constants.EPISODE_EVERY_S
    begin += constants.EPISODE_WITHIN_S * (share - math.floor(share))
    phase = (time_s - begin) / duration_s
    return 0.5 - 0.5 * math.cos(2.0 * math.pi * phase) if 0.0 < phase < 1.0 else 0.0


@strict_kernel
def _of_moving_loads(
    c: Constants, u: UnlistedChanges, a_y: float, memory: FloatArray
) -> tuple[float, float]:
    """Return lateral and yaw acceleration by a sloshing load and by a trailer."""
    omega = 2.0 * math.pi * constants.SLOSH_FREQUENCY_HZ
    load = omega * omega * memory[LOAD_Y]
    load += 2.0 * constants.SLOSH_DAMPING * omega * memory[LOAD_SPEED]
    across = -u.sloshing_load * load
    memory[LOAD_SPEED] += STEP * (a_y + across - load)
    memory[LOAD_Y] += STEP * memory[LOAD_SPEED]
    omega = 2.0 * math.pi * constants.SWAY_HZ
    pull = omega * omega * memory[SWAY_Y]
    pull += 2.0 * constants.SWAY_DAMPING * omega * memory[SWAY_SPEED]
    memory[SWAY_SPEED] += STEP * (a_y + across - pull)
    memory[SWAY_Y] += STEP * memory[SWAY_SPEED]
    force = u.trailer_sway * c.mass * pull
    return across - force / c.mass, constants.HITCH * force / c.yaw_inertia
