# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors by step of the horizon -> a covariance whose 90 % intervals hold 90 % of what comes.

A covariance alone does not: errors have heavy tails, and they drift with the road and the driver.
So each step h and channel c has a factor on the deviation, moved as in adaptive conformal
inference (Gibbs and Candes, NeurIPS 2021) by whether the interval that was promised when the
prediction was made, +-q sqrt(P_hcc), held or was missed:

    C_h <- C_h + (e e' - C_h) / n_h,   n_h <- l n_h + 1      weighted mean, l: FORGETTING
    log s_hc <- log s_hc + GAIN (missed - 0.1)               s within LEAST, SCALE_MAX; 1 at first
    P_hij = s_hi s_hj C_hij                                  symmetric, positive semi-definite

As long as no bound is met, the share missed in T comparisons differs from 0.1 by no more than
|log s - log s_0| / (GAIN T), whatever the errors are. The promise was made up to a horizon ago;
what is learned meanwhile comes too late for it, but is not lost.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.numerics.numba_cache import inlined_kernel

ROLLOUT_STRIDE = 10
"""Ticks between two predictions that are compared."""
FORGETTING = 0.99
"""A comparison's weight per later one: 100 of them, or 25 s, are remembered."""
GAIN = 0.07
"""Step of log s per comparison."""
SCALE_MIN, SCALE_MAX = 0.25, 4.0
"""Bounds of s."""
_MISSED, _HELD = math.exp(0.9 * GAIN), math.exp(-0.1 * GAIN)
_MAX_ERROR = 1e6
"""An error is counted as no larger, in whatever unit: its square must stay finite."""


class ConformalScale:
    """
    Covariance of the errors by step; `calibrated` (steps, 3, 3) is P as above.

    :param errors: covariance (steps, 3, 3) to begin with, as if from `prior` comparisons.
    """

    def __init__(self, errors: FloatArray, prior: float) -> None:
        steps = errors.shape[0]
        # Whoever made the table may have rounded its two halves differently.
        self._errors = 0.5 * (errors + errors.transpose(0, 2, 1))
        self._prior = prior
        self.count = np.zeros(steps)
        self.covariance = np.zeros((steps, 3, 3))
        self.factor = np.ones((steps, 3))
        self.calibrated = np.zeros((steps, 3, 3))
        self.reset()

    def reset(self) -> None:
        """Forget all comparisons."""
        self.count[:] = self._prior
        self.covariance[:] = self._errors
        self.factor[:] = 1.0
        self.calibrated[:] = self._errors

    def arrays(self) -> tuple[FloatArray, ...]:
        """What `learn` takes at its end, for a kernel to hand on."""
        return self.count, self.covariance, self.factor, self.calibrated


@inlined_kernel
def update_conformal_scale(  # type: ignore[no-untyped-def]
    h, error, surprise, variance, count, covariance, factor, calibrated
):
    """
    Account for one comparison at step `h`, arrays as in `Calibration`.

    `error` (3,) enters the covariance; `surprise` (3,) is measured less what had been predicted,
    and `variance` (3,) what had been promised for it. The two errors differ where the prediction
    has been corrected with hindsight.
    """
    count[h] = FORGETTING * count[h] + 1.0
    share = 1.0 / count[h]
    for c in range(3):
        error[c] = min(max(error[c], -_MAX_ERROR), _MAX_ERROR)
        beyond = surprise[c] * surprise[c] > QUANTILE_90 * QUANTILE_90 * variance[c]
        moved = factor[h, c] * (_MISSED if beyond else _HELD)
        factor[h, c] = min(max(moved, SCALE_MIN), SCALE_MAX)
    for i in range(3):
        for j in range(3):
            covariance[h, i, j] += share * (error[i] * error[j] - covariance[h, i, j])
            calibrated[h, i, j] = factor[h, i] * factor[h, j] * covariance[h, i, j]
