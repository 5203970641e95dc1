# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a fleet as plain values: claims, places, vehicles, trends, recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

SCHEMA = 2
"""Version of `fleet.json`; 2: with the interval of onsets, and with what the page says besides."""
AND = " and "
"""Between the two effects of a tie that together take the place of a claim."""


def place_text(centre: Sequence[float]) -> str:
    """Return the level of what acts at a place, by the centre (x, y), m, of its first cell."""
    return f"at a place, ({centre[0]:.0f}, {centre[1]:.0f}) m"


@dataclass(frozen=True)
class Claim:
    """
    A claimed effect at a level; `size`: its parameter's difference from neutral, in its unit.

    Of a parameter that enters by its reciprocal, a power limit, it is the value; no limit is 1e30.
    `onset_day`: of a change in time, with its 90 % interval; days count from the first recording
    of the fleet. `evidence`: twice the logarithm of the likelihood ratio; `between_recordings` and
    `between_cars`: standard deviations of the parameter beyond noise and tolerance. `ties`: other
    effects and levels that explain the fleet as well, two that do so together joined by `AND`.
    """

    effect: str
    parameter: str
    unit: str
    kind: str
    level: str
    car: str
    tag: str
    value: str
    onset_day: float | None
    onset_low_day: float | None
    onset_high_day: float | None
    size: float
    low: float
    high: float
    evidence: float
    p_value: float
    between_recordings: float
    between_cars: float
    ties: tuple[str, ...]


@dataclass(frozen=True)
class PlaceClaim:
    """
    A claimed effect at a place: cells with their centres (x, y), m, in the map frame.

    `recordings`, `days`, `cars`: numbers of those that pass there; half a day without passing
    separates days. What was seen on a single day may be the weather: it is claimed only if the
    whole fleet is of one day.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    low: float
    high: float
    p_value: float
    recordings: int
    days: int
    cars: int
    cells: tuple[str, ...]
    centres: tuple[tuple[float, float], ...]
    ties: tuple[str, ...]


@dataclass(frozen=True)
class NotClaimed:
    """
    A candidate that is not claimed.

    `is_claimable`: it is significant, material and possible, but explains too little, or was seen
    at a place on one day only.
    """

    effect: str
    parameter: str
    unit: str
    level: str
    size: float
    low: float
    high: float
    reason: str
    is_claimable: bool


@dataclass(frozen=True)
class VehicleEffect:
    """
    A parameter in one car with its 90 % interval, as in a `Claim`.

    `thresholds`: its difference from neutral in materiality thresholds of the fitted variable.
    """

    car: str
    effect: str
    parameter: str
    unit: str
    size: float
    low: float
    high: float
    thresholds: float
    is_claimed: bool


@dataclass(frozen=True)
class TrendPoint:
    """
    The size of a parameter from one recording alone, given all other estimates, as in a `Claim`.

    `low` and `high`: its 90 % interval by the noise of the recording; `fitted`: by the claims.
    """

    effect: str
    parameter: str
    recording: str
    car: str
    day: float
    size: float
    low: float
    high: float
    fitted: float


@dataclass(frozen=True)
class RecordingSummary:
    """
    A recording: its loss over that of a perfect model, with the claimed effects and without.

    With them as far as it was linearised at the fleet's estimate. `note`: why it was not.
    """

    name: str
    car: str
    day: float
    tags: Mapping[str, str]
    loss_ratio: float
    loss_before: float
    note: str = ""


@dataclass(frozen=True)
class FleetResult:
    """Everything that the page of a fleet shows."""

    recordings: tuple[RecordingSummary, ...]
    cars: tuple[str, ...]
    claims: tuple[Claim, ...]
    places: tuple[PlaceClaim, ...]
    not_claimed: tuple[NotClaimed, ...]
    vehicles: tuple[VehicleEffect, ...]
    trends: tuple[TrendPoint, ...]
    visited: tuple[tuple[float, float, int], ...]
    """Centres x, y (m) of the map's cells, and how many recordings pass them."""
    tests: int
    further_drives: int = 0
    """Further drives of the simulation that show the surrogate's error on roads of the fleet."""
    unsettled: int = 0
    """Recordings of which the last pass moved the estimate once more: sizes are preliminary."""

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        return {"schema": SCHEMA, **asdict(self)}

    def worst(self, count: int) -> list[RecordingSummary]:
        """
        Return the recordings that the claims explain worst, the worst first.

        Without those that were not linearised at the estimate: their loss says nothing on it.
        """
        known = [r for r in self.recordings if not r.note]
        return sorted(known, key=lambda r: (-r.loss_ratio, r.name))[: max(count, 0)]
