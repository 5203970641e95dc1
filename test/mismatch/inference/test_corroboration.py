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
from adk_ros.mismatch.inference.corroboration import corroborating_channels, is_corroborated
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
