# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank of the road along one recording, as an inertial navigation system measures it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.numerics.arrays import FloatArray, IntArray

SLOPES = ("grade", "bank")
"""Entries of the parameter vector that an attitude measures."""


@dataclass(frozen=True)
class MeasuredRoad:
    """
    Slopes of the road over time, rad: grade (climb +), bank (left side up +).

    `at_s` (m,): times of the recording. `values`, `errors` (k, m): of each of `entries`, and how
    far specific force and velocity deviate from them, which bounds their fluctuating error.
    `level_sigma` (k,): standard deviation of their constant error, rad.
    """

    at_s: FloatArray
    entries: tuple[str, ...]
    values: FloatArray
    errors: FloatArray
    level_sigma: FloatArray

    @property
    def index(self) -> IntArray:
        """Indices (k,) of the entries in the parameter vector."""
        return np.array([INDEX[name] for name in self.entries], dtype=np.int64)

    def values_at(self, at_s: FloatArray) -> FloatArray:
        """Return the slopes (k, n) at times (n,)."""
        return np.array([np.interp(at_s, self.at_s, row) for row in self.values])

    def errors_at(self, at_s: FloatArray) -> FloatArray:
        """Return the errors (k, n) at times (n,)."""
        return np.array([np.interp(at_s, self.at_s, row) for row in self.errors])

    def level_directions(self) -> FloatArray:
        """Return changes (k, SIZE) of the parameters, one standard deviation of each level."""
        out = np.zeros((len(self.entries), SIZE))
        out[np.arange(len(self.entries)), self.index] = self.level_sigma
        return out

    def only(self, entries: Sequence[str]) -> MeasuredRoad | None:
        """Return the road with some of its entries; None without any."""
        kept = [i for i, name in enumerate(self.entries) if name in entries]
        if not kept:
            return None
        return replace(
            self,
            entries=tuple(self.entries[i] for i in kept),
            values=self.values[kept],
            errors=self.errors[kept],
            level_sigma=self.level_sigma[kept],
        )

    def raised(self, levels: Mapping[str, float]) -> MeasuredRoad:
        """Return the road with a constant added to its entries, rad."""
        added = np.array([levels.get(name, 0.0) for name in self.entries])
        return replace(self, values=self.values + added[:, None])

    def shifted(self, by_s: float) -> MeasuredRoad:
        """Return the road at times later by `by_s`."""
        return replace(self, at_s=self.at_s + by_s)


def joined_roads(roads: Sequence[MeasuredRoad | None]) -> MeasuredRoad | None:
    """Return the roads of recordings that follow each other; None unless all measure the same."""
    known = [road for road in roads if road is not None]
    if len(known) < len(roads) or len({road.entries for road in known}) != 1:
        return None
    return replace(
        known[0],
        at_s=np.concatenate([road.at_s for road in known]),
        values=np.concatenate([road.values for road in known], axis=1),
        errors=np.concatenate([road.errors for road in known], axis=1),
        level_sigma=np.max([road.level_sigma for road in known], axis=0),
    )
