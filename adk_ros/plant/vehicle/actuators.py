# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Torque allocation: distribute the commanded total torque to motors and friction brakes.

Motors drive and brake up to their limits; friction brakes supply the remaining brake torque, split
between the axles by `brake_split_front`. Motors can turn a wheel backwards, brakes cannot.
"""

from __future__ import annotations

import math

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.sprung_mass import SprungMass
from adk_ros.plant.vehicle.vehicle_parameters import Constants

_HOLDING_RATE = 1.0
"""Wheel speed above which a brake acts in full, rad/s (0.3 m/s of the car). Below it the torque is
proportional to the speed: this keeps the equations smooth, and a braked car creeps slightly."""


@strict_kernel
def within(value: float, limit: float) -> float:
    """Clamp `value` to -limit ... limit."""
    return min(max(value, -limit), limit)


@strict_kernel
def torque_requests(
    c: Constants, b: SprungMass, torque: float
) -> tuple[float, float, float, float]:
    """
    Return the requests (motor front, motor rear, brake front, brake rear) per wheel, N·m.

    `torque` is the commanded total, N·m; motor requests are signed, brake requests not negative.
    """
    total = min(max(torque, -c.max_brake_torque), c.max_drive_torque)
    front = within(0.5 * c.torque_split_front * total, b.motor_limit_f)
    rear = within(0.5 * (1.0 - c.torque_split_front) * total, b.motor_limit_r)
    friction = max(2.0 * (front + rear) - total, 0.0) if total < 0.0 else 0.0
    return (
        front,
        rear,
        0.5 * b.brake_split_front * friction,
        0.5 * (1.0 - b.brake_split_front) * friction,
    )


@strict_kernel
def brake_torque(applied: float, omega: float, inertia: float, step: float) -> float:
    """
    Return the torque of a friction brake, N·m, smooth in the wheel speed `omega`, rad/s.

    `applied` is the brake request, N·m. A brake that would stop a wheel of `inertia` (kg·m²)
    within one integration step `step` (s) stops it in exactly one step.
    """
    holding = max(_HOLDING_RATE, abs(applied) * step / inertia)
    return -applied * omega / math.sqrt(omega * omega + holding * holding)
