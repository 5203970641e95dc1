# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Suspension force between body and wheel along the body's vertical, and wheel load.

    F = F_static + k zeta + c dzeta/dt + k_bar (zeta - zeta') + stop(zeta) - F_y h_rc / y

where zeta is the wheel's travel from rest, bump positive, and zeta' that of the other wheel of the
axle. The last term is the part of the tyre's lateral force that the links transmit: with a roll
centre at height h_rc it rolls the body by F_y h_rc without deflecting the springs. Ideal links do
no work, so the contact point moves sideways by zeta h_rc / y with the travel: see `fourteen_dof`.
"""

from __future__ import annotations

from typing import NamedTuple

from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.sprung_mass import SprungMass


class Corner(NamedTuple):
    """Parameters of one wheel, as in `SprungMass`."""

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
    Return the upward force of spring, damper, anti-roll bar and stops on the body, N.

    `travel`, `opposite`: travel of this wheel and of the other one of the axle, m, bump positive;
    `rate`: d(travel)/dt, m/s. Beyond `room` m a stop of stiffness `stop` N/m acts.
    """
    over = max(travel - room, 0.0) + min(travel + room, 0.0)
    spring = corner.spring * travel + stop * over + corner.bar * (travel - opposite)
    return corner.static + spring + corner.damper * rate


@strict_kernel
def tyre_load(corner: Corner, deflection: float, rate: float) -> float:
    """
    Return the wheel load, N: the tyre pushes against the road and never pulls.

    `deflection`: tyre deflection against the static one, m, compression positive; `rate`: its
    time derivative, m/s.
    """
    spring = corner.load + corner.tyre_stiffness * deflection
    if spring <= 0.0:
        return 0.0
    return max(spring + corner.tyre_damping * rate, 0.0)
