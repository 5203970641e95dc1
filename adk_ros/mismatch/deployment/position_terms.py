# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Position-dependent terms of a surrogate's file: effects in segments, the simulator's road."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.surrogate.activation import inside_segments
from adk_ros.mismatch.surrogate.lap import distance_on_lap
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import FloatArray

_MAX_DISTANCE_TO_LINE_M = 30.0
"""m. A pose farther from a lap's line is not on that lap."""
_ROAD_STRIDE = 20
"""Steps between two look-ups of the road profile."""


class PositionTerms:
    """
    Terms with one activation row per lap segment set and per curve of the road profile.

    Row 0 of the activations is one throughout.
    """

    def __init__(self, model: SurrogateFile, measured: Sequence[str] = ()) -> None:
        """`measured`: slopes of the road that the recording itself knows."""
        local = [term for term in model.terms if term.where.kind == "place"]
        self._places = [term.where for term in local]
        self._lines = [np.array(place.line) for place in self._places]
        road = model.road()
        self._road = None if road is None else road.without(measured)
        base = model.vector()
        entries, amounts, rows = [], [], []
        for term in local:
            for i, size in term.amounts(base):
                entries.append(i)
                amounts.append(size)
                rows.append(1 + self._places.index(term.where))
        if self._road is not None:
            n_curves = len(self._road.entries)
            entries += [int(i) for i in self._road.index]
            amounts += [1.0] * n_curves
            rows += [1 + len(self._places) + k for k in range(n_curves)]
        self._entries = np.array(entries, dtype=np.int64)
        self._amounts = np.array(amounts, dtype=np.float64)
        self._rows = np.array(rows, dtype=np.int64)

    @property
    def is_empty(self) -> bool:
        """Whether nothing depends on position."""
        return not self._places and self._road is None

    def along(self, distances: list[FloatArray], poses: FloatArray) -> ActiveTerms:
        """
        Return the terms along a run of n steps.

        `distances`: distance (n,) along each place's lap, m, NaN off the lap; `poses` (n, 3).
        """
        activations = np.ones((1 + len(self._places), poses.shape[0]))
        for row, (place, s) in enumerate(zip(self._places, distances, strict=True), start=1):
            segments = tuple((a, b) for a, b in place.stretches)
            inside = inside_segments(s, segments, place.lap or 1.0, place.edge)
            activations[row] = np.nan_to_num(inside)
        if self._road is not None:
            curves = self._road.values_along(poses, _ROAD_STRIDE)
            activations = np.vstack([activations, curves])
        return ActiveTerms(self._entries, self._amounts, self._rows, activations)

    def distances_at(self, pose: FloatArray, travelled_m: float) -> list[FloatArray]:
        """Return the distance along each place's lap, `travelled_m` after a pose (3,)."""
        return [
            np.asarray(
                distance_on_lap(line, place.lap or 1.0, pose, _MAX_DISTANCE_TO_LINE_M)
                + travelled_m
            )
            for place, line in zip(self._places, self._lines, strict=True)
        ]
