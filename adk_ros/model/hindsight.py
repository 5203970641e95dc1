# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a prediction's error could have been told from, when it was made: learned, by horizon.

What the model leaves of the last increments stands for something the model does not know, and how
that goes on is a matter of the road and the car: a gust dies away, v_x lost uphill is won
downhill. So for each step h and channel c the error of past roll-outs (see `trials`) is regressed
on the signs s there were at their start,

    y - m  ~  w_hc s     s: running means of what was left on v_x, v_y and yaw rate (`MEAN_GAIN`),
                            and the channel's own slow and fast disturbance
    w = k (S + 3/n diag S)^-1 sum s (y - m),   S = sum s s',     n trials, weights `FORGETTING`
    k = (1 - K a rest / told)+

with `told` the square sum that the K signs explain and `rest` the mean square that they do not.
k is the factor of James and Stein: what chance would explain as well is not used. Trials whose
horizons overlap are half alike, and a > 1 says by how much they are fewer. What is predicted is
m + w s.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.calibration import EVERY
from adk_ros.model.compiled import inlined, jit
from adk_ros.signals.channels import FloatArray

SIGNS = 5
"""K."""
MEAN_GAIN = 0.1
"""Of the running means: a quarter of a second."""
FORGETTING = 0.998
"""A trial's weight per later trial: 500 trials, or two minutes."""
_ALIKE = 0.5
"""How alike two trials are whose horizons overlap."""
_RIDGE = 3.0


class Hindsight:
    """
    The regression of one model's trials; `weights` (steps, 3, K) is its outcome.

    In scaled units, a sign in units of the usual change in one tick.
    """

    def __init__(self, steps: int) -> None:
        self.weights = np.zeros((steps, 3, SIGNS))
        self._gram = np.zeros((steps, 3, SIGNS, SIGNS))
        self._moment = np.zeros((steps, 3, SIGNS))
        self._extent = np.zeros((2, steps, 3))

    def reset(self) -> None:
        """Forget all trials."""
        for array in self.arrays():
            array[:] = 0.0

    def arrays(self) -> tuple[FloatArray, ...]:
        """What `account` takes at its end, for a kernel to hand on."""
        return self._gram, self._moment, self._extent, self.weights


@jit
def fill_signs(disturbance, signs):  # type: ignore[no-untyped-def]
    """Write signs (3, K) from the disturbances (3, 3): slow, fast, running mean."""
    for c in range(3):
        for k in range(3):
            signs[c, k] = disturbance[2, k]
        signs[c, 3], signs[c, 4] = disturbance[0, c], disturbance[1, c]


@inlined
def foreseen(weights, signs):  # type: ignore[no-untyped-def]
    """Return w s, both (K,)."""
    total = 0.0
    for k in range(SIGNS):
        total += weights[k] * signs[k]
    return total


@inlined
def account(  # type: ignore[no-untyped-def]
    h, c, error, signs, factors, gram, moment, extent, weights
):
    """
    Account for the `error` y - m at step `h`, channel `c`, of a trial begun with `signs` (K,).

    `factors` (K, K) is room to work in; arrays as in `Hindsight`.
    """
    extent[0, h, c] = FORGETTING * extent[0, h, c] + 1.0
    extent[1, h, c] = FORGETTING * extent[1, h, c] + error * error
    n = extent[0, h, c]
    s, w = gram[h, c], weights[h, c]
    for i in range(SIGNS):
        moment[h, c, i] = FORGETTING * moment[h, c, i] + error * signs[i]
        w[i] = moment[h, c, i]
        for j in range(i + 1):
            s[i, j] = FORGETTING * s[i, j] + signs[i] * signs[j]
            factors[i, j] = s[i, j]
        factors[i, i] = factors[i, i] * (1.0 + _RIDGE / n) + 1e-12
    solve_positive(factors, w)
    told = 0.0
    for i in range(SIGNS):
        told += w[i] * moment[h, c, i]
    rest = max(extent[1, h, c] - told, 0.0) / n
    fewer = max(_ALIKE * (h + 1) / EVERY, 1.0)
    kept = max(1.0 - SIGNS * fewer * rest / max(told, 1e-30), 0.0)
    for i in range(SIGNS):
        w[i] *= kept


@inlined
def solve_positive(a, b):  # type: ignore[no-untyped-def]
    """Solve a x = b in place of `b` (k,), `a` (k, k) symmetric positive, its lower half read."""
    n = b.shape[0]
    for j in range(n):
        for i in range(j + 1, n):
            share = a[i, j] / a[j, j]
            for k in range(i, n):
                a[k, i] -= share * a[k, j]
            b[i] -= share * b[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]
