# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identification of the single-track model from simulated drives."""

import functools

import numpy as np
import pytest
from helpers.model import CAR

from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.lifting.single_track import single_track_change
from adk_ros.numerics.arrays import FloatArray
from adk_ros.train.dataset import Sequences
from adk_ros.train.network_fit import single_track_of
from adk_ros.train.single_track_fit import (
    filtered_commands,
    fit_single_track,
    lag_weights,
    single_track_loss,
)

LAGS = (0.03, 0.05)
HISTORY = 5


@functools.cache
def driven(seed: int, noise: float = 0.0, speed: float = 18.0, rows: int = 2400) -> Sequences:
    """A drive of the single-track model itself, at up to 0.8 of the grip, with sensor noise."""
    random = np.random.default_rng(seed)
    t = 0.025 * np.arange(rows)
    phase = random.uniform(0.0, 6.0, 6)
    waves = np.sin(t[:, None] * [0.5, 1.3, 2.9, 0.2, 0.7, 1.9] + phase)
    steer, pedal = waves[:, :3].sum(axis=1), waves[:, 3:].sum(axis=1)
    u = np.column_stack([150.0 + 500.0 * pedal, 0.02 * steer])
    acting = filtered_commands(u, LAGS, 40)
    x = np.zeros((rows, 3))
    x[:41, 0] = speed
    car = np.array(CAR)
    for k in range(40, rows - 1):
        change = single_track_change(x[k, 0], x[k, 1], x[k, 2], acting[k, 0], acting[k, 1], car)
        x[k + 1] = x[k] + change[:3]
    sigma = noise * np.array([0.03, 0.02, 0.005])
    measured = x + sigma * random.normal(size=x.shape)
    starts = np.arange(60, rows - 80)
    return Sequences(measured, x, u, starts, HISTORY, 60)


def scaling_of(part: Sequences) -> Scaling:
    return Scaling.standard(part.x[part.rows], part.u[part.rows], np.diff(part.x_ref, axis=0))


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_simulated_car_is_found(noise: float) -> None:
    part = driven(0, noise)
    single = fit_single_track(part, scaling_of(part))
    assert single is not None
    for name in ("front", "rear", "yaw", "drive", "front_stiffness", "rear_stiffness"):
        assert getattr(single.parameters, name) == pytest.approx(getattr(CAR, name), rel=0.12), (
            name
        )
    assert single.lags == pytest.approx(LAGS, abs=0.015)
    other = driven(1)
    # At half the speed, which the training data do not contain.
    slow = driven(2, speed=9.0)
    for test in (other, slow):
        assert (single_track_loss(single, test, 60) < 0.01).all()


def test_without_past_samples_or_skill_there_is_none() -> None:
    part = driven(0)
    alone = Sequences(part.x, part.x_ref, part.u, part.rows, 0, 60)
    assert fit_single_track(alone, scaling_of(part)) is None
    random = np.random.default_rng(3)
    shuffled = part.u[random.permutation(len(part.u))]
    unrelated = Sequences(part.x, part.x_ref, shuffled, part.rows, HISTORY, 60)
    assert single_track_of(unrelated, unrelated, scaling_of(part)) is None
    assert single_track_of(part, driven(1), scaling_of(part)) is not None


def test_lag_weights_are_means_over_a_tick_and_sum_to_one() -> None:
    weights = lag_weights(0.05, 60)
    assert weights.sum() == pytest.approx(1.0)
    # A step at the begin of a tick: 1 - exp(-t / lag), averaged over the ticks.
    step = np.cumsum(weights)
    t = 0.025 * np.arange(61)
    mean = 1.0 - 0.05 / 0.025 * (np.exp(-t / 0.05) - np.exp(-(t + 0.025) / 0.05))
    np.testing.assert_allclose(step[:40], mean[:40], atol=1e-9)


def constant(part: Sequences, value: FloatArray) -> Sequences:
    x = np.tile(value, (len(part.x), 1))
    return Sequences(x, x, part.u, part.rows, HISTORY, 60)


def test_a_parked_car_does_not_stop_the_training() -> None:
    parked = constant(driven(0), np.zeros(3))
    assert single_track_of(parked, parked, scaling_of(parked)) is None
