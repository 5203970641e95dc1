# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Latitude and longitude on the WGS 84 ellipsoid as metres on a plane."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray

_FLATTENING, _EQUATOR = 1.0 / 298.257223563, 6_378_137.0
"""Of WGS 84; the equatorial radius in m."""


def east_north(latitude: FloatArray, longitude: FloatArray) -> list[FloatArray]:
    """Return metres to the east and north of the first point, by the radii of WGS 84 there."""
    phi = math.radians(float(latitude[0])) if latitude.size else 0.0
    squared = _FLATTENING * (2.0 - _FLATTENING)
    across = _EQUATOR / math.sqrt(1.0 - squared * math.sin(phi) ** 2)
    along = across * (1.0 - squared) / (1.0 - squared * math.sin(phi) ** 2)
    return [
        np.radians(longitude - longitude[:1]) * across * math.cos(phi),
        np.radians(latitude - latitude[:1]) * along,
    ]
