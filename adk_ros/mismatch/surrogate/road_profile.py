# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What of the stand-in's parameters is bound to a place, as smooth curves along the roads driven.

A simulator's road may climb, lean or be slippery in places. Each such entry of the parameter
vector is a uniform cubic B-spline over the distance along a line in the map's frame; a road that
is driven again, the same way round, is the same place. Off the line nothing is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.residuals import STEP_S, ActiveTerms, ResidualProblem
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

KNOT_SPACING_M = 10.0
"""Between knots."""
MAX_DISTANCE_M = 8.0
"""Farther off the line, the car is on another road."""
_LOOKUP_STRIDE = 10
"""Steps of a course between two places that are looked up; what lies between is interpolated."""
_ROW_S = 0.2
_MIN_SPACING_M = 0.5
"""Between two rows of the line."""
_MIN_LOOP_LENGTH_M = 60.0
"""What was driven less than this before is the same road going on, not the same place again."""
_KNOT_GAP = 4
"""Knots left out between one road's end and the next one's beginning."""
_HEADING_WEIGHT_M2 = 400.0
_MAX_HALF_HEADING_SINE = 0.3
"""Sine of half the angle between two headings on one road, at most."""


@dataclass(frozen=True)
class RoadProfile:
    """
    `line` (k, 4): distance, x, y (m) and heading (rad) along the roads, one after the other.

    `coefficients` (e, knots) of the splines, one row for each of the `entries` of the vector.
    """

    line: FloatArray
    entries: tuple[str, ...]
    coefficients: FloatArray
    spacing: float = KNOT_SPACING_M

    @property
    def index(self) -> IntArray:
        """Where the entries are in the vector, (e,)."""
        return np.array([INDEX[name] for name in self.entries], dtype=np.int64)

    def distances(self, poses: FloatArray) -> FloatArray:
        """Return the distance (n,) along the line of poses (n, 3), NaN off it."""
        return _places(self.line, poses)

    def values_at(self, places: FloatArray) -> FloatArray:
        """Return what is added (e, n) at distances along the line; zero for NaN."""
        first, weights = basis(places, self.spacing)
        out = np.zeros((self.coefficients.shape[0], places.shape[0]))
        last = self.coefficients.shape[1] - 1
        for k in range(4):
            out += self.coefficients[:, np.clip(first + k, 0, last)] * weights[k]
        return out

    def values_along(self, poses: FloatArray, every: int = 1) -> FloatArray:
        """Return what is added (e, n) at poses, looked up at one in `every` of them."""
        n = poses.shape[0]
        rows = np.unique(np.append(np.arange(0, n, every), n - 1))
        found = self.values_at(self.distances(poses[rows]))
        return np.array([np.interp(np.arange(n), rows, row) for row in found]).reshape(-1, n)

    def terms(self, course: ResidualProblem) -> ActiveTerms:
        """Return what is added along a course."""
        gates = np.vstack([np.ones(course.steps), self.values_along(course.pose, _LOOKUP_STRIDE)])
        count = len(self.entries)
        return ActiveTerms(self.index, np.ones(count), np.arange(1, count + 1), gates)

    def covered_share(self, course: ResidualProblem) -> float:
        """Return which share of a course lies on the line."""
        return float(np.isfinite(self.distances(course.pose[::_LOOKUP_STRIDE])).mean())

    @cached_property
    def size(self) -> FloatArray:
        """Root mean square (e,) of what is added, over the line."""
        return np.asarray(np.sqrt(np.mean(self.values_at(self.line[:, 0]) ** 2, axis=1)))


def basis(places: FloatArray, spacing: float) -> tuple[IntArray, FloatArray]:
    """Return the first of four knots (n,) at distances, and the weights (4, n); zero for NaN."""
    on = np.isfinite(places)
    x = np.where(on, places, 0.0) / spacing
    first = np.floor(x).astype(np.int64)
    t = x - first
    weights = (
        np.array(
            [
                (1.0 - t) ** 3,
                3.0 * t**3 - 6.0 * t**2 + 4.0,
                -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0,
                t**3,
            ]
        )
        / 6.0
    )
    return first, np.asarray(weights * on)


def zero_profile(course: ResidualProblem, entries: tuple[str, ...]) -> RoadProfile:
    """Return the map of the roads that a course drives, on which nothing is added."""
    line = _line(course)
    knots = int(line[-1, 0] / KNOT_SPACING_M) + 5
    return RoadProfile(line, entries, np.zeros((len(entries), knots)))


def _line(course: ResidualProblem) -> FloatArray:
    every = round(_ROW_S / STEP_S)
    pose = course.pose[::every]
    driven = np.concatenate([[0.0], np.cumsum(np.abs(course.smoothed_odometry[:-1, 0]) * STEP_S)])[
        ::every
    ]
    line, begun = np.empty((pose.shape[0], 4)), np.empty(pose.shape[0])
    count, going_on = 0, False
    for i in range(pose.shape[0]):
        if count and driven[i] - begun[count - 1] < _MIN_SPACING_M:
            continue
        known = int(np.searchsorted(begun[:count], driven[i] - _MIN_LOOP_LENGTH_M))
        if known and np.isfinite(_places(line[:known], pose[i : i + 1])[0]):
            going_on = False
            continue
        # A road that begins where another was left has knots of its own.
        on = driven[i] - begun[count - 1] if going_on else _KNOT_GAP * KNOT_SPACING_M
        line[count, 0] = line[count - 1, 0] + on if count else 0.0
        line[count, 1:] = pose[i]
        begun[count] = driven[i]
        count, going_on = count + 1, True
    return np.array(line[:count])


def _places(line: FloatArray, poses: FloatArray) -> FloatArray:
    out = np.full(poses.shape[0], np.nan)
    for begin in range(0, poses.shape[0], 256):
        part = poses[begin : begin + 256]
        x = part[:, None, 0] - line[None, :, 1]
        y = part[:, None, 1] - line[None, :, 2]
        turn = np.sin(0.5 * (part[:, None, 2] - line[None, :, 3]))
        row = np.argmin(x * x + y * y + _HEADING_WEIGHT_M2 * turn * turn, axis=1)
        k = np.arange(part.shape[0])
        cos, sin = np.cos(line[row, 3]), np.sin(line[row, 3])
        ahead = x[k, row] * cos + y[k, row] * sin
        aside = y[k, row] * cos - x[k, row] * sin
        places: FloatArray = np.maximum(line[row, 0] + ahead, 0.0)
        on: BoolArray = (np.abs(aside) < MAX_DISTANCE_M) & (np.abs(ahead) < MAX_DISTANCE_M)
        on &= np.abs(turn[k, row]) < _MAX_HALF_HEADING_SINE
        out[begin : begin + 256][on] = places[on]
    return out
