# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Autocovariance of the residuals that the sensors' noise alone causes.

The observer corrects the simulated velocities towards the measured ones (`surrogate.residuals`).
So it passes a part of the odometry's noise on to the simulation: the residuals of the odometry
become smaller than its noise, those of the IMU larger, and all of them correlated. How much
depends on the car and its speed. Noise of the recording's size is therefore added to the
recording's odometry; what that changes in the residuals is the noise passed on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.surrogate.error_autocovariance import MAX_LAG, autocovariance
from adk_ros.mismatch.surrogate.residuals import (
    MAX_RESIDUAL,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import ODOMETRY_V_X
from adk_ros.numerics.arrays import FloatArray

_DRAWS = 4
"""Draws of the noise; an autocovariance over 200 s is then within 1 % of the noise variance."""


def passed_noise_autocovariance(
    problem: ResidualProblem, parameters: FloatArray, terms: ActiveTerms
) -> FloatArray:
    """
    Return what the observer adds to the autocovariance of the noise (6, lags + 1).

    In units of the variance of a bin's noise, which itself has the autocovariance delta(k).
    Zero for parameters under which the simulation diverges.
    """
    base = problem.residuals(parameters, terms)
    if np.abs(base).max() >= MAX_RESIDUAL:
        return np.zeros((base.shape[0], MAX_LAG + 1))
    scale = problem.bin_noise[:, None]
    total = np.zeros((base.shape[0], MAX_LAG + 1))
    generator = np.random.default_rng(0)
    log = problem.log
    for _ in range(_DRAWS):
        noise = generator.standard_normal(log.odometry.shape) * problem.sigma[ODOMETRY_V_X:]
        noisy = prepare_residual_problem(
            replace(log, odometry=log.odometry + noise), problem.sigma
        )
        own = np.zeros_like(base)
        for i in range(noise.shape[1]):
            channel = ODOMETRY_V_X + i
            sums = np.bincount(problem.odometry_bin, noise[:, i], problem.bins)
            own[channel] = sums / np.maximum(problem.counts[channel], 1.0)
        changed = (noisy.residuals(parameters, terms) - base) / scale
        own /= scale
        for channel in range(base.shape[0]):
            total[channel] += autocovariance(changed[channel]) - autocovariance(own[channel])
    return total / _DRAWS
