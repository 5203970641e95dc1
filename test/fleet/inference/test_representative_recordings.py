# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that stand for a large fleet: cars, days and tags, and where all are needed."""

from __future__ import annotations

import pytest

from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.representative_recordings import representative_recordings


def fleet_of(cars: int, recordings: int) -> dict[str, RecordingTags]:
    """Return the tags of a fleet, of which the first recording of each car but one has tyre B."""
    return {
        f"drive{i:03d}": RecordingTags(
            f"car{i % cars:02d}",
            60.0 * i / recordings,
            {"software": "2.1" if i % 2 else "2.0", "tyre": "B" if cars > i > 0 else "A"},
        )
        for i in range(recordings)
    }


def test_cars_and_days_are_represented_evenly() -> None:
    tags = fleet_of(12, 240)
    chosen = representative_recordings(tags)
    assert 60 <= len(chosen) <= 66
    for car in {one.car for one in tags.values()}:
        days = sorted(tags[name].day for name in chosen if tags[name].car == car)
        every = sorted(one.day for one in tags.values() if one.car == car)
        assert len(days) >= 5
        assert (days[0], days[-1]) == (every[0], every[-1])


def test_a_rare_value_of_a_tag_is_represented() -> None:
    tags = fleet_of(12, 240)
    rare = {name for name in list(tags)[100:104]}
    tags |= {n: RecordingTags(tags[n].car, tags[n].day, {"tyre": "C"}) for n in rare}
    assert len(rare.intersection(representative_recordings(tags))) >= 3


@pytest.mark.parametrize(("cars", "recordings"), [(6, 30), (8, 80), (40, 240)])
def test_all_are_needed_of_few_recordings_or_of_many_cars(cars: int, recordings: int) -> None:
    tags = fleet_of(cars, recordings)
    assert representative_recordings(tags) == frozenset(tags)
