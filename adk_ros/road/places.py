# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Places along the way: where a drive passes the same road again, in either direction.

A place is a distance along the road as it was driven for the first time. A node that lies within a
radius of an earlier first pass, with a parallel or opposite heading, is projected on it; any other
node continues a stretch of new road.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

LANE_WIDTH = 3.6
"""m (AASHTO, A Policy on Geometric Design, 2018): the other direction drives this far away."""
MAX_RADIUS = 1.4 * LANE_WIDTH
"""m from an earlier pass within which a place is the same; 0.4 of a lane for position errors."""
_RADIUS_PER_TURN = 0.5
"""Share of the tightest turning radius: the two sides of a hairpin are two of them apart."""
_PARALLEL = np.radians(45.0)
"""Largest difference in direction of one road; a crossing differs by more. By choice."""
_MIN_RETURN = 6.0
"""Radii driven since an earlier pass, at least: twice a half circle of the radius."""
_MARK = 0.1
"""Radii between the nodes that later ones are compared with."""


@dataclass(frozen=True)
class Track:
    """
    Nodes of a drive: `distance` driven (n,), m, `x`, `y`, m, and `heading`, rad, (n,) each.

    `ahead` (n,): +1 where the car drives ahead, -1 where it reverses.
    """

    distance: FloatArray
    x: FloatArray
    y: FloatArray
    heading: FloatArray
    ahead: FloatArray


@dataclass(frozen=True)
class Join:
    """Two places (m) that follow each other at `distance` m; `sign` -1 if their directions do."""

    place: float
    other: float
    sign: float
    distance: float


@dataclass(frozen=True)
class Places:
    """
    Place (n,) in m of the nodes of a drive, and their direction (n,).

    `direction`: +1 where the car's x axis points to larger places, else -1. `stretches`: first and
    last place of each stretch of road. `joins`: where stretches follow each other. `returns`:
    pairs of nodes at the same place, between which new road was driven. `radius`: within which
    places are the same, m. `repeated`, `opposite`: share of the distance on known road, and on it
    in the other direction.
    """

    place: FloatArray
    direction: FloatArray
    stretches: list[tuple[float, float]]
    joins: list[Join]
    returns: list[tuple[int, int]]
    radius: float = 0.0
    repeated: float = 0.0
    opposite: float = 0.0


def along_the_way(distance: FloatArray, ahead: FloatArray) -> Places:
    """Return places of a drive of which nothing is known to repeat: the distance itself."""
    ends = (float(distance[0]), float(distance[-1]))
    return Places(np.array(distance), np.array(ahead), [ends], [], [])


def match_radius(v_x: FloatArray, yaw_rate: FloatArray) -> float:
    """Return the radius, m, within which a place is the same: smaller for a smaller car."""
    turning = np.abs(v_x) / np.maximum(np.abs(yaw_rate), 1e-3)
    return min(MAX_RADIUS, _RADIUS_PER_TURN * float(np.percentile(turning, 1.0)))


def find_places(track: Track, radius: float, gap: float, both_directions: bool = True) -> Places:
    """
    Return the places of the nodes of a drive.

    :param radius: m from an earlier pass within which a place is the same.
    :param gap: m between the places of two stretches, so that no knot belongs to both.
    :param both_directions: whether a road driven the other way is the same place.
    """
    passes = _Passes(track, radius, both_directions)
    place, direction = np.zeros(track.distance.size), np.array(track.ahead)
    stretch_of: IntArray = np.zeros(place.size, dtype=np.int64)
    stretches = [[0.0, 0.0]]
    joins: list[Join] = []
    returns: list[tuple[int, int]] = []
    new_m = 0.0
    for i in range(1, place.size):
        driven = float(track.distance[i] - track.distance[i - 1])
        known = passes.known(i)
        was_first = bool(passes.is_first[i - 1])
        if known < 0:
            if was_first:
                place[i], stretch_of[i] = place[i - 1] + driven, stretch_of[i - 1]
            else:
                place[i], stretch_of[i] = stretches[-1][1] + gap, len(stretches)
                stretches.append([place[i], place[i]])
                joins.append(Join(place[i], place[i - 1], direction[i - 1] * direction[i], driven))
            stretches[-1][1] = float(place[i])
            new_m += driven
            continue
        ahead_m, sign = passes.projected(i, known)
        low, high = stretches[stretch_of[known]]
        place[i] = float(np.clip(place[known] + ahead_m, low, high))
        direction[i], stretch_of[i] = sign, stretch_of[known]
        if was_first:
            joins.append(Join(place[i - 1], place[i], direction[i - 1] * sign, driven))
            if new_m >= _MIN_RETURN * radius:
                returns.append((known, i))
                new_m = 0.0
    steps = np.diff(track.distance, prepend=track.distance[0])
    total = max(float(steps.sum()), 1e-9)
    again = ~passes.is_first
    ends = [(low, high) for low, high in stretches]
    opposite = again & passes.is_opposite
    shares = (float(steps[each].sum()) / total for each in (again, opposite))
    return Places(place, direction, ends, joins, returns, radius, *shares)


class _Passes:
    """Which node is on a road that was passed before."""

    def __init__(self, track: Track, radius: float, both_directions: bool) -> None:
        self._track = track
        self._xy = np.column_stack([track.x, track.y])
        # A car that stands for an hour would be near itself thousands of times.
        marks = np.floor(track.distance / max(_MARK * radius, 1e-9))
        self._marks = np.flatnonzero(np.diff(marks, prepend=-1.0) > 0.0)
        self._near = cKDTree(self._xy[self._marks]).query_ball_point(self._xy, radius)
        self._min_return = _MIN_RETURN * radius
        self._both = both_directions
        self.is_first: BoolArray = np.ones(track.distance.size, dtype=bool)
        self.is_opposite: BoolArray = np.zeros(track.distance.size, dtype=bool)

    def known(self, i: int) -> int:
        """Return the nearest node of an earlier first pass of the same road, -1 if none is."""
        track = self._track
        earlier = self._marks[self._near[i]] if self._near[i] else self._marks[:0]
        earlier = earlier[earlier < i]
        if earlier.size == 0:
            return -1
        parallel = np.cos(track.heading[earlier] - track.heading[i])
        good = self.is_first[earlier] & (
            track.distance[i] - track.distance[earlier] > self._min_return
        )
        good &= (np.abs(parallel) if self._both else parallel) > np.cos(_PARALLEL)
        if not good.any():
            return -1
        self.is_first[i] = False
        known = earlier[good]
        offset = self._xy[known] - self._xy[i]
        return int(known[np.argmin(np.hypot(offset[:, 0], offset[:, 1]))])

    def projected(self, i: int, known: int) -> tuple[float, float]:
        """Return how far beyond node `known` node i is along the road, m, and its direction."""
        track = self._track
        course = track.ahead[known] * np.array(
            [np.cos(track.heading[known]), np.sin(track.heading[known])]
        )
        own = np.array([np.cos(track.heading[i]), np.sin(track.heading[i])])
        sign = 1.0 if float(own @ course) > 0.0 else -1.0
        self.is_opposite[i] = sign != track.ahead[known]
        return float((self._xy[i] - self._xy[known]) @ course), sign
