# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Vehicle simulator of another family: brush tyres, sprung roll, second-order steering gear.

Its name in case labels (key `plant`) and in `injected_drive.PLANTS` is `spring_car`.

It shares no equation of tyre, steering or load transfer with the package's plants or with the
surrogate model of `adk mismatch`. The lateral force of a tyre is that of the brush model with
parabolic pressure,

    F_y = K u - (K u)|K u| / (3 D) + (K u)^3 / (27 D^2)   while |K u| < 3 D, then D sign(u),

where u is the lagged slip tan(alpha), K the slip stiffness and D the grip left by the longitudinal
force. Lateral load transfer follows springs and dampers in roll, longitudinal load transfer a
first-order lag; wheel spins are kinematic. Body axes and signs as in `plant.vehicle.seven_dof`.
"""

from __future__ import annotations

import math

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.seven_dof import HEADING, V_X, V_Y, YAW_RATE, X, Y
from adk_ros.plant.vehicle.vehicle_parameters import Constants

SLIP = 3
ROLL, ROLL_RATE, PITCH_LOAD = 7, 8, 9
GEAR, GEAR_RATE, TORQUE = 10, 11, 12
STATE_SIZE = 22
"""State index: four slips from SLIP on, one per wheel. ROLL is expressed as the lateral
acceleration that causes it in steady state, m/s²."""

_ROLL_FREQUENCY, _ROLL_DAMPING = 9.5, 0.45
"""Natural frequency, rad/s, and damping ratio of body roll: 1.5 Hz, as of a passenger car."""
_GEAR_FREQUENCY, _GEAR_DAMPING = 42.0, 0.8
"""Natural frequency, rad/s, and damping ratio of the steering gear: 6.7 Hz, a fast actuator."""
_FRONT_TORQUE = 0.35
"""Front axle's share of the torque: unlike the even split of the other plants."""


@strict_kernel
def brush(slip: float, stiffness: float, grip: float) -> float:
    """Return the brush tyre's lateral force, N, at slip tan(alpha)."""
    sliding = min(abs(stiffness * slip) / (3.0 * grip), 1.0)
    return math.copysign(grip * sliding * (3.0 - 3.0 * sliding + sliding * sliding), slip)


@strict_kernel
def step_sprung_car(
    c: Constants,
    state: FloatArray,
    command: FloatArray,
    road: tuple[float, float, float],
    wind: tuple[float, float],
    lift_area: float,
    rear_steer: float,
    step: float,
) -> tuple[float, float]:
    """
    Advance `state` in place by one explicit Euler step; return the specific force (a_x, a_y).

    `road` = (friction, grade, bank); `wind` along map x and y, m/s; `lift_area` in m², downforce
    positive; `rear_steer` is the ratio of the rear to the front wheel angle.
    """
    v_x, v_y, rate = state[V_X], state[V_Y], state[YAW_RATE]
    mu, grade, bank = road
    cos_h, sin_h = math.cos(state[HEADING]), math.sin(state[HEADING])
    air_x = v_x - wind[0] * cos_h - wind[1] * sin_h
    air_y = -wind[0] * sin_h + wind[1] * cos_h - v_y
    pressure = 0.5 * AIR_DENSITY * math.hypot(air_x, air_y)
    length = c.cg_to_front_axle + c.cg_to_rear_axle
    weight = c.mass * (GRAVITY * math.cos(grade) * math.cos(bank) - v_x * rate * math.sin(bank))
    down = pressure * lift_area * air_x
    along = c.mass * c.cg_height * state[PITCH_LOAD] / length
    roll_a_y = state[ROLL] + 2.0 * _ROLL_DAMPING / _ROLL_FREQUENCY * state[ROLL_RATE]
    across = c.mass * c.cg_height * roll_a_y / c.track_width
    spin = c.wheel_inertia / (c.wheel_radius * c.wheel_radius)
    f_x = -pressure * c.cda * air_x
    f_y = pressure * c.side_force_area * air_y
    m_z = pressure * c.yaw_moment_volume * air_y
    for i in range(4):
        front = i < 2
        side = 1.0 if i % 2 == 0 else -1.0
        x = c.cg_to_front_axle if front else -c.cg_to_rear_axle
        y = 0.5 * side * c.track_width
        axle = weight * (length - abs(x)) / length + (-along if front else along) + 0.5 * down
        share = c.roll_share_front if front else 1.0 - c.roll_share_front
        load = max(0.5 * axle - side * share * across, 50.0)
        angle = state[GEAR] * (1.0 if front else rear_steer)
        cos, sin = math.cos(angle), math.sin(angle)
        hub_x, hub_y = v_x - rate * y, v_y + rate * x
        rolling = max(hub_x * cos + hub_y * sin, 2.0)
        slip = -(hub_y * cos - hub_x * sin) / rolling
        relaxation = c.relaxation_length_f if front else c.relaxation_length_r
        state[SLIP + i] += min(rolling / max(relaxation, 1e-6) * step, 1.0) * (
            slip - state[SLIP + i]
        )
        nominal = c.nominal_load_f if front else c.nominal_load_r
        loss = c.load_sensitivity_f if front else c.load_sensitivity_r
        loss = max(1.0 - loss * (load / nominal - 1.0), 0.2)
        peak = mu * (c.mu_f if front else c.mu_r) * loss * load
        b, shape = (c.b_y_f, c.c_y_f) if front else (c.b_y_r, c.c_y_r)
        stiffness = b * shape * (c.mu_f if front else c.mu_r) * loss * load
        torque = 0.5 * (_FRONT_TORQUE if front else 1.0 - _FRONT_TORQUE) * state[TORQUE]
        drive = torque / c.wheel_radius - c.crr * load
        drive = min(max(drive, -0.98 * peak), 0.98 * peak)
        grip = math.sqrt(max(peak * peak - drive * drive, 0.01 * peak * peak))
        lateral = brush(state[SLIP + i], stiffness, grip)
        b_x, b_y = drive * cos - lateral * sin, drive * sin + lateral * cos
        f_x += b_x
        f_y += b_y
        m_z += x * b_y - y * b_x
    # Kinematic wheel spins add their inertia: m a_x = F_x - 4 I / R^2 dv_x/dt.
    inertial = rate * v_y - GRAVITY * math.sin(grade)
    a_x, a_y = (f_x - 4.0 * spin * inertial) / (c.mass + 4.0 * spin), f_y / c.mass
    state[V_X] += step * (a_x + rate * v_y - GRAVITY * math.sin(grade))
    state[V_Y] += step * (a_y - rate * v_x - GRAVITY * math.sin(bank))
    state[YAW_RATE] += step * m_z / c.yaw_inertia
    state[X] += step * (v_x * cos_h - v_y * sin_h)
    state[Y] += step * (v_x * sin_h + v_y * cos_h)
    state[HEADING] += step * rate
    free = _ROLL_FREQUENCY
    state[ROLL_RATE] += (
        step * free * (free * (a_y - state[ROLL]) - 2.0 * _ROLL_DAMPING * state[ROLL_RATE])
    )
    state[ROLL] += step * state[ROLL_RATE]
    state[PITCH_LOAD] += step / max(c.load_lag, step) * (a_x - state[PITCH_LOAD])
    free = _GEAR_FREQUENCY
    target = min(max(command[1], -c.max_steer), c.max_steer)
    state[GEAR_RATE] += (
        step * free * (free * (target - state[GEAR]) - 2.0 * _GEAR_DAMPING * state[GEAR_RATE])
    )
    state[GEAR] += step * state[GEAR_RATE]
    target = min(max(command[0], -c.max_brake_torque), c.max_drive_torque)
    state[TORQUE] += step / max(c.torque_lag, step) * (target - state[TORQUE])
    return a_x, a_y
