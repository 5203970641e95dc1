# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Predict the rollout error at each horizon step from present one-step residuals.

One-step residuals come from effects that the model does not contain, and how these continue
depends on road and vehicle: a gust decays, speed lost uphill is regained downhill. For each
horizon step h and channel c, the error of monitored rollouts (see `rollout_monitor`) is therefore
regressed on the K = 5 regressors s that were available when the rollout started,

    y - m  ~  w_hc s     s: running means of the one-step residuals of v_x, v_y and yaw rate
                            (`RESIDUAL_MEAN_GAIN`), and the channel's slow and fast disturbance
    w = k (S + 3/n diag S)^-1 sum s (y - m),   S = sum s s',     n rollouts, weights `FORGETTING`
    k = max(0, 1 - K a r / b)

with b the sum of squares explained by the K regressors and r the residual mean square. k is the
shrinkage factor of James and Stein: it removes what K regressors explain by chance. Rollouts with
overlapping horizons are correlated; a >= 1 is the resulting reduction of the effective sample
size. The prediction becomes m + w s, with w s clamped to three times the RMS error, so that an
outlier in the regressors has bounded effect.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.uncertainty.conformal import ROLLOUT_STRIDE
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import inlined_kernel

N_REGRESSORS = 5
"""K."""
FORGETTING = 0.998
"""
Weight of a rollout per later one: mean memory of 500 rollouts, 2 min. Empirical, not calibrated.
"""
_OVERLAP_CORRELATION = 0.5
"""
Assumed correlation of the errors of two rollouts with overlapping horizons. Empirical, not
calibrated.
"""
_RIDGE = 3.0
"""Ridge on the diagonal of S, in equivalent rollouts. Empirical, not calibrated."""
_MAX_ERROR = 1e6
"""Errors are clamped to this, in scaled units, so that sums of their squares stay finite."""
_CLIP_SIGMAS = 3.0
"""Limit of the predicted error, in RMS errors: the usual 3-sigma limit."""


class ErrorRegression:
    """
    Regression of the rollout error of one model.

    `weights` (steps, 3, K + 1): w, and in the last column the limit of w s. States are scaled,
    regressors in units of `Scaling.step_scale`. `moments` (steps, 3, K + 2, K + 2): weighted sums
    of [s; y - m; 1] [s; y - m; 1]', lower triangle.
    """

    def __init__(self, steps: int) -> None:
        self.weights = np.zeros((steps, 3, N_REGRESSORS + 1))
        self.moments = np.zeros((steps, 3, N_REGRESSORS + 2, N_REGRESSORS + 2))

    def reset(self) -> None:
        """Forget all rollouts."""
        self.weights[:] = 0.0
        self.moments[:] = 0.0


@inlined_kernel
def predicted_error(
    h: int, c: int, slot: int, weights: FloatArray, disturbance: FloatArray
) -> float:
    """
    Return w s of horizon step `h`, channel `c`, clamped; `weights` as in `ErrorRegression`.

    `disturbance` (slots, 3, 3): slow, fast and running mean of the residual, of which `slot` is
    used. It is indexed here because a view of it takes longer than the sum.
    """
    error: float = (
        weights[h, c, 0] * disturbance[slot, 2, 0]
        + weights[h, c, 1] * disturbance[slot, 2, 1]
        + weights[h, c, 2] * disturbance[slot, 2, 2]
        + weights[h, c, 3] * disturbance[slot, 0, c]
        + weights[h, c, 4] * disturbance[slot, 1, c]
    )
    limit: float = weights[h, c, N_REGRESSORS]
    return min(max(error, -limit), limit)


@inlined_kernel
def accumulate_moments(
    h: int, c: int, error: float, slot: int, disturbance: FloatArray, moments: FloatArray
) -> None:
    """
    Add the `error` y - m of a rollout at step `h`, channel `c`, to the `moments`.

    `disturbance` (slots, 3, 3): slow, fast and running mean at the rollout's start, in row `slot`.
    """
    error = min(max(error, -_MAX_ERROR), _MAX_ERROR)
    s = (
        disturbance[slot, 2, 0], disturbance[slot, 2, 1], disturbance[slot, 2, 2],
        disturbance[slot, 0, c], disturbance[slot, 1, c], error, 1.0,
    )  # fmt: skip
    for i in range(N_REGRESSORS + 2):
        for j in range(i + 1):
            moments[h, c, i, j] = FORGETTING * moments[h, c, i, j] + s[i] * s[j]


@inlined_kernel
def solve_shrunk_regression(
    h: int, c: int, moments: FloatArray, factors: FloatArray, weights: FloatArray
) -> None:
    """Write the weights of step `h`, channel `c`; `factors` (K, K) is scratch memory."""
    sums, w = moments[h, c], weights[h, c, :N_REGRESSORS]
    n = sums[N_REGRESSORS + 1, N_REGRESSORS + 1]
    for i in range(N_REGRESSORS):
        w[i] = sums[N_REGRESSORS, i]
        for j in range(i):
            factors[i, j] = sums[i, j]
        factors[i, i] = sums[i, i] * (1.0 + _RIDGE / n) + 1e-12
    solve_positive(factors, w)
    explained = 0.0
    for i in range(N_REGRESSORS):
        explained += w[i] * sums[N_REGRESSORS, i]
    residual_mean_square = max(sums[N_REGRESSORS, N_REGRESSORS] - explained, 0.0) / n
    sample_reduction = max(_OVERLAP_CORRELATION * (h + 1) / ROLLOUT_STRIDE, 1.0)
    shrinkage = max(
        1.0 - N_REGRESSORS * sample_reduction * residual_mean_square / max(explained, 1e-30), 0.0
    )
    for i in range(N_REGRESSORS):
        w[i] *= shrinkage
    weights[h, c, N_REGRESSORS] = _CLIP_SIGMAS * np.sqrt(sums[N_REGRESSORS, N_REGRESSORS] / n)


@inlined_kernel
def solve_positive(a: FloatArray, b: FloatArray) -> None:
    """
    Solve a x = b in place of `b` (k,).

    `a` (k, k) is positive definite; its lower triangle is used.
    """
    n = b.shape[0]
    for j in range(n):
        inverse = 1.0 / a[j, j]
        for i in range(j + 1, n):
            share = a[i, j] * inverse
            for k in range(i, n):
                a[k, i] -= share * a[k, j]
            b[i] -= share * b[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]
