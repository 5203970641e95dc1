# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Road profile: surrogate parameters that vary with position, as splines along the roads driven.

The road of a simulator may have grade, bank or low friction in places. Each such entry of the
parameter vector is a uniform cubic B-spline over the distance along a line in the map frame. A
road that is driven again in the same direction is the same place. Off the line nothing is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.lap import HEADING_WEIGHT_M2, MAX_HALF_HEADING_SINE
from adk_ros.mismatch.surrogate.residuals import STEP_S, ResidualProblem
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

KNOT_SPACING_M = 10.0
"""Distance between the knots of a spline, m."""
MAX_DISTANCE_M = 8.0
"""A pose farther off the line is on another road, m."""
_LOOKUP_STRIDE = 10
"""Steps between two positions looked up on the line; values between are interpolated."""
_LINE_PERIOD_S = 0.2
"""Interval between two poses considered for the line, s."""
_MIN_SPACING_M = 0.5
"""Least distance between two rows of the line, m."""
_MIN_LOOP_LENGTH_M = 60.0
"""A place counts as passed again only after this distance, m: before, it is the same pass."""
_KNOT_GAP = 4
"""Knots between the end of one road and the start of the next: the width of a cubic spline."""
_CHUNK_POSES = 256
"""Poses matched to the line at once: bounds the memory, does not change the result."""


@dataclass(frozen=True)
class RoadProfile:
    """
    Splines along a line.

    `line` (k, 4): distance, x, y (m) and heading (rad) along the roads, one after the other.
    `coefficients` (e, knots): one row per entry of the parameter vector in `entries`.
    """

    line: FloatArray
    entries: tuple[str, ...]
    coefficients: FloatArray
    spacing: float = KNOT_SPACING_M

    @property
    def index(self) -> IntArray:
        """Indices (e,) of the entries in the parameter vector."""
        return np.array([INDEX[name] for name in self.entries], dtype=np.int64)

    def without(self, entries: Sequence[str]) -> RoadProfile | None:
        """Return the profile without some entries; None if nothing is left."""
        kept = [i for i, name in enumerate(self.entries) if name not in entries]
        if not kept:
            return None
        names = tuple(self.entries[i] for i in kept)
        return replace(self, entries=names, coefficients=self.coefficients[kept])

    def distances(self, poses: FloatArray) -> FloatArray:
        """Return the distance along the line (n,) of poses (n, 3), m; NaN off the line."""
        return _distances_along(self.line, poses)

    def values_at(self, distances: FloatArray) -> FloatArray:
        """Return the values (e, n) at distances along the line; zero for NaN."""
        first, weights = spline_basis(distances, self.spacing)
        out = np.zeros((self.coefficients.shape[0], distances.shape[0]))
        last = self.coefficients.shape[1] - 1
        for k in range(4):
            out += self.coefficients[:, np.clip(first + k, 0, last)] * weights[k]
        return out

    def values_along(self, poses: FloatArray, stride: int = 1) -> FloatArray:
        """Return the values (e, n) at poses (n, 3); every `stride`-th pose is looked up."""
        n = poses.shape[0]
        rows = np.unique(np.append(np.arange(0, n, stride), n - 1))
        values = self.values_at(self.distances(poses[rows]))
        return np.array([np.interp(np.arange(n), rows, row) for row in values]).reshape(-1, n)

    def terms(self, problem: ResidualProblem) -> ActiveTerms:
        """Return the profile as terms along a recording."""
        values = self.values_along(problem.pose, _LOOKUP_STRIDE)
        count = len(self.entries)
        return ActiveTerms(
            self.index,
            np.ones(count),
            np.arange(1, count + 1),
            np.vstack([np.ones(problem.steps), values]),
        )

    def covered_share(self, problem: ResidualProblem) -> float:
        """Return the share of a recording that lies on the line."""
        return float(np.isfinite(self.distances(problem.pose[::_LOOKUP_STRIDE])).mean())

    @cached_property
    def size(self) -> FloatArray:
        """Root mean square (e,) of the values over the line."""
        return np.asarray(np.sqrt(np.mean(self.values_at(self.line[:, 0]) ** 2, axis=1)))


def spline_basis(distances: FloatArray, spacing: float) -> tuple[IntArray, FloatArray]:
    """Return the first of four knots (n,) and their weights (4, n); weights are zero for NaN."""
    finite = np.isfinite(distances)
    x = np.where(finite, distances, 0.0) / spacing
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
    return first, np.asarray(weights * finite)


def zero_profile(problem: ResidualProblem, entries: tuple[str, ...]) -> RoadProfile:
    """Return a profile of zeros along the roads of a recording."""
    line = _line_of(problem)
    knots = int(line[-1, 0] / KNOT_SPACING_M) + 5
    return RoadProfile(line, entries, np.zeros((len(entries), knots)))


def _line_of(problem: ResidualProblem) -> FloatArray:
    """Return the line (k, 4) of all roads of a recording, each place once."""
    stride = round(_LINE_PERIOD_S / STEP_S)
    pose = problem.pose[::stride]
    speed = np.abs(problem.smoothed_odometry[:-1, 0])
    travelled = np.concatenate([[0.0], np.cumsum(speed * STEP_S)])[::stride]
    line, travelled_at = np.empty((pose.shape[0], 4)), np.empty(pose.shape[0])
    count, continues = 0, False
    for i in range(pose.shape[0]):
        if count and travelled[i] - travelled_at[count - 1] < _MIN_SPACING_M:
            continue
        earlier = int(np.searchsorted(travelled_at[:count], travelled[i] - _MIN_LOOP_LENGTH_M))
        if earlier and np.isfinite(_distances_along(line[:earlier], pose[i : i + 1])[0]):
            continues = False
            continue
        # A road that starts where another was left has its own knots.
        gap = travelled[i] - travelled_at[count - 1] if continues else _KNOT_GAP * KNOT_SPACING_M
        line[count, 0] = line[count - 1, 0] + gap if count else 0.0
        line[count, 1:] = pose[i]
        travelled_at[count] = travelled[i]
        count, continues = count + 1, True
    return np.array(line[:count])


def _distances_along(line: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the distance along the line (n,) of poses (n, 3), m; NaN off the line."""
    out = np.full(poses.shape[0], np.nan)
    for begin in range(0, poses.shape[0], _CHUNK_POSES):
        part = poses[begin : begin + _CHUNK_POSES]
        x = part[:, None, 0] - line[None, :, 1]
        y = part[:, None, 1] - line[None, :, 2]
        half_turn = np.sin(0.5 * (part[:, None, 2] - line[None, :, 3]))
        row = np.argmin(x * x + y * y + HEADING_WEIGHT_M2 * half_turn * half_turn, axis=1)
        k = np.arange(part.shape[0])
        cos, sin = np.cos(line[row, 3]), np.sin(line[row, 3])
        ahead = x[k, row] * cos + y[k, row] * sin
        aside = y[k, row] * cos - x[k, row] * sin
        distances: FloatArray = np.maximum(line[row, 0] + ahead, 0.0)
        on_line: BoolArray = (np.abs(aside) < MAX_DISTANCE_M) & (np.abs(ahead) < MAX_DISTANCE_M)
        on_line &= np.abs(half_turn[k, row]) < MAX_HALF_HEADING_SINE
        out[begin : begin + _CHUNK_POSES][on_line] = distances[on_line]
    return out
