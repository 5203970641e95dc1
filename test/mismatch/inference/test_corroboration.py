# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where much is unexplained, two measured channels must show a claim in held-out data."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.block_scores import BLOCK_S, block_duration
from adk_ros.mismatch.inference.corroboration import (
    _is_positive,
    corroborating_channels,
    is_corroborated,
)
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem

SPLIT_S = 60.0


@cache
def likelihoods(copied: bool = False) -> tuple[Likelihood, Likelihood]:
    """Of the training part and of all of a recording, with a surrogate of the nominal car."""
    c = case()
    log = c.recording
    if copied:
        imu = log.imu.copy()
        imu[:, 2] = np.interp(log.imu_s, log.odometry_s, log.odometry[:, 2])
        log = replace(log, imu=imu)
    problem = prepare_residual_problem(log)
    parameters, zero = c.nominal.parameters(), np.zeros(6)
    surrogate = SurrogateModel(parameters, zero, np.zeros((6, 1)), np.empty((0, parameters.size)))
    return Likelihood.of(problem, surrogate, SPLIT_S), Likelihood.of(problem, surrogate)


def of(name: str, theta: float, copied: bool = False) -> Hypothesis:
    training, _ = likelihoods(copied)
    active = ActiveEffect(EFFECTS[name], (theta,), ALWAYS_ACTIVE)
    return Hypothesis((active,), np.zeros(training.n_nuisances), 1e9)


def without(copied: bool = False) -> Hypothesis:
    training, _ = likelihoods(copied)
    return Hypothesis((), np.zeros(training.n_nuisances), 1e9)


def shown(better: Hypothesis, worse: Hypothesis, copied: bool = False) -> list[str]:
    return corroborating_channels(*likelihoods(copied), better, worse)


def test_a_moment_shows_in_gyro_and_odometry() -> None:
    channels = shown(without(), of("steering_ratio", 1.4))
    assert {"imu_yaw_rate", "yaw_rate"} <= set(channels)
    assert not set(shown(of("steering_ratio", 1.4), without())) & {"imu_yaw_rate", "yaw_rate"}


def test_a_sensor_alone_is_one_channel() -> None:
    assert shown(without(), of("gyro_scale", 1.1)) == ["imu_yaw_rate"]


def test_a_copy_is_no_second_measurement() -> None:
    channels = shown(without(True), of("steering_ratio", 1.4, True), True)
    assert "yaw_rate" in channels
    assert "imu_yaw_rate" not in channels


def test_a_claim_of_one_channel_is_not_corroborated() -> None:
    training, whole = likelihoods()
    assert is_corroborated(replace(of("gyro_scale", 1.1), loss=1.0), training, whole, 1.0)
    assert not is_corroborated(of("gyro_scale", 1.1), training, whole, 1.0)
    assert is_corroborated(without(), training, whole, 1.0)


@pytest.mark.parametrize(("scale", "duration_s"), [(1.0, BLOCK_S), (0.5, 3.54), (0.12, 2.4)])
def test_blocks_of_scale_models_are_shorter(scale: float, duration_s: float) -> None:
    assert block_duration(scale) == pytest.approx(duration_s, abs=0.01)


@pytest.mark.parametrize(
    ("gains", "shown"),
    [
        # A term that acts hard in one bend: the mean is 1.1 standard errors above zero.
        ([2372.0, 3395.0, 17993.0, 90597.0, 620.0, 11.0, 13753.0, 1.0, 11134.0], True),
        ([5.0, 6.0, 4.0, 5.0, 7.0], True),
        ([5.0, 6.0, 4.0, 5.0], False),
        # One block gains much, the others lose.
        ([9000.0, -3.0, -2.0, -5.0, -1.0, -4.0, -2.0, -3.0, -6.0], False),
        ([3.0, -2.0, 1.0, -4.0, 2.0, -1.0, 5.0, -3.0], False),
        ([0.0] * 8, False),
    ],
)
def test_blocks_show_a_claim_by_rank(gains: list[float], shown: bool) -> None:
    assert _is_positive(np.array(gains)) is shown
