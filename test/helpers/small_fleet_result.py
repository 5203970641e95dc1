# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A result of a fleet with something of everything, without any analysis."""

from __future__ import annotations

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_result import (
    Claim,
    FleetResult,
    NotClaimed,
    PlaceClaim,
    RecordingSummary,
    TrendPoint,
    VehicleEffect,
)
from adk_ros.fleet.inference.levels import RAMP, SHARED, Level

CARS = ("car01", "car02")
RECORDINGS = 25
DRAG, ROLLING = ("aero_drag", "cda"), ("rolling_resistance", "crr")


def unit_of(effect: str, parameter: str) -> str:
    return column_of(f"{effect}.{parameter}").parameter.unit


def small_result() -> FleetResult:
    """Return a result of two cars: drag of both, a ramp of one, and a grade at a place."""
    ramp = Level(RAMP, car="car02", onset=10.0)
    grade = ("road_grade", "grade")
    claims = (
        Claim(
            *DRAG, unit_of(*DRAG), SHARED, Level(SHARED).text, "", "", "", None, None, None,
            0.15, 0.1, 0.2, 40.0, 1e-9, 0.01, 0.02, ("headwind (all cars)",),
        ),
        Claim(
            *ROLLING, unit_of(*ROLLING), RAMP, ramp.text, "car02", "", "", 10.0, 8.5, 11.25,
            0.01, 0.008, 0.012, 30.0, 1e-6, 0.0, 0.0, (),
        ),
    )  # fmt: skip
    vehicles = tuple(
        VehicleEffect(car, *key, unit_of(*key), 0.1, 0.05, 0.15, 3.0, key == DRAG)
        for car in CARS
        for key in (DRAG, ROLLING)
    )
    # The last recordings are explained worst.
    recordings = tuple(
        RecordingSummary(f"drive{i:02d}", CARS[i % 2], float(i), {"rain": "no"}, 1.0 + i, 9.0 + i)
        for i in range(RECORDINGS)
    )
    trends = tuple(
        TrendPoint(*ROLLING, r.name, r.car, r.day, 0.01, 0.005, 0.015, 0.008)
        for r in recordings
        if r.car == "car02"
    )
    place = PlaceClaim(
        *grade, unit_of(*grade), 0.02, 0.01, 0.03, 1e-9, 9, 4, 2, ("3/4/0",), ((210.0, 270.0),),
        ("road_bank",),
    )  # fmt: skip
    other = NotClaimed(
        "payload", "mass", unit_of("payload", "mass"), "all cars", 9.0, -1.0, 19.0, "too small",
        False,
    )  # fmt: skip
    visited = tuple((60.0 * x, 270.0, 9) for x in range(5))
    return FleetResult(
        recordings, CARS, claims, (place,), (other,), vehicles, trends, visited, 1234, 2, 1
    )
