# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features of a drive that is simulated command by command, with what they remember."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adk_ros.mismatch.library.features import feature_matrix
from adk_ros.mismatch.library.parametric_features import has_memory, has_unlimited_memory
from adk_ros.numerics.arrays import FloatArray

MEMORY_S = 20.0
"""s of signals that features with a memory take into account; wear takes all of them."""


class FeatureHistory:
    """Signals so far, as far as the features need them; the steps are even."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = list(names)
        self._memory_s = MEMORY_S if any(has_memory(name) for name in names) else 0.0
        if any(has_unlimited_memory(name) for name in names):
            self._memory_s = np.inf
        self._table: FloatArray = np.empty((0, 0))
        self._count = 0

    def after(self, signals: Mapping[str, float]) -> FloatArray:
        """Return the features (1, k) after one more step with these signals, `time` included."""
        if self._count >= self._table.shape[1]:
            larger = np.empty((len(signals), 2 * self._count + 64))
            if self._count:
                larger[:, : self._count] = self._table[:, : self._count]
            self._table = larger
        self._table[:, self._count] = list(signals.values())
        self._count += 1
        time = self._table[list(signals).index("time"), : self._count]
        first = int(np.searchsorted(time, time[-1] - self._memory_s))
        rows = np.ascontiguousarray(self._table[:, first : self._count])
        values = feature_matrix(self._names, dict(zip(signals, rows, strict=True)))
        return values[-1:]
