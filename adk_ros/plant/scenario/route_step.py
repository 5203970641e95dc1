# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One integration step of either plant on a route: road lookup, then equations of motion."""

from __future__ import annotations

import math

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import ROAD_BANK, ROAD_GRADE, ROAD_MU, lookup
from adk_ros.plant.environment.surface import tangent_plane
from adk_ros.plant.vehicle import fourteen_dof, seven_dof
from adk_ros.plant.vehicle.seven_dof import HEADING, STEP, X, Y
from adk_ros.plant.vehicle.sprung_mass import SprungMass
from adk_ros.plant.vehicle.vehicle_parameters import Constants

STATE_SIZES = {"seven_dof": seven_dof.STATE_SIZE, "fourteen_dof": fourteen_dof.STATE_SIZE}
"""Number of state entries by plant; the first 15 and DELTA to HEADING agree in both."""

_seven_step = seven_dof.rk4_step
_fourteen_step = fourteen_dof.rk4_step


@strict_kernel
def planes_under(
    c: Constants,
    table: FloatArray,
    spacing: float,
    s: float,
    pose: tuple[float, float, float],
    planes: FloatArray,
) -> None:
    """Write the road planes under the four wheels of a vehicle at `pose` (x, y, heading)."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for i in range(4):
        x = c.cg_to_front_axle if i < 2 else -c.cg_to_rear_axle
        y = 0.5 * c.track_width if i % 2 == 0 else -0.5 * c.track_width
        at_x, at_y = pose[0] + x * cos - y * sin, pose[1] + x * sin + y * cos
        tangent_plane(table, spacing, s + x, at_x, at_y, planes[i])


@strict_kernel
def step_on_route(
    fourteen: bool,
    c: Constants,
    b: SprungMass,
    table: FloatArray,
    spacing: float,
    s: float,
    wind: tuple[float, float],
    state: FloatArray,
    command: FloatArray,
    road: FloatArray,
    work: FloatArray,
) -> tuple[float, float]:
    """
    Advance `state` in place by one `STEP` at arc length `s`; return (a_x, a_y) at its start.

    `fourteen`: the fourteen-degree-of-freedom plant; otherwise the other one, with
    `NO_SPRUNG_MASS` as `b`. `road` (4, 5) and `work` (5, state size) are scratch.
    """
    if fourteen:
        planes_under(c, table, spacing, s, (state[X], state[Y], state[HEADING]), road)
        return _fourteen_step(c, b, state, command, road, wind, STEP, work)
    even = road[0]
    even[0] = lookup(table, spacing, s, ROAD_MU)
    even[1] = lookup(table, spacing, s, ROAD_GRADE)
    even[2] = lookup(table, spacing, s, ROAD_BANK)
    even[3], even[4] = wind
    return _seven_step(c, state, command, even, STEP, work)
