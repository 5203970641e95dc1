# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Dynamic similarity: thresholds of a full-size car, for a scale model of it.

Two vehicles of different size on tyres of equal friction have similar motions where their Froude
numbers v^2 / (g L) are equal: gravity, and so every acceleration, is the same for both. A length L
of the scale model is `length_scale` times that of the full-size car, and then

    speed, time     sqrt(length scale)          angle, friction, acceleration    1
    area            length scale^2              mass (equal density)             length scale^3

E. Buckingham, On physically similar systems, Physical Review 4 (1914) 345; for vehicles S. N.
Brennan and A. G. Alleyne, The Illinois Roadway Simulator, IEEE/ASME Trans. Mechatronics 5 (2000).

Trucks, cars and formula cars are full-size: their thresholds are not scaled. The step between the
two is by design: no full-size result depends on the wheelbase.
"""

from __future__ import annotations

import math

FULL_SIZE_WHEELBASE = 1.5
"""
m from which a vehicle is full-size: Formula Student demands 1.525 m, the shortest road cars have
1.69 m; karts with 1.05 m and 1:5 cars with 0.6 m are below.
"""
REFERENCE_WHEELBASE = 2.7
"""m, of the mid-size car that the thresholds are meant for: 3 m/s is a Froude number of 0.34."""
REFERENCE_MASS = 2000.0
"""kg, of the car that default torques, inertias and excitations are meant for."""


def length_scale(wheelbase: float) -> float:
    """Return the scale of lengths of a vehicle: 1 if it is full-size, less for a scale model."""
    return 1.0 if wheelbase >= FULL_SIZE_WHEELBASE else wheelbase / REFERENCE_WHEELBASE


def time_scale(length: float) -> float:
    """Return the scale of times and speeds at a scale of lengths; exactly 1 at 1."""
    return math.sqrt(length)


UNIT_EXPONENTS = {"m": 1.0, "m^2": 2.0, "m^3": 3.0, "m/s": 0.5, "kg": 3.0, "kg m^2": 5.0,
                  "N m": 4.0, "W": 3.5, "1/W": -3.5}  # fmt: skip
"""
Unit -> exponent of the length scale by which a mechanical quantity scales. Other units do not:
angles and accelerations are equal, and delays are those of electronics, not of the vehicle.
"""


def scaled_by_unit(value: float, unit: str, length: float) -> float:
    """Return a mechanical quantity of the full-size car at a scale of lengths."""
    return value * math.pow(length, UNIT_EXPONENTS.get(unit, 0.0))
