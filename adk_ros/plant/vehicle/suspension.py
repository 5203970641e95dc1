# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What acts between the body and a wheel along the body's vertical.

With zeta a wheel's travel up in the body from where it rests, and zeta' the one across the axle:

    F = F_static + k zeta + c dzeta/dt + k_bar (zeta - zeta') + stop(zeta) - F_y h_rc / y

The last term is what of the tyre's lateral force goes through the links: an axle with a roll
centre at height h_rc tips the body by F_y h_rc without its springs. The links have no work to
give, so the contact moves sideways by zeta h_rc / y as the wheel travels: see `fourteen_dof`.
"""

from __future__ import annotations

from typing import NamedTuple

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.sprung_mass import SprungMass


class Corner(NamedTuple):
    """One wheel's parameters, as in `Body`."""

    unsprung: float
    static: float
    load: float
    spring: float
    damper: float
    bar: float
    tyre_stiffness: float
    tyre_damping: float
    roll_centre: float


@strict_kernel
def corner(b: SprungMass, front: bool) -> Corner:
    """Return the parameters of a front or a rear wheel."""
    if front:
        return Corner(
            b.unsprung_f,
            b.static_f,
            b.load_f,
            b.spring_f,
            b.damper_f,
            b.bar_f,
            b.tyre_stiffness_f,
            b.tyre_damping_f,
            b.roll_centre_f,
        )
    return Corner(
        b.unsprung_r,
        b.static_r,
        b.load_r,
        b.spring_r,
        b.damper_r,
        b.bar_r,
        b.tyre_stiffness_r,
        b.tyre_damping_r,
        b.roll_centre_r,
    )


@strict_kernel
def suspension_force(
    corner: Corner, stop: float, room: float, travel: float, rate: float, opposite: float
) -> float:
    """
    Return the force in N that spring, damper, bar and stops push the body up with.

    `travel`, `opposite`: of this wheel and of the other one of the axle, m, up positive; `rate` in
    m/s. Beyond `room` to either side a stop of stiffness `stop` comes in.
    """
    over = max(travel - room, 0.0) + min(travel + room, 0.0)
    spring = corner.spring * travel + stop * over + corner.bar * (travel - opposite)
    return corner.static + spring + corner.damper * rate


@strict_kernel
def tyre_load(corner: Corner, sinking: float, closing: float) -> float:
    """
    Return the wheel load in N: the tyre pushes against the road and never pulls.

    `sinking` in m, by how much nearer to the road the wheel's centre is than at rest; `closing`
    in m/s, the speed with which it comes nearer.
    """
    spring = corner.load + corner.tyre_stiffness * sinking
    if spring <= 0.0:
        return 0.0
    return max(spring + corner.tyre_damping * closing, 0.0)
