# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Published horizons compared with what happened: what later ones are worth, and their errors.

Published horizons assume constant commands, so their errors include what the driver did. Every
tenth horizon is stored with the variances published with it, and each of its steps is compared
with the measurement at that time. Nothing is predicted again.

The comparison gives the shrinkage of later horizons (see `shrinkage`): a driver who holds the
speed undoes what a held torque would do, and "no change" is then the better prediction. It also
gives the weight of IMU integration, which is right where the car is unlike the model's. The first
step is left as it is, since its command is known. The errors that remain give the covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.uncertainty.conformal import (
    MAX_ERROR,
    ROLLOUT_STRIDE,
    ConformalArrays,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.model.uncertainty.shrinkage import update_shrinkage, update_weight
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

    `values` (slots, steps, 3, 3): states, the variances published with them, and the states before
    shrinkage; `base` (slots, 3): the state at the start; `age` (slots,): the next step to compare,
    -1 if the slot is empty. `sums`, `shrinkage` as in `shrinkage`; `shrinks` (1,): 0 if horizons
    are not shrunk. `naive` (slots, steps, 3): what IMU integration says; `naive_sums`, `weight`:
    of it, as in `shrinkage`. `compared` (slots,): how many steps of the horizon are compared.
    """

    values: FloatArray
    base: FloatArray
    age: NDArray[np.int64]
    sums: FloatArray
    shrinkage: FloatArray
    shrinks: NDArray[np.int64]
    naive: FloatArray
    naive_sums: FloatArray
    weight: FloatArray
    compared: NDArray[np.int64]


class PublishedHorizonErrors:
    """
    Covariance of measured minus published state by horizon step, SI, scaled as in `conformal`.

    :param errors: initial covariance (steps, 3, 3), SI, with the weight of `prior` horizons.
    :param shrinks: whether horizons are shrunk before they are published.
    """

    def __init__(self, errors: FloatArray, prior: float, shrinks: bool = True) -> None:
        self._steps = steps = errors.shape[0]
        self._scale = ConformalScale(errors, prior)
        self._slots = -(-steps // ROLLOUT_STRIDE)
        self._stored = StoredHorizons(
            values=np.zeros((self._slots, steps, 3, 3)),
            base=np.zeros((self._slots, 3)),
            age=np.full(self._slots, -1),
            sums=np.zeros((4, steps, 3)),
            shrinkage=np.ones((steps, 3)),
            shrinks=np.array([int(shrinks)]),
            naive=np.full((self._slots, steps, 3), np.nan),
            naive_sums=np.zeros((4, steps, 3)),
            weight=np.zeros((steps, 3)),
            compared=np.full(self._slots, steps),
        )
        self._table = ArrayTable(*self._stored, *self._scale.arrays)
        self.rows = self._table.rows
        """Arrays of the comparison, as a table for kernels."""
        self._number = 0

    @property
    def shrinkage(self) -> FloatArray:
        """Shrinkage k (steps, 3) of later horizons; a copy."""
        return np.array(self._stored.shrinkage)

    @property
    def covariance(self) -> FloatArray:
        """Present covariance (steps, 3, 3), SI; a copy."""
        return np.array(self._scale.calibrated)

    def reset(self) -> None:
        """Forget all horizons."""
        self.stop()
        self._number = 0
        self._stored.sums[:] = 0.0
        self._stored.shrinkage[:] = 1.0
        self._stored.naive_sums[:] = 0.0
        self._stored.weight[:] = 0.0
        self._scale.reset()

    def stop(self) -> None:
        """Discard the stored horizons, which a gap has ended; keep the covariance."""
        self._stored.age[:] = -1

    def slot(self, steps: int, coasted: int) -> int:
        """
        Return the slot in which the next horizon, of so many `steps`, is to be stored, or -1.

        A horizon made while coasting, `coasted` ticks after the last measurement, is not stored.
        """
        if not (steps == self._steps and self.is_due(coasted)):
            return -1
        return int(((self._number + 1) // ROLLOUT_STRIDE) % self._slots)

    def is_due(self, coasted: int) -> bool:
        """Return whether the next horizon is one to store, so that it must be complete."""
        return self._steps > 0 and not coasted and (self._number + 1) % ROLLOUT_STRIDE == 0

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
        StoredHorizons(
            floats_4(rows, 0), floats_2(rows, 1), integers_1(rows, 2), floats_3(rows, 3),
            floats_2(rows, 4), integers_1(rows, 5), floats_3(rows, 6), floats_3(rows, 7),
            floats_2(rows, 8), integers_1(rows, 9),
        ),
        ConformalArrays(
            floats_1(rows, 10), floats_3(rows, 11), floats_2(rows, 12), floats_3(rows, 13)
        ),
    )  # fmt: skip


@fused_kernel
def compare_and_publish(
    state: FloatArray,
    usable: bool,
    base: FloatArray,
    naive: FloatArray,
    horizon: FloatArray,
    ahead: int,
    new_slot: int,
    rows: IntArray,
) -> None:
    """Run `compare_horizons` and `publish_horizon` on the arrays of a table."""
    published = published_arrays(rows)
    compare_horizons(state, usable, published)
    publish_horizon(base, naive, horizon, ahead, new_slot, published)


@fused_kernel
def compare_horizons(state: FloatArray, usable: bool, published: PublishedArrays) -> None:
    """Compare `state` (3,), SI, with all stored horizons if `usable`."""
    stored, scale = published
    shrinks = stored.shrinks[0] != 0
    slots = stored.values.shape[0]
    error, issued_error, variance = np.empty(3), np.empty(3), np.empty(3)
    for slot in range(slots):
        h = stored.age[slot]
        if h < 0:
            continue
        stored.age[slot] = h + 1 if h + 1 < stored.compared[slot] else -1
        if not usable:
            continue
        for c in range(3):
            error[c] = issued_error[c] = state[c] - stored.values[slot, h, 0, c]
            variance[c] = stored.values[slot, h, 1, c]
            if shrinks and h > 0:
                y = state[c] - stored.base[slot, c]
                y = min(max(y, -MAX_ERROR), MAX_ERROR)
                m = stored.values[slot, h, 2, c] - stored.base[slot, c]
                change = stored.shrinkage[h, c] * m
                # Before what is learned takes the error into account, and makes it smaller.
                error[c] = of_model = y - change
                update_shrinkage(h, c, m, y, stored.sums, stored.shrinkage)
                d = stored.naive[slot, h, c] - stored.base[slot, c] - change
                if np.isfinite(d):
                    error[c] -= stored.weight[h, c] * d
                    update_weight(h, c, d, of_model, stored.naive_sums, stored.weight)
        update_conformal_scale(h, error, issued_error, variance, scale)


@fused_kernel
def publish_horizon(
    base: FloatArray,
    naive: FloatArray,
    horizon: FloatArray,
    ahead: int,
    new_slot: int,
    published: PublishedArrays,
) -> None:
    """
    Shrink `horizon` (h, 3), SI, towards its start `base` (3,), and weight IMU integration.

    `naive` (h, 3): states of the latter, without a row if there are none. Store the first `ahead`
    rows, one or more, in `new_slot`, unless it is -1; these are compared with what happens.
    """
    stored, scale = published
    steps = min(horizon.shape[0], stored.shrinkage.shape[0])
    stores, shrinks = new_slot >= 0, stored.shrinks[0] != 0
    if stores:
        stored.age[new_slot] = 0
        stored.compared[new_slot] = min(ahead, steps)
    mixes = shrinks and naive.shape[0] >= steps
    for c in range(3):
        if stores:
            stored.base[new_slot, c] = base[c]
        for h in range(steps):
            predicted = horizon[h, c]
            k = stored.shrinkage[h, c]
            if shrinks and k < 1.0:
                horizon[h, c] = base[c] + k * (predicted - base[c])
            weight = stored.weight[h, c]
            if mixes and weight > 0.0 and np.isfinite(naive[h, c]):
                horizon[h, c] += weight * (naive[h, c] - horizon[h, c])
            if stores and h < ahead:
                stored.values[new_slot, h, 0, c] = horizon[h, c]
                stored.values[new_slot, h, 1, c] = scale.calibrated[h, c, c]
                stored.values[new_slot, h, 2, c] = predicted
                stored.naive[new_slot, h, c] = naive[h, c] if mixes else np.nan


@fused_kernel
def forget_horizon(slot: int, published: PublishedArrays) -> None:
    """Discard the horizon in a slot, if it is not -1."""
    if slot >= 0:
        published.stored.age[slot] = -1
