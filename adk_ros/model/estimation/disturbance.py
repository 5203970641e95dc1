# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled disturbance estimator: the regression pair of a tick, and what the model leaves of it.

    d <- d + g_d (e - d)         slow, e: residual of the increment
    f <- f + g_f (e - d - f)     fast
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.numba_cache import strict_kernel

RESIDUAL_MEAN_GAIN = 0.1
"""Gain per tick of the running mean of the residual: a quarter of a second."""


@strict_kernel
def regression_pair(  # type: ignore[no-untyped-def]
    measured, features, phi, theta, step_scale, residual, correction, disturbance, y, limit
):
    """
    Target y (n_z,) of the tick that has just ended, the disturbances moved towards what is left.

    `measured` (3,) scaled and `features` make up z; `phi` is of the tick before and begins with
    its z, the observer's state in it; `disturbance` (3, 3) slow, fast and the running mean of what
    is left. Return False, with the disturbance as it was, if the pair is absurd and must not be
    learned: a regressor of 1e6 would leave 1e-4 of rounding in the Gram for good.
    """
    for j in range(phi.shape[0]):
        if not abs(phi[j]) < limit:
            return False
    for i in range(y.shape[0]):
        value = measured[i] if i < 3 else np.float64(features[i - 3])
        if residual:
            value -= phi[i]
            if i < 3:
                value /= step_scale[i]
        y[i] = value
        if not abs(value) < limit:
            return False
    for c in range(3):
        left = y[c]
        for j in range(phi.shape[0]):
            left -= theta[c, j] * phi[j]
        disturbance[2, c] += RESIDUAL_MEAN_GAIN * (left - disturbance[2, c])
        disturbance[0, c] += correction[1, c] * (left - disturbance[0, c])
        left -= disturbance[0, c]
        disturbance[1, c] += correction[3, c] * (left - disturbance[1, c])
    return True


@strict_kernel
def ewma_covariance(covariance, innovation, gain):  # type: ignore[no-untyped-def]
    """covariance += gain (innovation innovation' - covariance), all (3, ...)."""
    for i in range(3):
        for j in range(3):
            covariance[i, j] += gain * (innovation[i] * innovation[j] - covariance[i, j])
