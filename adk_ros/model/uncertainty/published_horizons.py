# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Empirical error covariance of the published horizons, by horizon step.

Published horizons assume constant commands, so their errors include what the driver did. Every
tenth horizon is stored with the variances published with it, and each of its steps is compared
with the measurement at that time. Nothing is predicted again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.uncertainty.conformal import (
    ROLLOUT_STRIDE,
    ConformalArrays,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.numerics.array_table import (
    ArrayTable,
    floats_1,
    floats_2,
    floats_3,
    floats_4,
    integers_1,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import fused_kernel


class StoredHorizons(NamedTuple):
    """
    Published horizons under comparison.

    `values` (slots, steps, 2, 3): states and the variances published with them; `age` (slots,):
    the next step to compare, -1 if the slot is empty.
    """

    values: FloatArray
    age: NDArray[np.int64]


class PublishedHorizonErrors:
    """
    Covariance of measured minus published state by horizon step, SI, scaled as in `conformal`.

    :param errors: initial covariance (steps, 3, 3), SI, with the weight of `prior` horizons.
    """

    def __init__(self, errors: FloatArray, prior: float) -> None:
        self._steps = steps = errors.shape[0]
        self._scale = ConformalScale(errors, prior)
        self._slots = -(-steps // ROLLOUT_STRIDE)
        self._stored = StoredHorizons(
            values=np.zeros((self._slots, steps, 2, 3)), age=np.full(self._slots, -1)
        )
        self._table = ArrayTable(*self._stored, *self._scale.arrays)
        self.rows = self._table.rows
        """Arrays of the comparison, as a table for kernels."""
        self._number = 0

    @property
    def covariance(self) -> FloatArray:
        """Present covariance (steps, 3, 3), SI; a copy."""
        return np.array(self._scale.calibrated)

    def reset(self) -> None:
        """Forget all horizons."""
        self.stop()
        self._number = 0
        self._scale.reset()

    def stop(self) -> None:
        """Discard the stored horizons, which a gap has ended; keep the covariance."""
        self._stored.age[:] = -1

    def slot(self, steps: int, coasted: int) -> int:
        """
        Return the slot in which the next horizon, of so many `steps`, is to be stored, or -1.

        A horizon made while coasting, `coasted` ticks after the last measurement, is not stored.
        """
        number = self._number + 1
        # Only complete horizons count; a validation run shortens some of them to save time.
        if coasted or not 0 < self._steps == steps or number % ROLLOUT_STRIDE:
            return -1
        return int((number // ROLLOUT_STRIDE) % self._slots)

    def issue(self, steps: int, coasted: int) -> FloatArray:
        """
        Count a horizon; return the covariance (steps, 3, 3), SI, to publish with it.

        As the prediction of a horizon made while coasting began `coasted` ticks ago, its rows are
        those of so many steps later, the last row repeated.
        """
        table = self._scale.calibrated
        if coasted:
            rows = np.minimum(np.arange(steps) + coasted, self._steps - 1)
            return np.asarray(table[rows])
        if 0 < self._steps == steps:
            self._number += 1
        return np.array(table[:steps])


class PublishedArrays(NamedTuple):
    """All arrays of a `PublishedHorizonErrors`."""

    stored: StoredHorizons
    scale: ConformalArrays


@fused_kernel
def published_arrays(rows: IntArray) -> PublishedArrays:
    """Return the structure that `PublishedHorizonErrors` passes to kernels as a table."""
    return PublishedArrays(
        StoredHorizons(floats_4(rows, 0), integers_1(rows, 1)),
        ConformalArrays(
            floats_1(rows, 2), floats_3(rows, 3), floats_2(rows, 4), floats_3(rows, 5)
        ),
    )


@fused_kernel
def update_published_errors(
    state: FloatArray, usable: bool, horizon: FloatArray, new_slot: int, rows: IntArray
) -> None:
    """Run `compare_horizons` on the arrays of a table."""
    compare_horizons(state, usable, horizon, new_slot, published_arrays(rows))


@fused_kernel
def compare_horizons(
    state: FloatArray,
    usable: bool,
    horizon: FloatArray,
    new_slot: int,
    published: PublishedArrays,
) -> None:
    """
    Compare `state` (3,) with all stored horizons if `usable`, and store `horizon` in `new_slot`.

    SI units. A `new_slot` of -1 stores nothing.
    """
    stored, scale = published
    slots, steps = stored.values.shape[0], stored.values.shape[1]
    error, variance = np.empty(3), np.empty(3)
    for slot in range(slots):
        h = stored.age[slot]
        if h < 0:
            continue
        stored.age[slot] = h + 1 if h + 1 < steps else -1
        if not usable:
            continue
        for c in range(3):
            error[c] = state[c] - stored.values[slot, h, 0, c]
            variance[c] = stored.values[slot, h, 1, c]
        update_conformal_scale(h, error, error, variance, scale)
    if new_slot >= 0:
        stored.age[new_slot] = 0
        for h in range(steps):
            for c in range(3):
                stored.values[new_slot, h, 0, c] = horizon[h, c]
                stored.values[new_slot, h, 1, c] = scale.calibrated[h, c, c]
