# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Magic Formula tyre with combined slip, load sensitivity and relaxation length.

Forces are expressed as utilisation `n` of the peak force `D`: f = n D, |n| <= 1.

Slips are per wheel; a positive slip gives a positive force: `kappa` = (omega R - v_x) / |v_x|, and
the lateral slip tan(alpha) = -v_y / |v_x|, in the wheel's frame.

Combined slip by similarity (Pacejka, Tire and Vehicle Dynamics, 3rd ed., 4.2): both slips are
normalised by their stiffness factors, `s_x = B_x kappa`, `s_y = B_y tan(alpha)`, `s` the norm of
both, and each force is the pure-slip curve at `s` times the direction cosine,

    n_i = (s_i / s) sin(C_i atan(s - E_i (s - atan(s)))).

If one slip is zero, this is exactly the pure-slip formula. The road's friction scales `D` and
divides `B`: the slip stiffness `B C D` is a property of the carcass and stays (Pacejka's scaling).

The force builds up over the relaxation length: dn/dt = speed / length (n_steady - n). The lag acts
on the force and not on the slip: a tyre that has slid far past its peak regains grip at once
instead of unwinding all of that slip first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.vehicle_parameters import Constants

SLIP_SPEED_MIN = 2.0
"""
Smallest rolling speed in the denominator of the slips, m/s: finite and damped at standstill. Of a
full-size vehicle; `Constants.slip_speed_min` is that of any.
"""

_SLIP_TINY = 1e-9
"""Normalised slip that keeps the direction cosines finite at zero slip."""


class AxleTyre(NamedTuple):
    """Tyre of one axle, fields as in `vehicle_parameters.Tyre`."""

    mu: float
    b_x: float
    c_x: float
    e_x: float
    b_y: float
    c_y: float
    e_y: float
    nominal_load: float
    load_sensitivity: float
    relaxation_length: float
    relaxation_length_x: float


@strict_kernel
def axle_tyre(c: Constants, front: bool) -> AxleTyre:
    """Return the tyre of the front or the rear axle."""
    if front:
        return AxleTyre(
            c.mu_f,
            c.b_x_f,
            c.c_x_f,
            c.e_x_f,
            c.b_y_f,
            c.c_y_f,
            c.e_y_f,
            c.nominal_load_f,
            c.load_sensitivity_f,
            c.relaxation_length_f,
            c.relaxation_length_x_f,
        )
    return AxleTyre(
        c.mu_r,
        c.b_x_r,
        c.c_x_r,
        c.e_x_r,
        c.b_y_r,
        c.c_y_r,
        c.e_y_r,
        c.nominal_load_r,
        c.load_sensitivity_r,
        c.relaxation_length_r,
        c.relaxation_length_x_r,
    )


@strict_kernel
def magic_formula(slip: float, c: float, e: float) -> float:
    """Return sin(C atan(s - E (s - atan s))), the Magic Formula of normalised slip s >= 0."""
    angle = math.atan(slip)
    return math.sin(c * math.atan(slip - e * (slip - angle)))


@strict_kernel
def friction(tyre: AxleTyre, load: float) -> float:
    """Return peak force over load: falls linearly with load, at least a fifth of nominal."""
    loss = tyre.load_sensitivity * (load / tyre.nominal_load - 1.0)
    return tyre.mu * max(1.0 - loss, 0.2)


@strict_kernel
def combined_slip_utilisation(tyre: AxleTyre, s_x: float, s_y: float) -> tuple[float, float]:
    """Return the steady-state utilisation (n_x, n_y) for normalised slips, smooth at zero."""
    slip = math.hypot(s_x, s_y) + _SLIP_TINY
    return (
        s_x / slip * magic_formula(slip, tyre.c_x, tyre.e_x),
        s_y / slip * magic_formula(slip, tyre.c_y, tyre.e_y),
    )


@strict_kernel
def relaxation_rate(speed: float, length: float, slowest: float, step: float) -> float:
    """
    Return speed / length, the rate at which a force approaches its steady value, 1/s.

    `speed` is the magnitude of the hub's velocity over ground, m/s: the carcass deflects with the
    travelled distance, rolling or sliding. The rate is at least that of the speed `slowest` and at
    most 1 / step: a relaxation that the step cannot resolve takes one step.
    """
    return min(max(speed, slowest) / max(length, 1e-6), 1.0 / step)
