# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places: laps, the other direction, hairpins, new road after known road."""

from __future__ import annotations

import numpy as np
from helpers.road import circle, straight

from adk_ros.numerics.arrays import FloatArray
from adk_ros.road.places import MAX_RADIUS, Places, Track, find_places, match_radius


def placed(x: FloatArray, y: FloatArray, heading: FloatArray, both: bool = True) -> Places:
    steps = np.hypot(np.diff(x), np.diff(y))
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    track = Track(distance, x, y, heading, np.ones_like(x))
    return find_places(track, MAX_RADIUS, 5.0, both)


def test_a_new_road_has_its_distance_as_place() -> None:
    distance = np.arange(0.0, 500.0, 2.0)
    places = placed(*straight(distance))
    np.testing.assert_allclose(places.place, distance)
    assert places.repeated == 0.0
    assert not places.returns


def test_a_lap_is_the_same_place() -> None:
    distance = np.arange(0.0, 1500.0, 2.0)
    places = placed(*circle(distance))
    # At the seam, the end of a lap and the start of the next are both near.
    later = (distance > 620.0) & (distance % 600.0 < 590.0)
    np.testing.assert_allclose(places.place[later], distance[later] % 600.0, atol=1.0)
    assert len(places.returns) == 1
    assert (places.direction == 1.0).all()


def there_and_back() -> tuple[FloatArray, FloatArray, FloatArray]:
    out = np.arange(0.0, 300.0, 2.0)
    x = np.concatenate([out, out[::-1]])
    y = np.repeat([0.0, 3.6], out.size)
    return x, y, np.repeat([0.0, np.pi], out.size)


def test_the_other_lane_is_the_same_place_the_other_way() -> None:
    x, y, heading = there_and_back()
    places = placed(x, y, heading)
    back = np.flatnonzero((heading > 1.0) & (x < 270.0))
    np.testing.assert_allclose(places.place[back], x[back], atol=1.0)
    assert (places.direction[back] == -1.0).all()
    assert places.opposite > 0.4
    assert placed(x, y, heading, both=False).opposite == 0.0


def test_a_crossing_is_not_the_same_place() -> None:
    a = np.arange(-100.0, 100.0, 2.0)
    x = np.concatenate([a, np.full(50, 100.0), np.zeros(a.size)])
    y = np.concatenate([np.zeros(a.size), np.linspace(0.0, -100.0, 50), a])
    heading = np.concatenate(
        [np.zeros(a.size), np.full(50, -np.pi / 2), np.full(a.size, np.pi / 2)]
    )
    assert placed(x, y, heading).repeated == 0.0


def test_new_road_after_known_road_is_joined() -> None:
    lap = np.arange(0.0, 900.0, 2.0)
    x, y, heading = circle(lap)
    ahead = np.arange(2.0, 200.0, 2.0)
    c, n = np.cos(heading[-1]), np.sin(heading[-1])
    places = placed(
        np.concatenate([x, x[-1] + c * ahead]),
        np.concatenate([y, y[-1] + n * ahead]),
        np.concatenate([heading, np.full(ahead.size, heading[-1])]),
    )
    assert len(places.stretches) == 2
    assert len(places.joins) == 2


def test_the_radius_is_smaller_for_a_small_car() -> None:
    assert match_radius(np.full(9, 20.0), np.full(9, 0.1)) == MAX_RADIUS
    assert match_radius(np.full(9, 2.0), np.full(9, 2.0)) == 0.5
