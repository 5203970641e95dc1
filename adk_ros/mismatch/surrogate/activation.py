# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Activation of an effect: always, from a time on, or on segments of a lap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from adk_ros.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from adk_ros.mismatch.surrogate.residuals import ResidualProblem

TRANSITION_LENGTH_M = 3.0
"""Distance over which the activation at a segment's end rises from 1/8 to 7/8, about, m."""
TRANSITION_TIME_S = 0.3
"""Time over which the activation at an onset rises from 1/8 to 7/8, about, s."""
ROUTE_SPACING_M = 1e6
"""
Distance from the start of one route's lap to that of the next in the coordinate of several routes,
m: longer than any lap, so that a segment belongs to the route nearest to it.
"""
_SCALE_SHARE = 0.25
"""Scale of the logistic function over the transition: it rises from 1/8 to 7/8 in 4 scales."""


@dataclass(frozen=True)
class Activation:
    """
    Weight between 0 and 1 along a recording.

    `onset_s`: acts from this time on. `segments`: acts on these (begin, end), in m along a lap of
    `lap_length` m; `distance` (n,) is the position along the lap at each step of the grid.
    """

    onset_s: float | None = None
    segments: tuple[tuple[float, float], ...] = ()
    lap_length: float = 0.0
    distance: FloatArray | None = None
    transition_length: float = TRANSITION_LENGTH_M
    weight: FloatArray | None = None
    """(n,) explicit weight per step: of a feature instead of a place or a time."""
    route_lengths: tuple[float, ...] = ()
    """Length of each route's lap, where `distance` is that of several (see `routes`), m."""

    @property
    def always(self) -> bool:
        """Whether the effect acts throughout."""
        return self.onset_s is None and not self.segments and self.weight is None

    @property
    def kind(self) -> str:
        """One of always, place, time."""
        if self.segments:
            return "place"
        return "always" if self.onset_s is None else "time"

    def variables(self) -> list[float]:
        """Return the values that a fit may change: the onset, then the ends of all segments."""
        onset = [] if self.onset_s is None else [self.onset_s]
        return [*onset, *(end for segment in self.segments for end in segment)]

    def with_variables(self, values: Sequence[float]) -> Activation:
        """Return the activation with its `variables` replaced."""
        remaining = list(values)
        onset = None if self.onset_s is None else remaining.pop(0)
        pairs = tuple(
            (float(a), float(b)) for a, b in zip(remaining[::2], remaining[1::2], strict=True)
        )
        return replace(self, onset_s=onset, segments=pairs)

    def series(self, problem: ResidualProblem) -> FloatArray:
        """Return the weight at each step (n,)."""
        weight = np.ones(problem.steps) if self.weight is None else self.weight
        if self.onset_s is not None:
            weight = _smooth_step(
                (problem.middle_s - self.onset_s) / (_SCALE_SHARE * TRANSITION_TIME_S)
            )
        if self.segments and self.distance is not None:
            inside = [
                inside_segments(distance, segments, length, self.transition_length)
                for distance, segments, length in self.by_route(self.distance)
            ]
            weight = weight * np.nan_to_num(np.fmax.reduce(inside))
        return weight

    def by_route(
        self, distance: FloatArray
    ) -> list[tuple[FloatArray, tuple[tuple[float, float], ...], float]]:
        """Return the distances, NaN off the route, segments and lap length of each route."""
        if not self.route_lengths:
            return [(distance, self.segments, self.lap_length)]
        route = np.floor(distance / ROUTE_SPACING_M)
        segments = segments_by_route(self.segments, len(self.route_lengths))
        return [
            (np.where(route == i, distance - i * ROUTE_SPACING_M, np.nan), segments[i], length)
            for i, length in enumerate(self.route_lengths)
        ]

    def intervals(self, problem: ResidualProblem) -> list[list[float]]:
        """Return the times [begin, end] in which the effect acts, s."""
        if self.kind == "always":
            return [[0.0, round(problem.log.duration_s, 2)]]
        active = np.concatenate([[False], self.series(problem) > 0.5, [False]])
        edges = np.flatnonzero(np.diff(active.astype(np.int8)))
        ends = np.append(problem.middle_s, problem.middle_s[-1])
        return [
            [round(float(ends[a]), 2), round(float(ends[b]), 2)]
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]


ALWAYS_ACTIVE = Activation()


def segments_by_route(
    segments: Sequence[tuple[float, float]], routes: int
) -> list[tuple[tuple[float, float], ...]]:
    """Return the segments of each route, along its lap."""
    out: list[list[tuple[float, float]]] = [[] for _ in range(routes)]
    for begin, end in segments:
        i = min(max(round(0.5 * (begin + end) / ROUTE_SPACING_M), 0), routes - 1)
        out[i].append((begin - i * ROUTE_SPACING_M, end - i * ROUTE_SPACING_M))
    return [tuple(each) for each in out]


def _smooth_step(x: FloatArray) -> FloatArray:
    """Return the logistic function of x."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * np.clip(x, -60.0, 60.0))))


def inside_segments(
    distance: FloatArray,
    segments: tuple[tuple[float, float], ...],
    lap_length: float,
    transition_length: float = TRANSITION_LENGTH_M,
) -> FloatArray:
    """Return the weight (n,) at lap distances: one in the segments, smooth at their ends."""
    weight = np.zeros(distance.shape[0])
    for begin, end in segments:
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        off = distance - middle
        off = np.abs(off - lap_length * np.round(off / lap_length))
        weight = np.maximum(
            weight, _smooth_step((half - off) / (_SCALE_SHARE * transition_length))
        )
    return weight
