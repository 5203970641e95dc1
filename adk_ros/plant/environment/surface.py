# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Road surface under each wheel as a plane: position, normal and friction.

The surface over the map is z(s, n) = height(s) + n tan(bank(s)), with s along the route and n to
its left. At a wheel it is replaced by its tangent plane, normal . (x, y, z) = offset, for one
integration step: at 40 m/s the error due to the road's curvature is a few micrometres.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import (
    ROAD_CAMBER,
    ROAD_CURVATURE,
    ROAD_HEADING,
    ROAD_HEIGHT,
    ROAD_MU,
    ROAD_SLOPE,
    ROAD_X,
    ROAD_Y,
)

PLANE_MU, PLANE_X, PLANE_Y, PLANE_Z, PLANE_OFFSET = range(5)
"""Columns of a plane: friction, upward unit normal, distance from the origin along the normal in
m."""


@strict_kernel
def tangent_plane(
    table: FloatArray, spacing: float, s: float, x: float, y: float, plane: FloatArray
) -> None:
    """Write the road's tangent plane at map point (x, y), near arc length `s`, to `plane` (5,)."""
    rows = table.shape[0] - 1
    position = s / spacing
    whole = math.floor(position)
    i = int(whole) % rows
    share = position - whole
    near, far = table[i], table[i + 1]
    heading = (1.0 - share) * near[ROAD_HEADING] + share * far[ROAD_HEADING]
    cos, sin = math.cos(heading), math.sin(heading)
    dx = x - ((1.0 - share) * near[ROAD_X] + share * far[ROAD_X])
    dy = y - ((1.0 - share) * near[ROAD_Y] + share * far[ROAD_Y])
    curvature = (1.0 - share) * near[ROAD_CURVATURE] + share * far[ROAD_CURVATURE]
    across = dy * cos - dx * sin
    stretch = max(1.0 - curvature * across, 0.2)
    # One projection step, which may lead to a neighbouring row.
    position += (dx * cos + dy * sin) / (stretch * spacing)
    whole = math.floor(position)
    i = int(whole) % rows
    share = position - whole
    near, far = table[i], table[i + 1]
    slope = (1.0 - share) * near[ROAD_SLOPE] + share * far[ROAD_SLOPE]
    camber = (1.0 - share) * near[ROAD_CAMBER] + share * far[ROAD_CAMBER]
    # The exact integral of the linear slope between two rows: continuous with its derivative.
    mean_slope = near[ROAD_SLOPE] + 0.5 * share * (far[ROAD_SLOPE] - near[ROAD_SLOPE])
    height = near[ROAD_HEIGHT] + spacing * share * mean_slope + across * camber
    height += math.floor(position / rows) * (table[rows, ROAD_HEIGHT] - table[0, ROAD_HEIGHT])
    along = (slope + across * (far[ROAD_CAMBER] - near[ROAD_CAMBER]) / spacing) / stretch
    rise_x = along * cos - camber * sin
    rise_y = along * sin + camber * cos
    normal = 1.0 / math.sqrt(1.0 + rise_x * rise_x + rise_y * rise_y)
    plane[PLANE_MU] = (1.0 - share) * near[ROAD_MU] + share * far[ROAD_MU]
    plane[PLANE_X] = -rise_x * normal
    plane[PLANE_Y] = -rise_y * normal
    plane[PLANE_Z] = normal
    plane[PLANE_OFFSET] = normal * (height - rise_x * x - rise_y * y)


def even_planes(
    mu: float, grade: float = 0.0, bank: float = 0.0, heading: float = 0.0
) -> FloatArray:
    """
    Return (4, 5): the same plane through the origin for all wheels.

    It rises by `grade` rad towards `heading` and by `bank` rad to the left of it; both are clamped
    to 1 rad.
    """
    along, across = (math.tan(min(max(angle, -1.0), 1.0)) for angle in (grade, bank))
    rise_x = along * math.cos(heading) - across * math.sin(heading)
    rise_y = along * math.sin(heading) + across * math.cos(heading)
    normal = np.array([-rise_x, -rise_y, 1.0]) / math.sqrt(1.0 + rise_x**2 + rise_y**2)
    return np.tile([mu, *normal, 0.0], (4, 1))
