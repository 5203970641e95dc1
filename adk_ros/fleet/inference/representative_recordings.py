# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Recordings that stand for a fleet in the passes that are not near its estimate yet.

They are chosen by a hash of their name, so that a further recording changes the choice by one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from hashlib import sha256

from adk_ros.fleet.inference.fleet_evidence import RecordingTags, is_known_car
from adk_ros.fleet.inference.levels import MIN_RECORDINGS

EARLY_RECORDINGS = 60
"""As many recordings stand for a fleet, or more where it has many cars. By choice: a quarter more
than the fleets have on which this analysis was developed, with all recordings in each pass."""
_OF_A_CAR = 5
"""Recordings of each car, least: as many as a trend needs, of which two are before it."""
_LARGEST_SHARE = 2.0 / 3.0
"""Share of the recordings, above which all are used: little time would be saved. By choice."""


def representative_recordings(
    tags: Mapping[str, RecordingTags], count: int = EARLY_RECORDINGS
) -> frozenset[str]:
    """
    Return at least `count` recordings, as many of each car as possible, or all.

    At least five of each car and three with each value of a tag, as far as there are any.
    Recordings whose car is not known count as those of one car.
    """
    order = sorted(tags, key=lambda name: sha256(name.encode()).digest())
    by_car, by_value = defaultdict[str, list[str]](list), defaultdict[object, list[str]](list)
    for name in order:
        one = tags[name]
        by_car[one.car if is_known_car(one.car, name) else ""].append(name)
        for pair in one.tags.items():
            by_value[pair].append(name)
    of_each = _of_each_car([len(names) for names in by_car.values()], count)
    chosen = {name for names in by_car.values() for name in names[:of_each]}
    for having in by_value.values():
        lacking = MIN_RECORDINGS - len(chosen.intersection(having))
        others = [name for name in having if name not in chosen]
        chosen.update(others[: max(lacking, 0)])
    return frozenset(chosen if len(chosen) <= _LARGEST_SHARE * len(tags) else tags)


def _of_each_car(numbers: Sequence[int], count: int) -> int:
    """Return how many recordings of each car make `count` together, of cars with so many."""
    of_each = _OF_A_CAR
    while of_each < max(numbers, default=0) and sum(min(n, of_each) for n in numbers) < count:
        of_each += 1
    return of_each
