# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a prediction's error could have been told from, when it was made: learned, by horizon.

What the model leaves of the last increments stands for something the model does not know, and how
that goes on is a matter of the road and the car: a gust dies away, v_x lost uphill is won
downhill. So for each step h and channel c the error of past roll-outs (see `trials`) is regressed
on the signs s there were at their start,

    y - m  ~  w_hc s     s: running means of what was left on v_x, v_y and yaw rate (`RESIDUAL_MEAN_GAIN`),
                            and the channel's own slow and fast disturbance
    w = k (S + 3/n diag S)^-1 sum s (y - m),   S = sum s s',     n trials, weights `FORGETTING`
    k = (1 - K a rest / told)+

with `told` the square sum that the K signs explain and `rest` the mean square that they do not.
k is the factor of James and Stein: what chance would explain as well is not used. Trials whose
horizons overlap are half alike, and a > 1 says by how much they are fewer. What is predicted is
m + w s, with w s no more than thrice the usual error: a sign far beyond all that were seen, from a
reading that jumps, foretells nothing.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.uncertainty.conformal import ROLLOUT_STRIDE
from adk_ros.numerics.numba_cache import inlined_kernel

N_REGRESSORS = 5
"""K."""
FORGETTING = 0.998
"""A trial's weight per later trial: 500 trials, or two minutes."""
_OVERLAP_CORRELATION = 0.5
"""How alike two trials are whose horizons overlap."""
_RIDGE = 3.0
_MAX_ERROR = 1e6
"""An error is counted as no larger: its square must stay finite for as long as it is kept."""
_CLIP_SIGMAS = 3.0
"""Of the root mean square error, that may be foreseen."""


class ErrorRegression:
    """
    The regression of one model's trials; `weights` (steps, 3, K + 1) is its outcome.

    In scaled units, a sign in units of the usual change in one tick. The last column is the most
    that may be foreseen.
    """

    def __init__(self, steps: int) -> None:
        self.weights = np.zeros((steps, 3, N_REGRESSORS + 1))
        self.moments = np.zeros((steps, 3, N_REGRESSORS + 2, N_REGRESSORS + 2))
        """Weighted sums of [s; y - m; 1] [s; y - m; 1]', the lower half."""

    def reset(self) -> None:
        """Forget all trials."""
        self.weights[:] = 0.0
        self.moments[:] = 0.0


@inlined_kernel
def predicted_error(h, c, lane, weights, disturbance):  # type: ignore[no-untyped-def]
    """
    Return w s of step `h`, channel `c`, bounded: `weights` as in `Hindsight`.

    `disturbance` (lanes, 3, 3) slow, fast, running mean, of which `lane` counts. Indexed here: a
    view of either takes longer than the sum.
    """
    told = (
        weights[h, c, 0] * disturbance[lane, 2, 0]
        + weights[h, c, 1] * disturbance[lane, 2, 1]
        + weights[h, c, 2] * disturbance[lane, 2, 2]
        + weights[h, c, 3] * disturbance[lane, 0, c]
        + weights[h, c, 4] * disturbance[lane, 1, c]
    )
    most = weights[h, c, N_REGRESSORS]
    return min(max(told, -most), most)


@inlined_kernel
def accumulate_moments(h, c, error, lane, disturbance, moments):  # type: ignore[no-untyped-def]
    """
    Account for the `error` y - m at step `h`, channel `c`, of a trial; `moments` in `Hindsight`.

    It began with `disturbance` (lanes, 3, 3) slow, fast, running mean, of which `lane` counts.
    """
    error = min(max(error, -_MAX_ERROR), _MAX_ERROR)
    s = (
        disturbance[lane, 2, 0], disturbance[lane, 2, 1], disturbance[lane, 2, 2],
        disturbance[lane, 0, c], disturbance[lane, 1, c], error, 1.0,
    )  # fmt: skip
    for i in range(N_REGRESSORS + 2):
        for j in range(i + 1):
            moments[h, c, i, j] = FORGETTING * moments[h, c, i, j] + s[i] * s[j]


@inlined_kernel
def solve_shrunk_regression(h, c, moments, factors, weights):  # type: ignore[no-untyped-def]
    """Write the weights of step `h`, channel `c`; `factors` (K, K) is room to work in."""
    sums, w = moments[h, c], weights[h, c, :N_REGRESSORS]
    n = sums[N_REGRESSORS + 1, N_REGRESSORS + 1]
    for i in range(N_REGRESSORS):
        w[i] = sums[N_REGRESSORS, i]
        for j in range(i):
            factors[i, j] = sums[i, j]
        factors[i, i] = sums[i, i] * (1.0 + _RIDGE / n) + 1e-12
    solve_positive(factors, w)
    told = 0.0
    for i in range(N_REGRESSORS):
        told += w[i] * sums[N_REGRESSORS, i]
    rest = max(sums[N_REGRESSORS, N_REGRESSORS] - told, 0.0) / n
    fewer = max(_OVERLAP_CORRELATION * (h + 1) / ROLLOUT_STRIDE, 1.0)
    kept = max(1.0 - N_REGRESSORS * fewer * rest / max(told, 1e-30), 0.0)
    for i in range(N_REGRESSORS):
        w[i] *= kept
    weights[h, c, N_REGRESSORS] = _CLIP_SIGMAS * np.sqrt(sums[N_REGRESSORS, N_REGRESSORS] / n)


@inlined_kernel
def solve_positive(a, b):  # type: ignore[no-untyped-def]
    """Solve a x = b in place of `b` (k,), `a` (k, k) symmetric positive, its lower half read."""
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
