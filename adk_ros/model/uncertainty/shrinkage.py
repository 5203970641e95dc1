# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Shrink predicted changes by what earlier predictions were worth.

For each horizon step h and channel, over the n predictions of about the last 17 s,

    q_h = sum m y / sum m^2                       m: predicted change since the start, y: measured
    k_h = 1 - (1 - q_h) max(0, 1 - v_h) n / (n + 3),         clamped to 0 .. 1

q is the least-squares slope of measured over predicted change: 1 for a correct model, 0 for one
without skill. The shrinkage k multiplies later predicted changes, so that a model without skill
predicts "no change". v = var(q) / (1 - q)^2 is the part of 1 - q explained by chance, removed as
James and Stein shrink a mean.

Where another predictor differs by d from the shrunk prediction s, and what was measured by e, the
same slope of e over d, shrunk towards zero instead of one, is the weight of the other predictor:

    w_h = q_h max(0, 1 - v_h) n / (n + 3),  q_h = sum d e / sum d^2,  v = var(q) / q^2,  in 0 .. 1

It is zero in the mean where s is right, since e then is noise.
"""

from __future__ import annotations

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import inlined_kernel

_PRIOR_COUNT = 3.0
"""
Prior weight of k = 1, in predictions: a few in one situation say little of the next. Empirical.
"""
_FORGETTING = 0.985
"""
Weight of a prediction per later one: mean memory of 67 predictions, 17 s. Empirical, not
calibrated.
"""


@inlined_kernel
def update_shrinkage(
    h: int, c: int, m: float, y: float, sums: FloatArray, shrinkage: FloatArray
) -> None:
    """
    Account for one comparison of a predicted change `m` with the measured one, `y`.

    `sums` (4, steps, 3): of m y, m^2, 1 and y^2; `shrinkage` (steps, 3): k.
    """
    sums[0, h, c] = _FORGETTING * sums[0, h, c] + m * y
    sums[1, h, c] = _FORGETTING * sums[1, h, c] + m * m
    sums[2, h, c] = _FORGETTING * sums[2, h, c] + 1.0
    sums[3, h, c] = _FORGETTING * sums[3, h, c] + y * y
    slope = sums[0, h, c] / max(sums[1, h, c], 1e-12)
    slope_deficit = 1.0 - slope
    residual_variance = max(sums[3, h, c] - slope * sums[0, h, c], 0.0) / sums[2, h, c]
    chance = residual_variance / max(slope_deficit * slope_deficit * sums[1, h, c], 1e-12)
    confidence = sums[2, h, c] / (sums[2, h, c] + _PRIOR_COUNT) * max(1.0 - chance, 0.0)
    shrinkage[h, c] = min(max(1.0 - confidence * slope_deficit, 0.0), 1.0)


@inlined_kernel
def update_weight(
    h: int, c: int, d: float, e: float, sums: FloatArray, weight: FloatArray
) -> None:
    """
    Account for one comparison of another predictor's difference `d` with the error `e`.

    `sums` (4, steps, 3): of d e, d^2, 1 and e^2; `weight` (steps, 3): w.
    """
    sums[0, h, c] = _FORGETTING * sums[0, h, c] + d * e
    sums[1, h, c] = _FORGETTING * sums[1, h, c] + d * d
    sums[2, h, c] = _FORGETTING * sums[2, h, c] + 1.0
    sums[3, h, c] = _FORGETTING * sums[3, h, c] + e * e
    slope = sums[0, h, c] / max(sums[1, h, c], 1e-12)
    residual_variance = max(sums[3, h, c] - slope * sums[0, h, c], 0.0) / sums[2, h, c]
    chance = residual_variance / max(slope * slope * sums[1, h, c], 1e-12)
    confidence = sums[2, h, c] / (sums[2, h, c] + _PRIOR_COUNT) * max(1.0 - chance, 0.0)
    weight[h, c] = min(max(confidence * slope, 0.0), 1.0)
