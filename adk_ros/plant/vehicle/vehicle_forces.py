# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Aerodynamic forces, rolling resistance, wheel loads and wheel kinematics."""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.vehicle_parameters import Constants

LOAD_MIN = 10.0
"""
Smallest wheel load, N: the force of a lifting wheel vanishes instead of changing its sign. Of a
full-size vehicle; `Constants.load_min` is that of any.
"""

_ROLLING_SPEED = 0.1
"""Speed over which rolling resistance changes its sign smoothly, m/s."""


@strict_kernel
def aerodynamic_forces(
    c: Constants, v_x: float, v_y: float, wind_x: float, wind_y: float
) -> tuple[float, float, float]:
    """
    Return the aerodynamic (f_x, f_y, m_z), N and N·m, in body axes; the wind is in body axes too.

    f_x = rho/2 cda |w| w_x, f_y = rho/2 area |w| w_y, m_z = rho/2 volume |w| w_y, where w is the
    velocity of the air relative to the body.
    """
    w_x = wind_x - v_x
    w_y = wind_y - v_y
    pressure = 0.5 * AIR_DENSITY * math.hypot(w_x, w_y)
    return (
        pressure * c.cda * w_x,
        pressure * c.side_force_area * w_y,
        pressure * c.yaw_moment_volume * w_y,
    )


@strict_kernel
def rolling_resistance(crr: float, load: float, speed: float) -> float:
    """Return the rolling resistance along the wheel, N; zero at standstill."""
    return -crr * load * speed / math.sqrt(speed * speed + _ROLLING_SPEED * _ROLLING_SPEED)


@strict_kernel
def wheel_loads(
    c: Constants, a_x: float, a_y: float, weight: float
) -> tuple[float, float, float, float]:
    """
    Return the loads (front left, front right, rear left, rear right), N; their sum is `weight`.

    Quasi-static load transfer of a rigid body: m h a_x / L between the axles and m h a_y / track
    laterally, split between the axles by `roll_share_front`. `weight` is the force normal to the
    road, N. The transfer is limited by the load of the axle; the sum holds even if a wheel lifts.
    """
    wheelbase, least = c.cg_to_front_axle + c.cg_to_rear_axle, c.load_min
    weight = max(weight, 8.0 * least)
    along = c.mass * c.cg_height * a_x / wheelbase
    front = weight * c.cg_to_rear_axle / wheelbase - along
    front = min(max(front, 2.0 * least), weight - 2.0 * least)
    rear = weight - front
    across = c.mass * c.cg_height * a_y / c.track_width
    most_f = 0.5 * front - least
    most_r = 0.5 * rear - least
    across_f = min(max(c.roll_share_front * across, -most_f), most_f)
    across_r = min(max((1.0 - c.roll_share_front) * across, -most_r), most_r)
    return (
        0.5 * front - across_f,
        0.5 * front + across_f,
        0.5 * rear - across_r,
        0.5 * rear + across_r,
    )


class Hub(NamedTuple):
    """Position of a wheel relative to the CG (m), its direction, and its hub's velocity (m/s)."""

    x: float
    y: float
    cos: float
    sin: float
    along: float
    """Velocity in the wheel's rolling direction."""
    across: float
    """Velocity to the wheel's left."""


@strict_kernel
def wheel_hub(
    c: Constants, i: int, cos_d: float, sin_d: float, v_x: float, v_y: float, yaw_rate: float
) -> Hub:
    """Return the hub of wheel `i` (order: front left, front right, rear left, rear right)."""
    front = i < 2
    x = c.cg_to_front_axle if front else -c.cg_to_rear_axle
    y = 0.5 * c.track_width if i % 2 == 0 else -0.5 * c.track_width
    cos = cos_d if front else 1.0
    sin = sin_d if front else 0.0
    hub_x = v_x - yaw_rate * y
    hub_y = v_y + yaw_rate * x
    return Hub(x, y, cos, sin, hub_x * cos + hub_y * sin, hub_y * cos - hub_x * sin)


@strict_kernel
def to_body_axes(hub: Hub, f_x: float, f_y: float) -> tuple[float, float, float]:
    """Transform wheel forces to body axes: (f_x, f_y) and the yaw moment m_z about the CG."""
    b_x = f_x * hub.cos - f_y * hub.sin
    b_y = f_x * hub.sin + f_y * hub.cos
    return b_x, b_y, hub.x * b_y - hub.y * b_x


@strict_kernel
def road_normal_weight(
    mass: float, grade: float, bank: float, v_x: float, yaw_rate: float
) -> float:
    """
    Return the force normal to the road, N: m (g cos(grade) cos(bank) - v_x r sin(bank)).

    Bank is positive with the left side up.
    """
    return mass * (GRAVITY * math.cos(grade) * math.cos(bank) - v_x * yaw_rate * math.sin(bank))
