# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
From the one commanded torque to what each wheel's motor and brake are asked for.

Motors drive and brake up to their own limits; what braking they leave undone the friction brakes
take over, shared between the axles by `brake_split_front`. Motors can turn a wheel backwards,
brakes only hold it.
"""

from __future__ import annotations

import math

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.sprung_mass import SprungMass
from adk_ros.plant.vehicle.vehicle_parameters import Constants

_HOLDING_RATE = 1.0
"""rad/s, above which a brake brakes in full; below, in proportion, so that it creeps a little."""


@strict_kernel
def within(value: float, limit: float) -> float:
    """Return `value` within -limit ... limit."""
    return min(max(value, -limit), limit)


@strict_kernel
def asked_of_wheels(
    c: Constants, b: SprungMass, torque: float
) -> tuple[float, float, float, float]:
    """
    Return (motor front, motor rear, brake front, brake rear) of one wheel each, N m.

    `torque` is the commanded total; motors are signed, brakes not negative.
    """
    total = min(max(torque, -c.max_brake_torque), c.max_drive_torque)
    front = within(0.5 * c.torque_split_front * total, b.motor_limit_f)
    rear = within(0.5 * (1.0 - c.torque_split_front) * total, b.motor_limit_r)
    left = max(2.0 * (front + rear) - total, 0.0) if total < 0.0 else 0.0
    return front, rear, 0.5 * b.brake_split_front * left, 0.5 * (1.0 - b.brake_split_front) * left


@strict_kernel
def brake_torque(applied: float, omega: float, inertia: float, step: float) -> float:
    """
    Return the torque in N m of a brake applied with `applied` N m: against the spin, smoothly.

    A brake that would stop a wheel of `inertia` within an integration step `step` does so in one.
    """
    holding = max(_HOLDING_RATE, abs(applied) * step / inertia)
    return -applied * omega / math.sqrt(omega * omega + holding * holding)
