# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The noise that the observer passes on from the odometry to the simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.error_autocovariance import autocovariance
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.passed_noise import passed_noise_autocovariance
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.state_index import IMU_A_X, IMU_A_Y, ODOMETRY_V_X
from adk_ros.numerics.arrays import FloatArray

SIGMA = np.array([0.1, 0.1, 0.002, 0.03, 0.03, 0.003])


def drives(seed: int) -> tuple[SensorLog, SensorLog]:
    """A drive without noise, and the same drive with noise of `SIGMA`."""
    log, rng = case().simulation, np.random.default_rng(seed)
    return log, replace(
        log,
        imu=log.imu + SIGMA[:3] * rng.normal(size=log.imu.shape),
        odometry=log.odometry + SIGMA[3:] * rng.normal(size=log.odometry.shape),
    )


def parameters() -> FloatArray:
    return case().nominal.parameters()


def test_it_is_that_of_a_noisy_drive() -> None:
    clean, noisy = (prepare_residual_problem(log, SIGMA) for log in drives(3))
    p = parameters()
    changed = (noisy.residuals(p) - clean.residuals(p)) / noisy.bin_noise[:, None]
    passed = passed_noise_autocovariance(noisy, p, noisy.no_terms())
    for channel in range(6):
        seen = autocovariance(changed[channel])
        seen[0] -= 1.0
        # 4.5 standard deviations of an autocovariance of white noise: of 186, none is larger.
        assert seen == pytest.approx(passed[channel], abs=4.5 / np.sqrt(clean.bins))
    # The simulated lateral acceleration follows the noise of the velocities, for several bins.
    assert passed[IMU_A_Y, 0] > 0.05
    assert passed[IMU_A_Y, 2] > 0.5 * passed[IMU_A_Y, 0]
    assert passed[IMU_A_X] == pytest.approx(0.0, abs=0.01)
    # The simulated speed follows the measured one: their difference is smaller than the noise.
    assert passed[ODOMETRY_V_X, 0] < 0.0


def test_a_correct_model_has_the_expected_loss() -> None:
    n = len(SIGMA)
    surrogate = SurrogateModel(
        parameters(), np.zeros(n), np.zeros((n, 100)), np.empty((0, parameters().size))
    )
    clean, noisy = (prepare_residual_problem(log, SIGMA) for log in drives(4))
    likelihood = Likelihood.of(noisy, surrogate)
    inputs = likelihood.simulation_inputs(np.zeros(likelihood.n_nuisances), [])
    # Only what the noise changes: the surrogate of this test is not fitted.
    white = likelihood.whiten(noisy.residuals(*inputs) - clean.residuals(*inputs))
    counted = likelihood.weights > 0.0
    for channel in range(6):
        values = white[channel][counted[channel]]
        # Chance: 0.04, of 1500 values.
        assert np.mean(values**2) == pytest.approx(1.0, abs=0.1)
        assert abs(np.mean(values[1:] * values[:-1])) < 0.1


def test_a_diverging_model_passes_nothing_on() -> None:
    problem = prepare_residual_problem(drives(5)[1], SIGMA)
    p = np.full_like(parameters(), 1e9)
    assert not passed_noise_autocovariance(problem, p, problem.no_terms()).any()
