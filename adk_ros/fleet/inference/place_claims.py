# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Claims at places of a fleet, and what is not claimed there because it may be the weather."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_result import NotClaimed, PlaceClaim, place_text
from adk_ros.fleet.inference.size_units import interval_in_unit, size_in_unit
from adk_ros.numerics.arrays import FloatArray

_NIGHT = 0.5
"""Days without a recording that separate days, by choice: half a day."""
_OF_ONE_DAY = "passed on 1 day only, and it may be the weather: record it on another day"


def days_of(times: FloatArray) -> int:
    """
    Return on how many days something was recorded, at times in days.

    Half a day without a recording separates days. Times without such a gap are as many days as
    they last.
    """
    ordered = np.sort(times)
    parts = np.split(ordered, np.flatnonzero(np.diff(ordered) > _NIGHT) + 1)
    return sum(max(1, math.ceil(part[-1] - part[0])) for part in parts if part.size)


def place_claims(estimate: FleetEstimate) -> tuple[list[PlaceClaim], list[NotClaimed]]:
    """
    Return the claims at places, and those that are not made.

    What was seen on one day only may be the weather: it is claimed only if all recordings of the
    fleet are of one day, or without a time.
    """
    found = _found_places(estimate)
    if days_of(estimate.fleet.days) == 1:
        return found, []
    return (
        [place for place in found if place.days > 1],
        [_of_one_day(place) for place in found if place.days <= 1],
    )


def _of_one_day(place: PlaceClaim) -> NotClaimed:
    return NotClaimed(
        place.effect,
        place.parameter,
        place.unit,
        place_text(place.centres[0]),
        place.size,
        place.low,
        place.high,
        _OF_ONE_DAY,
        is_claimable=True,
    )


def _found_places(estimate: FleetEstimate) -> list[PlaceClaim]:
    out, fleet = [], estimate.fleet
    for place in estimate.places:
        passing = [fleet.names.index(name) for name in place.recordings]
        column = column_of(place.key)
        low, high = interval_in_unit(column, *place.interval)
        out.append(
            PlaceClaim(
                column.effect.name,
                column.parameter.name,
                column.parameter.unit,
                size_in_unit(column.parameter, place.size * column.materiality),
                low,
                high,
                place.p_value,
                len(passing),
                days_of(fleet.days[passing]),
                len({fleet.cars[r] for r in passing}),
                tuple(cell.text for cell in place.cells),
                tuple(cell.centre for cell in place.cells),
                tuple(column_of(key).effect.name for key in place.alternatives),
            )
        )
    return out
