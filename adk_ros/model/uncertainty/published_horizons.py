# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The horizons that were published, held against what then happened.

They are made under commands that are held, so their errors hold what the driver did as well.
Every tenth one is kept, with the variances that were published with it, and each of its steps is
compared with the measurement of its time; nothing is rolled out again.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.uncertainty.conformal import (
    ROLLOUT_STRIDE,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import fused_kernel


class PublishedHorizonErrors:
    """
    Covariance of measured less published state by step, SI, calibrated as `calibration` says.

    :param errors: covariance (steps, 3, 3) to begin with, SI, as if from `prior` horizons.
    """

    def __init__(self, errors: FloatArray, prior: float) -> None:
        self._steps = steps = errors.shape[0]
        self._calibration = ConformalScale(errors, prior)
        self._arrays = self._calibration.arrays()
        lanes = -(-steps // ROLLOUT_STRIDE)
        self._kept = np.zeros((lanes, steps, 2, 3))
        self._age = np.full(lanes, -1)
        self._lanes = lanes
        self._number = 0

    @property
    def covariance(self) -> FloatArray:
        """Covariance (steps, 3, 3), SI, as it stands; a copy."""
        return np.array(self._calibration.calibrated)

    def reset(self) -> None:
        """Forget all horizons."""
        self.stop()
        self._number = 0
        self._calibration.reset()

    def stop(self) -> None:
        """Compare none of the horizons published so far any more; what was learned stays."""
        self._age[:] = -1

    def tick(
        self, state: FloatArray, usable: bool, horizon: FloatArray, coasted: int
    ) -> FloatArray:
        """
        Compare `state` (3,), if it is `usable`; take the `horizon` (h, 3) made from it, all SI.

        Return the covariance (h, 3, 3) to publish with it. A horizon that is made while coasting
        is not kept, and as it began `coasted` ticks ago, its rows are those of so many steps
        more, the last one held.
        """
        lane, last = -1, self._steps - 1
        # Only whole horizons count: a validation run has the others made shorter, to save time.
        if not coasted and 0 < self._steps == horizon.shape[0]:
            self._number += 1
            if self._number % ROLLOUT_STRIDE == 0:
                lane = (self._number // ROLLOUT_STRIDE) % self._lanes
        update_published_errors(state, usable, horizon, lane, self._kept, self._age, *self._arrays)
        table: FloatArray = self._calibration.calibrated
        if coasted:
            rows = np.minimum(np.arange(horizon.shape[0]) + coasted, last)
            return np.asarray(table[rows])
        return np.array(table[: horizon.shape[0]])


@fused_kernel
def update_published_errors(  # type: ignore[no-untyped-def]
    state, usable, horizon, new, kept, age, count, covariance, factor, calibrated
):
    """
    Hold `state` (3,) against the horizons of all lanes, and begin lane `new` if it is not -1.

    `kept` (lanes, steps, 2, 3) holds horizons and the variances promised with them; a lane's next
    step is its `age`, -1 where it is done.
    """
    lanes, steps = kept.shape[0], kept.shape[1]
    error, variance = np.empty(3), np.empty(3)
    for lane in range(lanes):
        h = age[lane]
        if h < 0:
            continue
        age[lane] = h + 1 if h + 1 < steps else -1
        if not usable:
            continue
        for c in range(3):
            error[c] = state[c] - kept[lane, h, 0, c]
            variance[c] = kept[lane, h, 1, c]
        update_conformal_scale(h, error, error, variance, count, covariance, factor, calibrated)
    if new >= 0:
        age[new] = 0
        for h in range(steps):
            for c in range(3):
                kept[new, h, 0, c] = horizon[h, c]
                kept[new, h, 1, c] = calibrated[h, c, c]
