# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Empirical error covariance of the published horizons, by horizon step.

Published horizons assume constant commands, so their errors include what the driver did. Every
tenth horizon is stored with the variances published with it, and each of its steps is compared
with the measurement at that time. Nothing is predicted again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.uncertainty.conformal import (
    ROLLOUT_STRIDE,
    ConformalArrays,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.numerics.arrays import FloatArray
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
        self._arrays = (*self._stored, *self._scale.arrays)
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

    def tick(
        self, state: FloatArray, usable: bool, horizon: FloatArray, coasted: int
    ) -> FloatArray:
        """
        Compare `state` (3,) if it is `usable`, and store the `horizon` (h, 3) made from it if due.

        SI units. Return the covariance (h, 3, 3) to publish with the horizon. A horizon made
        while coasting is not stored. As its prediction began `coasted`
        ticks ago, its rows are those of so many steps later, the last row repeated.
        """
        slot, last = -1, self._steps - 1
        # Only complete horizons count; a validation run shortens some of them to save time.
        if not coasted and 0 < self._steps == horizon.shape[0]:
            self._number += 1
            if self._number % ROLLOUT_STRIDE == 0:
                slot = (self._number // ROLLOUT_STRIDE) % self._slots
        update_published_errors(state, usable, horizon, slot, *self._arrays)
        table = self._scale.calibrated
        if coasted:
            rows = np.minimum(np.arange(horizon.shape[0]) + coasted, last)
            return np.asarray(table[rows])
        return np.array(table[: horizon.shape[0]])


@fused_kernel
def update_published_errors(
    state: FloatArray, usable: bool, horizon: FloatArray, new_slot: int, *arrays: Any
) -> None:
    """
    Compare `state` (3,) with all stored horizons, and store `horizon` in `new_slot`.

    A `new_slot` of -1 stores nothing. `arrays`: the fields of `StoredHorizons` and
    `ConformalArrays`.
    """
    stored, scale = StoredHorizons(*arrays[:2]), ConformalArrays(*arrays[2:])
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
