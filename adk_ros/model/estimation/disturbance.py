# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled disturbance estimators, and the regression pair of a tick that they start from.

    e = y - theta phi            one-step residual
    d <- d + g_d (e - d)         slow
    f <- f + g_f (e - d - f)     fast
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.numba_cache import strict_kernel

RESIDUAL_MEAN_GAIN = 0.1
"""
Gain per tick of the running mean of the residual: time constant 0.25 s. Empirical, not
calibrated.
"""
MAX_REGRESSION_VALUE = 1e3
"""
Scaled values at and above this are not learned from. A value of 1e6 would leave a rounding error
of 1e-4 in the Gram matrix for good; 1e3 leaves 1e-10.
"""


class RegressionArrays(NamedTuple):
    """
    What `regression_pair` reads and updates in place.

    `measured` (3,): present state, scaled; `phi` (n_phi,): regressor of the previous tick;
    `step_scale` (3,); `gains` (5, 3): `ObserverGains.table`; `disturbance` (3, 3): slow, fast and
    running mean of the residual; `y` (n_z,): target, written.
    """

    measured: FloatArray
    phi: FloatArray
    step_scale: FloatArray
    gains: FloatArray
    disturbance: FloatArray
    y: FloatArray


@strict_kernel
def regression_pair(
    features: Float32Array, theta: FloatArray, residual: bool, pair: RegressionArrays
) -> bool:
    """
    Compute the target y of the tick that has just ended, and update the disturbance estimates.

    `features` and `measured` form the present lifted state; `phi` begins with the previous one,
    with the observer's state in it. Return False, with the disturbance unchanged, if a value is
    too large or not a number: the pair must not be learned.
    """
    measured, phi, y, disturbance = pair.measured, pair.phi, pair.y, pair.disturbance
    for j in range(phi.shape[0]):
        if not abs(phi[j]) < MAX_REGRESSION_VALUE:
            return False
    for i in range(y.shape[0]):
        value = measured[i] if i < 3 else np.float64(features[i - 3])
        if residual:
            value -= phi[i]
            if i < 3:
                value /= pair.step_scale[i]
        y[i] = value
        if not abs(value) < MAX_REGRESSION_VALUE:
            return False
    for c in range(3):
        error = y[c]
        for j in range(phi.shape[0]):
            error -= theta[c, j] * phi[j]
        disturbance[2, c] += RESIDUAL_MEAN_GAIN * (error - disturbance[2, c])
        disturbance[0, c] += pair.gains[1, c] * (error - disturbance[0, c])
        error -= disturbance[0, c]
        disturbance[1, c] += pair.gains[3, c] * (error - disturbance[1, c])
    return True


@strict_kernel
def decay_disturbance(disturbance: FloatArray, gains: FloatArray) -> None:
    """
    Let the disturbances (3, 3), `RegressionArrays.disturbance`, decay by a tick without a pair.

    As they do along a horizon, so that coasting follows the one before it.
    """
    for c in range(3):
        disturbance[0, c] *= gains[2, c]
        disturbance[1, c] *= gains[4, c]


@strict_kernel
def ewma_covariance(covariance: FloatArray, innovation: FloatArray, gain: float) -> None:
    """covariance (3, 3) += gain (innovation innovation' - covariance)."""
    for i in range(3):
        for j in range(3):
            covariance[i, j] += gain * (innovation[i] * innovation[j] - covariance[i, j])
