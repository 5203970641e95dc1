# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that stand for a large fleet: cars, days and tags, and where all are needed."""

from __future__ import annotations

from collections import Counter

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


@pytest.mark.parametrize("numbers", [[20] * 12, [200, *[1] * 8], [200, 200, *[1] * 28], [300, 4]])
def test_cars_are_represented_as_evenly_as_possible(numbers: list[int]) -> None:
    tags = {
        f"drive{car:02d}_{i:03d}": RecordingTags(f"car{car:02d}", float(i))
        for car, number in enumerate(numbers)
        for i in range(number)
    }
    chosen = representative_recordings(tags)
    assert 60 <= len(chosen) < 60 + len(numbers)
    of_car = Counter(tags[name].car for name in chosen)
    of_each = [of_car[f"car{car:02d}"] for car in range(len(numbers))]
    most = max(of_each)
    assert all(n in {most, number} for n, number in zip(of_each, numbers, strict=True))
    days = [tags[name].day for name in chosen if tags[name].car == "car00"]
    assert min(days) < 0.5 * numbers[0] < max(days)


def test_a_further_recording_changes_the_choice_little() -> None:
    tags = fleet_of(6, 300)
    before = representative_recordings(tags)
    after = representative_recordings(tags | {"drive999": RecordingTags("car00", 61.0)})
    assert len(before & after) >= len(before) - 1


def test_recordings_of_unknown_cars_are_as_those_of_one() -> None:
    tags = {f"drive{i:03d}": RecordingTags(f"drive{i:03d}") for i in range(200)}
    assert len(representative_recordings(tags)) == 60


def test_a_rare_value_of_a_tag_is_represented() -> None:
    tags = fleet_of(12, 240)
    rare = set(list(tags)[100:104])
    tags |= {n: RecordingTags(tags[n].car, tags[n].day, {"tyre": "C"}) for n in rare}
    assert len(rare.intersection(representative_recordings(tags))) >= 3


@pytest.mark.parametrize(("cars", "recordings"), [(6, 30), (8, 80), (40, 240)])
def test_all_are_needed_of_few_recordings_or_of_many_cars(cars: int, recordings: int) -> None:
    tags = fleet_of(cars, recordings)
    assert representative_recordings(tags) == frozenset(tags)
