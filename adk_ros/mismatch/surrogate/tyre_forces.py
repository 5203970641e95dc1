# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces on the surrogate's body: tyres, air, road grade and bank.

Wheels are quasi-static. The wheel torque less the torque that accelerates the wheels acts on the
road, F_x = (T - I_w dv_x/dt / R) / R. The lateral force is limited by the friction circle:

    F_y = D sin(C atan(B a - E (B a - atan B a))) sqrt(1 - c (F_x / D)^2)

with slip angle a, D = mu F_z, B = K / (C D), and the slip stiffness K, which friction does not
change. Wheel loads follow a_x and a_y (m h a_x / L between the axles, m h a_y / track between the
sides), the bank (m (g cos(bank) - v_x r sin(bank))), the downforce and the vertical acceleration
of the body. H. B. Pacejka, Tire and Vehicle Dynamics, 3rd ed. (2012), chapters 1 and 4.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import relaxed_kernel

MIN_LATERAL_UTILISATION = 0.15
"""Share of the lateral grip that a wheel keeps under any longitudinal force."""
MIN_FRICTION = 0.02
"""Least road friction: several active terms at one place may sum to less than zero."""
MIN_SPEED = 1.0
"""Least longitudinal speed in slip angles, m/s: they are undefined at standstill."""
MIN_AXLE_LOAD = 100.0
"""Least load of an axle, N: keeps the tyre equations defined when an axle lifts."""
MIN_WHEEL_LOAD = 50.0
"""Least load of a wheel, N."""
MIN_LOAD_FACTOR = 0.2
"""Least factor of grip and of stiffness by load sensitivity, which is linear in the load."""

_MASS = INDEX["mass"]
_INERTIA = INDEX["yaw_inertia"]
_L_F = INDEX["cg_to_front_axle"]
_L_R = INDEX["cg_to_rear_axle"]
_TRACK = INDEX["track_width"]
_HEIGHT = INDEX["cg_height"]
_RADIUS = INDEX["wheel_radius"]
_WHEEL_INERTIA = INDEX["wheel_inertia"]
_SIDE_AREA = INDEX["side_force_area"]
_YAW_VOLUME = INDEX["yaw_moment_volume"]
_K_F = INDEX["stiffness_f"]
_K_R = INDEX["stiffness_r"]
_C_F = INDEX["shape_f"]
_C_R = INDEX["shape_r"]
_E_F = INDEX["curvature_f"]
_E_R = INDEX["curvature_r"]
_MU_F = INDEX["grip_f"]
_MU_R = INDEX["grip_r"]
_SENSITIVITY = INDEX["load_sensitivity"]
_FALLOFF = INDEX["stiffness_falloff"]
_COMBINED = INDEX["combined_slip"]
_BRUSH = INDEX["brush_share"]
_ROLL_SHARE = INDEX["roll_share_front"]
_ROLL_ARM = INDEX["roll_arm"]
_SPLIT = INDEX["torque_split_front"]
_DRAG = INDEX["drag_area"]
_LIFT = INDEX["lift_area"]
_ROLLING_RESISTANCE = INDEX["rolling"]
_REAR_STEER = INDEX["rear_steer"]
_SIDE_DRAG = INDEX["side_drag"]
_GRADE = INDEX["grade"]
_BANK = INDEX["bank"]
_FRICTION = INDEX["friction"]
_WIND_X = INDEX["wind_x"]
_WIND_Y = INDEX["wind_y"]
_EXTRA_X = INDEX["extra_x"]
_EXTRA_Y = INDEX["extra_y"]
_EXTRA_YAW = INDEX["extra_yaw"]


@relaxed_kernel
def normalised_lateral_force(slip: float, shape: float, curvature: float, brush: float) -> float:
    """
    Return the lateral force over the peak force at normalised slip s = B tan(alpha).

    Blends the Magic Formula, sin(C atan(s - E (s - atan s))), with a share `brush` of the brush
    model, 3 z - 3 z^2 + z^3 with z = C |s| / 3 (1 beyond z = 1). Both have the initial slope C.
    """
    share = math.sin(shape * math.atan(slip - curvature * (slip - math.atan(slip))))
    if brush != 0.0:
        z = min(shape * abs(slip) / 3.0, 1.0)
        share += brush * (math.copysign(z * (3.0 - 3.0 * z + z * z), slip) - share)
    return share


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


@relaxed_kernel
def body_forces(
    p: FloatArray, motion: BodyMotion, slips: FloatArray, build_up: float, targets: FloatArray
) -> tuple[float, float, float]:
    """
    Return (a_x, a_y, yaw acceleration): specific force at the centre of gravity, SI.

    `slips` (4,): slip angles after relaxation, of which the share `build_up` still counts;
    `targets` (4,) receives the steady-state slip angles.
    """
    v_x, v_y, yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    delta, torque = motion.delta, motion.torque
    load_x, load_y = motion.load_x, motion.load_y
    mass, radius, wheelbase = p[_MASS], p[_RADIUS], p[_L_F] + p[_L_R]
    speed = max(v_x, MIN_SPEED)
    w_x, w_y = v_x - p[_WIND_X], p[_WIND_Y] - v_y
    air = math.hypot(w_x, w_y)
    pressure = 0.5 * AIR_DENSITY * air
    sin_grade, sin_bank = math.sin(p[_GRADE]), math.sin(p[_BANK])
    normal = GRAVITY * math.cos(p[_GRADE]) * math.cos(p[_BANK])
    weight = mass * (normal + motion.vertical_acceleration - v_x * yaw_rate * sin_bank)
    down = pressure * p[_LIFT] * w_x
    along = mass * p[_HEIGHT] * load_x / wheelbase
    front = max(weight * p[_L_R] / wheelbase - along + 0.5 * down, MIN_AXLE_LOAD)
    rear = max(weight * p[_L_F] / wheelbase + along + 0.5 * down, MIN_AXLE_LOAD)
    across = mass * p[_HEIGHT] * load_y / p[_TRACK]
    nominal = 0.25 * mass * GRAVITY
    f_x = -pressure * p[_DRAG] * w_x
    f_y = pressure * p[_SIDE_AREA] * w_y
    m_z = pressure * p[_YAW_VOLUME] * w_y
    spin = p[_WHEEL_INERTIA] / (radius * radius)
    # Acceleration of the wheels' spin without a_x itself, which is solved for below.
    kinematic = yaw_rate * v_y - GRAVITY * sin_grade
    inertial = spin * (load_x + kinematic)
    cos_f, sin_f = math.cos(delta), math.sin(delta)
    rear_angle = p[_REAR_STEER] * delta
    cos_r, sin_r = 1.0, 0.0
    if rear_angle != 0.0:
        cos_r, sin_r = math.cos(rear_angle), math.sin(rear_angle)
    for i in range(4):
        is_front = i < 2
        side = 1.0 if i % 2 == 0 else -1.0
        axle = front if is_front else rear
        share = p[_ROLL_SHARE] if is_front else 1.0 - p[_ROLL_SHARE]
        load = max(0.5 * axle - side * share * across, MIN_WHEEL_LOAD)
        x = p[_L_F] if is_front else -p[_L_R]
        y = 0.5 * side * p[_TRACK]
        angle = delta if is_front else rear_angle
        cos, sin = (cos_f, sin_f) if is_front else (cos_r, sin_r)
        hub_x = max(speed - yaw_rate * y, MIN_SPEED)
        hub_y = v_y + yaw_rate * x + motion.roll_rate * p[_ROLL_ARM]
        targets[i] = angle - math.atan(hub_y / hub_x)
        slip = targets[i] + (slips[i] - targets[i]) * build_up
        excess = load / nominal - 1.0
        grip = (p[_MU_F] if is_front else p[_MU_R]) * max(
            1.0 - p[_SENSITIVITY] * excess, MIN_LOAD_FACTOR
        )
        peak = grip * max(p[_FRICTION], MIN_FRICTION) * load
        stiffness = (
            (p[_K_F] if is_front else p[_K_R])
            * load
            * max(1.0 - p[_FALLOFF] * excess, MIN_LOAD_FACTOR)
        )
        shape = p[_C_F] if is_front else p[_C_R]
        # The carcass determines the stiffness: a slippery road reduces the grip only.
        b = stiffness / (shape * peak)
        split = p[_SPLIT] if is_front else 1.0 - p[_SPLIT]
        # A dragging brake acts on the wheels of its side only.
        driven = (0.5 * split * torque - max(side * p[_SIDE_DRAG], 0.0)) / radius
        resisting = p[_ROLLING_RESISTANCE] * load
        t_x = driven - resisting
        used = min(abs(t_x - 0.25 * inertial) / peak, 1.0)
        utilisation = math.sqrt(
            max(
                1.0 - p[_COMBINED] * used * used, MIN_LATERAL_UTILISATION * MIN_LATERAL_UTILISATION
            )
        )
        t_y = (
            peak
            * utilisation
            * normalised_lateral_force(
                b * slip, shape, p[_E_F] if is_front else p[_E_R], p[_BRUSH]
            )
        )
        # The friction limits the force of a locked or spinning wheel.
        t_x = min(max(t_x, -peak), peak)
        b_x = t_x * cos - t_y * sin
        b_y = t_x * sin + t_y * cos
        f_x += b_x
        f_y += b_y
        m_z += x * b_y - y * b_x
    a_x = (f_x - spin * kinematic) / (mass + spin) + p[_EXTRA_X]
    a_y = f_y / mass + p[_EXTRA_Y]
    return a_x, a_y, m_z / p[_INERTIA] + p[_EXTRA_YAW]
