# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Adaptive-conformal scaling of the horizon's error covariance to 90 % coverage.

Errors have heavy tails and drift with road and driver, so intervals from a covariance alone do
not reach their nominal coverage. Each horizon step h and channel c therefore has a scale s on the
standard deviation, updated as in adaptive conformal inference (Gibbs and Candes, NeurIPS 2021) by
whether the error exceeded the interval +-q sqrt(P_hcc) that was issued with the prediction:

    C_h <- C_h + (e e' - C_h) / n_h,   n_h <- l n_h + 1      weighted mean, l: FORGETTING
    log s_hc <- log s_hc + GAIN (missed - 0.1)               s clamped to SCALE_MIN .. SCALE_MAX
    P_hij = s_hi s_hj C_hij                                  symmetric, positive semi-definite

While s is within its bounds, the share of missed intervals in T comparisons differs from 0.1 by
at most |log s - log s_0| / (GAIN T), for any sequence of errors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.numerics.numba_cache import inlined_kernel

ROLLOUT_STRIDE = 10
"""
Ticks between the starts of two predictions that are compared: 0.25 s. Limits the cost per tick.
"""
FORGETTING = 0.99
"""
Weight of a comparison per later one: mean memory of 100 comparisons, 25 s. Empirical, not
calibrated.
"""
GAIN = 0.07
"""Step of log s per comparison. Chosen on the tests of `adk bench paper`, see doc/method.md."""
SCALE_MIN, SCALE_MAX = 0.25, 4.0
"""Bounds of s. Empirical, not calibrated."""
_SCALE_UP, _SCALE_DOWN = math.exp(0.9 * GAIN), math.exp(-0.1 * GAIN)
"""
Factors on s after an error outside and inside the interval, for a nominal share of 0.1 outside.
"""
MAX_ERROR = 1e6
"""Errors are clamped to this, in the channel's unit, so that their squares stay finite."""


class ConformalArrays(NamedTuple):
    """
    State of a `ConformalScale`, updated in place.

    `n_effective` (steps,): n; `covariance` (steps, 3, 3): C; `factor` (steps, 3): s; `calibrated`
    (steps, 3, 3): P.
    """

    n_effective: FloatArray
    covariance: FloatArray
    factor: FloatArray
    calibrated: FloatArray


class ConformalScale:
    """
    Error covariance by horizon step, scaled to 90 % coverage; `calibrated` (steps, 3, 3) is P.

    :param errors: initial covariance (steps, 3, 3), with the weight of `prior` comparisons.
    """

    def __init__(self, errors: FloatArray, prior: float) -> None:
        steps = errors.shape[0]
        # Exactly symmetric: the two halves of the given table may be rounded differently.
        self._errors = 0.5 * (errors + errors.transpose(0, 2, 1))
        self._prior = prior
        self.arrays = ConformalArrays(
            n_effective=np.zeros(steps),
            covariance=np.zeros((steps, 3, 3)),
            factor=np.ones((steps, 3)),
            calibrated=np.zeros((steps, 3, 3)),
        )
        self.reset()

    @property
    def calibrated(self) -> FloatArray:
        """Calibrated covariance P (steps, 3, 3); the array that updates change, not a copy."""
        return self.arrays.calibrated

    def reset(self) -> None:
        """Forget all comparisons."""
        self.arrays.n_effective[:] = self._prior
        self.arrays.covariance[:] = self._errors
        self.arrays.factor[:] = 1.0
        self.arrays.calibrated[:] = self._errors


@inlined_kernel
def update_conformal_scale(
    h: int,
    error: FloatArray,
    issued_error: FloatArray,
    variance: FloatArray,
    scale: ConformalArrays,
) -> None:
    """
    Account for one comparison at horizon step `h`.

    `error` (3,) updates the covariance. `issued_error` (3,) is measured minus issued prediction,
    and `variance` (3,) the variance issued with it. The two errors differ if the prediction for
    this step has been corrected since it was issued.
    """
    scale.n_effective[h] = FORGETTING * scale.n_effective[h] + 1.0
    share = 1.0 / scale.n_effective[h]
    for c in range(3):
        error[c] = min(max(error[c], -MAX_ERROR), MAX_ERROR)
        missed = issued_error[c] * issued_error[c] > QUANTILE_90 * QUANTILE_90 * variance[c]
        moved = scale.factor[h, c] * (_SCALE_UP if missed else _SCALE_DOWN)
        scale.factor[h, c] = min(max(moved, SCALE_MIN), SCALE_MAX)
    for i in range(3):
        for j in range(3):
            scale.covariance[h, i, j] += share * (error[i] * error[j] - scale.covariance[h, i, j])
            scale.calibrated[h, i, j] = (
                scale.factor[h, i] * scale.factor[h, j] * scale.covariance[h, i, j]
            )
