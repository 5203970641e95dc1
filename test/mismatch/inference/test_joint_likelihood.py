# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint likelihood: that of each recording, with IMU offsets of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.mismatch import CAR, case

from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES, TOLERANCE_PARAMETERS
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.sensor_log import MIN_SENSOR_NOISE
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.joined_problem import JoinedProblem
from adk_ros.signals.score import WHITE_NOISE_VARIANCE_ERROR, white_noise

WEAK = np.zeros((1, SIZE))
WEAK[0, INDEX["stiffness_f"]] = 0.5
SPLITS_S = (65.0, 110.0)


@cache
def joint() -> JointLikelihood:
    logs = (case().recording, case().held_out)
    problem = JoinedProblem.of(logs, [log.noise() for log in logs])
    residuals = problem.bin_noise[:, None] * np.random.default_rng(1).standard_normal((6, 2000))
    surrogate = SurrogateModel(CAR.parameters(), np.zeros(6), residuals, WEAK)
    parts = [
        Likelihood.of(part, surrogate, until)
        for part, until in zip(problem.parts, SPLITS_S, strict=True)
    ]
    return JointLikelihood.joined(problem, surrogate, parts)


def bins_of(likelihood: Likelihood) -> list[slice]:
    assert isinstance(likelihood.problem, JoinedProblem)
    return likelihood.problem.bin_slices


def channels_of(likelihood: Likelihood, nuisances: np.ndarray) -> np.ndarray:
    bins = likelihood.problem.bins
    return likelihood.residuals(nuisances, [])[: 6 * bins].reshape(6, bins)


def test_residuals_are_those_of_each_recording() -> None:
    whole = joint()
    none = np.zeros(whole.n_nuisances)
    each = [channels_of(part, none[: part.n_nuisances]) for part in whole.parts]
    np.testing.assert_array_equal(channels_of(whole, none), np.concatenate(each, axis=1))
    dof = sum(part.surrogate_error_dof() for part in whole.parts)
    assert whole.surrogate_error_dof() == pytest.approx(dof)
    variance = sum(part.noise_loss_variance() for part in whole.parts)
    assert whole.noise_loss_variance() == pytest.approx(variance)


def test_the_loss_of_a_perfect_model_is_as_uncertain_as_the_noise() -> None:
    """With a relative error e of its noise variance, a channel's loss changes by n e."""
    part = joint().parts[0]
    counted = np.count_nonzero(part.weights, axis=1) * (1.0 - part.surrogate_error_share)
    samples = part.problem.counts.sum(axis=1)
    estimated = part.problem.sigma > MIN_SENSOR_NOISE
    deviations = np.sqrt(WHITE_NOISE_VARIANCE_ERROR / samples) * estimated
    assert part.noise_loss_variance() == pytest.approx(np.sum((counted * deviations) ** 2))
    known = replace(part, problem=replace(part.problem, sigma=MIN_SENSOR_NOISE))
    assert known.noise_loss_variance() == 0.0


@pytest.mark.parametrize("samples_per_bin", [2, 4])
def test_the_spread_of_losses_over_estimated_noise(samples_per_bin: int) -> None:
    """Of n bins: 2 n with known noise, and 9.1 n over the samples of a bin by its estimate."""
    bins, repetitions = 1000, 1500
    random = np.random.default_rng(1)
    samples = random.standard_normal((bins * samples_per_bin, repetitions))
    sigma = white_noise(samples)
    means = samples.reshape(bins, samples_per_bin, repetitions).mean(axis=1)
    losses = samples_per_bin * np.sum(means**2, axis=0) / sigma**2
    expected = 2.0 + WHITE_NOISE_VARIANCE_ERROR / samples_per_bin
    assert losses.var() / bins == pytest.approx(expected, rel=0.15)


def test_each_recording_has_a_training_part() -> None:
    whole = joint()
    counted, held_out = (whole.weights > 0.0).any(axis=0), whole.held_out_bins()
    assert not (counted & held_out).any()
    assert [bool(held_out[bins].any()) for bins in bins_of(whole)] == [True, True]
    assert whole.problem.bin_s[counted].max() < SPLITS_S[1]


def test_imu_offsets_are_those_of_each_recording() -> None:
    whole = joint()
    assert whole.n_nuisances == N_FIXED_NUISANCES + 1 + 3
    sizes = {
        values.shape
        for values in (
            whole.nuisance_steps(), whole.nuisance_bounds(), whole.nuisance_deviations()
        )
    }  # fmt: skip
    assert sizes == {(whole.n_nuisances,)}
    none = np.zeros(whole.n_nuisances)
    before = channels_of(whole, none)
    first, second = bins_of(whole)
    for entry, own, other in (
        (len(TOLERANCE_PARAMETERS), first, second), (whole.n_nuisances - 3, second, first)
    ):  # fmt: skip
        nuisances = none.copy()
        nuisances[entry] = 0.01
        change = np.abs(channels_of(whole, nuisances) - before)
        assert change[0, own].max() > 0.1
        np.testing.assert_allclose(change[:, other], 0.0, atol=1e-12)
        np.testing.assert_allclose(change[1:], 0.0, atol=1e-12)


def test_weak_directions_are_common() -> None:
    whole = joint()
    nuisances = np.zeros(whole.n_nuisances)
    nuisances[N_FIXED_NUISANCES] = 1.0
    p, _ = whole.simulation_inputs(nuisances, [])
    expected = CAR.parameters()[INDEX["stiffness_f"]] + 0.5
    assert p[INDEX["stiffness_f"]] == pytest.approx(expected)


def test_a_restriction_leaves_one_recording() -> None:
    whole = joint()
    none = np.zeros(whole.n_nuisances)
    part = whole.restricted_to({1})
    left = channels_of(part, none)
    first, second = bins_of(whole)
    assert np.abs(left[:, first]).max() == 0.0
    np.testing.assert_array_equal(left[:, second], channels_of(whole, none)[:, second])
    n_distances = part.residuals(none, []).shape[0] - left.size
    assert n_distances == whole.parts[1].distance_residuals(CAR.parameters()).shape[0]
