# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Levels of a fleet at which an effect may act, and the design of each over the recordings.

A term is a parameter of an effect at a level. Its design z (r,) says how much of its size acts in
each recording: one in all of them (the simulator's), in those of one car, in those with a value of
a tag, or a trend in time, of all cars or of one: a step at a change point, or a ramp from it that
reaches one at the last recording of those cars. So the size of a ramp is what was seen last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.numerics.arrays import FloatArray

SHARED, CAR, CONDITION, STEP, RAMP = "shared", "car", "condition", "step", "ramp"
TRENDS = frozenset({STEP, RAMP})
"""Kinds of levels that are a change in time."""
MIN_RECORDINGS = 3
"""Least recordings with and without a level: two determine no scatter among them and a size."""
BOUND_DEVIATIONS = 2.0
"""Standard deviations by which chance may move a size beyond the bounds of its parameter."""
_ONSETS = 8
"""Change points that are tried per trend, at quantiles of the recordings' times. By choice."""
_BEFORE_TREND = 2
"""Recordings besides those with a trend, least: they say where it begins. By choice."""
_SPARSE_ONSETS = 4
"""The same of a single car, which has fewer recordings. By choice."""


@dataclass(frozen=True)
class Level:
    """
    Where an effect acts in a fleet.

    `kind`: one of the constants above. `car`: of a car, or of a trend in one car; `tag` and
    `value` of a condition; `onset`: day of a change point.
    """

    kind: str
    car: str = ""
    tag: str = ""
    value: str = ""
    onset: float = 0.0

    @property
    def text(self) -> str:
        """The level in words."""
        of = f" in {self.car}" if self.car else " in all cars"
        return {
            SHARED: "all cars",
            CAR: self.car,
            CONDITION: f"{self.tag} = {self.value}",
            STEP: f"from day {self.onset:.3g} on{of}",
            RAMP: f"growing from day {self.onset:.3g} on{of}",
        }[self.kind]

    @property
    def without_onset(self) -> Level:
        """The level whatever its change point, which is fitted."""
        return replace(self, onset=0.0)

    def design(self, fleet: FleetEvidence) -> FloatArray:
        """Return how much of the effect acts in each recording (r,), from 0 to 1."""
        out = np.ones(len(fleet.names))
        if self.car:
            out *= np.array([car == self.car for car in fleet.cars], dtype=np.float64)
        if self.kind == CONDITION:
            out *= np.array([tags.get(self.tag) == self.value for tags in fleet.tags])
        elif self.kind == STEP:
            out *= fleet.days >= self.onset
        elif self.kind == RAMP:
            last = float(fleet.days[out > 0.0].max(initial=self.onset))
            out *= np.maximum(fleet.days - self.onset, 0.0) / max(last - self.onset, 1e-9)
        return out


def distinct(levels: Sequence[Level], fleet: FleetEvidence) -> list[Level]:
    """
    Return the levels that the recordings of a fleet can tell from each other.

    Of levels with the same recordings only the first is kept; the others are among the ties of
    what is claimed.
    """
    found: dict[bytes, Level] = {}
    for level in levels:
        found.setdefault(level.design(fleet).tobytes(), level)
    return list(found.values())


def usable_levels(fleet: FleetEvidence) -> list[Level]:
    """Return the levels of enough recordings: shared, cars, conditions, trends."""
    found = [Level(SHARED)]
    cars = fleet.car_names
    if len(cars) > 1:
        found += [Level(CAR, car=car) for car in cars]
    tags = sorted({name for each in fleet.tags for name in each})
    for tag in tags:
        values = sorted({each[tag] for each in fleet.tags if each.get(tag)})
        found += [Level(CONDITION, tag=tag, value=value) for value in values]
    found += _trends(fleet, "", _ONSETS)
    for car in cars if len(cars) > 1 else ():
        found += _trends(fleet, car, _SPARSE_ONSETS)
    return [level for level in found if is_usable(level, fleet)]


def _trends(fleet: FleetEvidence, car: str, count: int) -> list[Level]:
    days = fleet.days if not car else fleet.days[np.array(fleet.cars) == car]
    distinct = np.unique(days)
    if distinct.size < MIN_RECORDINGS + _BEFORE_TREND:
        return []
    onsets = np.unique(np.quantile(distinct, np.arange(1, count + 1) / (count + 1.0)))
    ramps = [Level(RAMP, car=car, onset=float(day)) for day in (distinct[0], *onsets[:-1])]
    return [*ramps, *(Level(STEP, car=car, onset=float(day)) for day in onsets)]


def is_usable(level: Level, fleet: FleetEvidence) -> bool:
    """Whether enough recordings have the level, and enough have not."""
    if level.kind == SHARED:
        return True
    z = level.design(fleet)
    active = int(np.count_nonzero(z))
    if level.kind == RAMP:
        return active >= MIN_RECORDINGS
    return active >= MIN_RECORDINGS and z.size - active >= MIN_RECORDINGS


def same_recordings(fleet: FleetEvidence, level: Level, others: list[Level]) -> list[Level]:
    """Return the levels with the same design as `level`, but for its other change points."""
    z, known = level.design(fleet), level.without_onset
    further = [other for other in others if other.without_onset != known]
    return [other for other in further if np.allclose(other.design(fleet), z)]


def is_trend(level: Level) -> bool:
    """Whether a level is a change in time."""
    return level.kind in TRENDS
