# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where an effect acts: always, from a time on, or at stretches of a lap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from adk_ros.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from adk_ros.mismatch.surrogate.residuals import ResidualProblem

TRANSITION_LENGTH_M = 3.0
"""Metres over which a place's edge rises from an eighth to seven eighths, about."""
TRANSITION_TIME_S = 0.3
"""The same of a beginning in time, s."""


@dataclass(frozen=True)
class Activation:
    """
    A weight between 0 and 1 along a drive.

    `onset_s`: acts from then on; `stretches`: (begin, end) in metres along a lap of `lap` metres,
    whose place along the drive is `distance` (n,), one a step of the grid.
    """

    onset_s: float | None = None
    segments: tuple[tuple[float, float], ...] = ()
    lap_length: float = 0.0
    distance: FloatArray | None = None
    transition_length: float = TRANSITION_LENGTH_M
    weight: FloatArray | None = None
    """(n,) a weight of its own, one a step: of a feature, not of a place or a time."""

    @property
    def always(self) -> bool:
        """Whether it acts throughout."""
        return self.onset_s is None and not self.segments and self.weight is None

    @property
    def kind(self) -> str:
        """One of always, place, time."""
        if self.segments:
            return "place"
        return "always" if self.onset_s is None else "time"

    def variables(self) -> list[float]:
        """Return what may be fitted of it: the onset, then all stretches' ends."""
        onset = [] if self.onset_s is None else [self.onset_s]
        return [*onset, *(end for stretch in self.segments for end in stretch)]

    def with_variables(self, values: Sequence[float]) -> Activation:
        """Return the gate with its `variables` replaced."""
        rest = list(values)
        onset = None if self.onset_s is None else rest.pop(0)
        pairs = tuple((float(a), float(b)) for a, b in zip(rest[::2], rest[1::2], strict=True))
        return replace(self, onset_s=onset, segments=pairs)

    def series(self, course: ResidualProblem) -> FloatArray:
        """Return the weight at each step (n,)."""
        weight = np.ones(course.steps) if self.weight is None else self.weight
        if self.onset_s is not None:
            weight = _smooth_step((course.middle_s - self.onset_s) / (0.25 * TRANSITION_TIME_S))
        if self.segments and self.distance is not None:
            weight = weight * inside_segments(
                self.distance, self.segments, self.lap_length, self.transition_length
            )
        return weight

    def intervals(self, course: ResidualProblem) -> list[list[float]]:
        """Return the times [begin, end] in which it acts."""
        if self.kind == "always":
            return [[0.0, round(course.log.duration_s, 2)]]
        on = np.concatenate([[False], self.series(course) > 0.5, [False]])
        edges = np.flatnonzero(np.diff(on.astype(np.int8)))
        ends = np.append(course.middle_s, course.middle_s[-1])
        return [
            [round(float(ends[a]), 2), round(float(ends[b]), 2)]
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]


ALWAYS_ACTIVE = Activation()


def _smooth_step(x: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * np.clip(x, -60.0, 60.0))))


def inside_segments(
    distance: FloatArray,
    segments: tuple[tuple[float, float], ...],
    lap_length: float,
    transition_length: float = TRANSITION_LENGTH_M,
) -> FloatArray:
    """Return the weight (n,) at `distance` along the lap: one in the stretches, smooth edges."""
    weight = np.zeros(distance.shape[0])
    for begin, end in segments:
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        off = distance - middle
        off = np.abs(off - lap_length * np.round(off / lap_length))
        weight = np.maximum(weight, _smooth_step((half - off) / (0.25 * transition_length)))
    return weight
