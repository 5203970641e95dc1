# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that stand for a fleet in the passes that are not near its estimate yet."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.levels import MIN_RECORDINGS

EARLY_RECORDINGS = 60
"""About as many recordings stand for a fleet. By choice: a sixth more than those of the fleets on
which this analysis was developed with all recordings in each pass."""
_OF_A_CAR = 5
"""Recordings of each car, least: as many as a trend needs, of which two are before it."""
_LARGEST_SHARE = 2.0 / 3.0
"""Share of the recordings, above which all are used: little time would be saved. By choice."""


def representative_recordings(
    tags: Mapping[str, RecordingTags], count: int = EARLY_RECORDINGS
) -> frozenset[str]:
    """
    Return about `count` recordings, evenly over cars, and over the days of each, or all.

    At least five of each car and three with each value of a tag, as far as there are any.
    """
    by_car: dict[str, list[str]] = {}
    for name in sorted(tags, key=lambda one: (tags[one].day, one)):
        by_car.setdefault(tags[name].car, []).append(name)
    of_each = max(_OF_A_CAR, count // max(len(by_car), 1))
    chosen = {name for names in by_car.values() for name in _spread(names, of_each)}
    for key, value in sorted({pair for each in tags.values() for pair in each.tags.items()}):
        having = [name for name in sorted(tags) if tags[name].tags.get(key) == value]
        lacking = MIN_RECORDINGS - len(chosen.intersection(having))
        chosen |= set(_spread([name for name in having if name not in chosen], max(lacking, 0)))
    return frozenset(chosen if len(chosen) <= _LARGEST_SHARE * len(tags) else tags)


def _spread(names: Sequence[str], count: int) -> Collection[str]:
    """Return `count` of the names, evenly over their order, or all."""
    if len(names) <= count:
        return names
    at = np.rint(np.linspace(0, len(names) - 1, count)).astype(int)
    return [names[i] for i in at]
