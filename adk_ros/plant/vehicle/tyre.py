# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Magic Formula tyre with combined slip, load sensitivity and relaxation.

Forces are shares `n` of the peak `D`: f = n D, |n| at most 1.

Slips are per wheel and signed so that a positive slip gives a positive force: `kappa` =
(omega R - v_x) / |v_x|, and the lateral slip tan(alpha) = -v_y / |v_x|, in the wheel's own frame.

Combined slip by similarity (Pacejka, Tire and Vehicle Dynamics, 3rd ed., 4.2): both slips are
normalised by their stiffness factors, `s_x = B_x kappa`, `s_y = B_y tan(alpha)`, `s` = their
length, and each force is the pure-slip curve at `s` times its share of the direction,

    n_i = (s_i / s) sin(C_i atan(s - E_i (s - atan(s)))).

With one slip zero it is the pure-slip formula exactly. The road's friction scales `D` and divides
`B`: the slip stiffness `B C D` belongs to the carcass and stays (Pacejka's scaling).

A force builds up as the carcass deflects, over the relaxation length of rolling: dn/dt =
speed / length (n_steady - n). The force lags and not the slip, so that a tyre that slid far past
its peak grips again at once instead of unwinding all of that slip first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.vehicle_parameters import Constants

SLIP_SPEED_MIN = 2.0
"""Slips are formed with at least this rolling speed, m/s: finite, and damped, at standstill."""

_SLIP_TINY = 1e-9


class AxleTyre(NamedTuple):
    """One axle's tyre, fields as in `params.Tyre`."""

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
    """Return the front or the rear axle's tyre."""
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
    """Return the Magic Formula's shape sin(C atan(s - E (s - atan s))), s >= 0 normalised slip."""
    angle = math.atan(slip)
    return math.sin(c * math.atan(slip - e * (slip - angle)))


@strict_kernel
def friction(tyre: AxleTyre, load: float) -> float:
    """Return peak force over load, falling linearly with load, never below a fifth of nominal."""
    loss = tyre.load_sensitivity * (load / tyre.nominal_load - 1.0)
    return tyre.mu * max(1.0 - loss, 0.2)


@strict_kernel
def combined_slip_utilisation(tyre: AxleTyre, s_x: float, s_y: float) -> tuple[float, float]:
    """Return the steady (n_x, n_y) for normalised slips; smooth through zero slip."""
    slip = math.hypot(s_x, s_y) + _SLIP_TINY
    return (
        s_x / slip * magic_formula(slip, tyre.c_x, tyre.e_x),
        s_y / slip * magic_formula(slip, tyre.c_y, tyre.e_y),
    )


@strict_kernel
def relaxation_rate(speed: float, length: float, step: float) -> float:
    """
    Return the rate, 1/s, with which a force follows its steady value: speed / length.

    `speed` is the hub's over ground, m/s, not negative: rolling or sliding, the ground that passes
    deflects the tyre. At least `SLIP_SPEED_MIN` counts, and at most one per integration step: a
    relaxation too short for the step to resolve takes one step.
    """
    return min(max(speed, SLIP_SPEED_MIN) / max(length, 1e-6), 1.0 / step)
