# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces on the surrogate's body: tyres, air, road grade and bank.

Wheels are quasi-static. The wheel torque less the torque that accelerates the wheels acts on the
road, F_x = (T - I_w dv_x/dt / R) / R. Wheel loads follow a_x and a_y (m h a_x / L between the
axles, m h a_y / track between the sides), the bank (m (g cos(bank) - v_x r sin(bank))), the
downforce and the vertical acceleration of the body. H. B. Pacejka, Tire and Vehicle Dynamics, 3rd
ed. (2012), chapters 1 and 4. `wheel_forces` has the forces of the wheels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.step_constants import StepConstants
from adk_ros.mismatch.surrogate.wheel_forces import (
    LEAST_LOAD,
    WheelInputs,
    summed_wheel_forces,
    wheel_forces,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import inlined_kernel

_MASS = INDEX["mass"]
_INERTIA = INDEX["yaw_inertia"]
_L_F = INDEX["cg_to_front_axle"]
_L_R = INDEX["cg_to_rear_axle"]
_HEIGHT = INDEX["cg_height"]
_RADIUS = INDEX["wheel_radius"]
_WHEEL_INERTIA = INDEX["wheel_inertia"]
_SIDE_AREA = INDEX["side_force_area"]
_YAW_VOLUME = INDEX["yaw_moment_volume"]
_ROLL_ARM = INDEX["roll_arm"]
_DRAG = INDEX["drag_area"]
_LIFT = INDEX["lift_area"]
_REAR_STEER = INDEX["rear_steer"]
_DRIVE_YAW_MOMENT = INDEX["drive_yaw_moment"]
_WIND_X = INDEX["wind_x"]
_WIND_Y = INDEX["wind_y"]
_EXTRA_X = INDEX["extra_x"]
_EXTRA_Y = INDEX["extra_y"]
_EXTRA_YAW = INDEX["extra_yaw"]


class BodyMotion(NamedTuple):
    """
    Motion and inputs of the body at one instant, SI.

    `load_x`, `load_y`: specific forces that the wheel loads follow, m/s^2; `roll_rate`: rad/s;
    `vertical_acceleration`: of the body, upward, m/s^2.
    """

    v_x: float
    v_y: float
    yaw_rate: float
    delta: float
    torque: float
    load_x: float
    load_y: float
    roll_rate: float
    vertical_acceleration: float


@inlined_kernel
def body_forces(
    p: FloatArray,
    constants: StepConstants,
    motion: BodyMotion,
    wheels: FloatArray,
    build_up: float,
) -> tuple[float, float, float]:
    """
    Return (a_x, a_y, yaw acceleration): specific force at the centre of gravity, SI.

    `wheels`: wheel table with the constants of `p`, which receives the wheels' forces; of its slip
    angles after relaxation, the share `build_up` still counts.
    """
    v_x, v_y, yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    mass, radius, wheelbase = p[_MASS], p[_RADIUS], p[_L_F] + p[_L_R]
    w_x, w_y = v_x - p[_WIND_X], p[_WIND_Y] - v_y
    pressure = 0.5 * AIR_DENSITY * math.sqrt(w_x * w_x + w_y * w_y)
    weight = mass * (
        constants.normal + motion.vertical_acceleration - v_x * yaw_rate * constants.sin_bank
    )
    down = pressure * p[_LIFT] * w_x
    along = mass * p[_HEIGHT] * motion.load_x / wheelbase
    spin = p[_WHEEL_INERTIA] / (radius * radius)
    # Acceleration of the wheels' spin without a_x itself, which is solved for below.
    kinematic = yaw_rate * v_y - GRAVITY * constants.sin_grade
    # Keeps the tyre equations defined when an axle lifts.
    least = 2.0 * wheels[LEAST_LOAD]
    wheel_inputs = WheelInputs(
        v_x,
        v_y + motion.roll_rate * p[_ROLL_ARM],
        yaw_rate,
        max(weight * p[_L_R] / wheelbase - along + 0.5 * down, least),
        max(weight * p[_L_F] / wheelbase + along + 0.5 * down, least),
        motion.load_y,
        motion.delta,
        p[_REAR_STEER] * motion.delta,
        motion.torque,
        spin * (motion.load_x + kinematic),
    )
    wheel_forces(wheels, p, wheel_inputs, build_up)
    f_x, f_y, m_z = summed_wheel_forces(wheels)
    f_x -= pressure * p[_DRAG] * w_x
    f_y += pressure * p[_SIDE_AREA] * w_y
    m_z += pressure * p[_YAW_VOLUME] * w_y + p[_DRIVE_YAW_MOMENT] * max(motion.torque, 0.0)
    a_x = (f_x - spin * kinematic) / (mass + spin) + p[_EXTRA_X]
    a_y = f_y / mass + p[_EXTRA_Y]
    return a_x, a_y, m_z / p[_INERTIA] + p[_EXTRA_YAW]
