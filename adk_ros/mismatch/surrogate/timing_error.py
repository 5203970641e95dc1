# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The time step's error of the surrogate in the longitudinal acceleration.

A sample of the IMU is the acceleration at its stamp, that of the surrogate the mean over the time
step around it. After a step of the torque, of a vehicle whose drive hardly lags, the two differ by
up to what a shift of the samples by half a time step changes, in either direction. A lateral
acceleration has no such steps: steering and tyres lag.
"""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.residuals import STEP_S, ResidualProblem
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import IMU_A_X, N_CHANNELS
from adk_ros.numerics.arrays import FloatArray


def timing_error(
    problem: ResidualProblem, parameters: FloatArray, terms: ActiveTerms, out: FloatArray
) -> FloatArray:
    """Return the largest change (6, b) that half a time step makes in residuals of `out`, SI."""
    unchanged = problem.residuals(parameters, terms, out)[IMU_A_X]
    largest = np.zeros_like(unchanged)
    for shift_s in (-0.5 * STEP_S, 0.5 * STEP_S):
        p = parameters.copy()
        p[INDEX["imu_delay"]] += shift_s
        shifted = problem.residuals(p, terms, out)[IMU_A_X]
        largest = np.maximum(largest, np.abs(shifted - unchanged))
    error = np.zeros((N_CHANNELS, largest.shape[0]))
    error[IMU_A_X] = largest
    return error
