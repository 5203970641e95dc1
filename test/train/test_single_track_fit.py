# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identification of the single-track model from simulated drives."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers.model import CAR

from adk_ros.errors import UsageError
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.lifting.single_track import single_track_change
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.train import network_fit
from adk_ros.train.dataset import Sequences
from adk_ros.train.network import Network, as_tensor
from adk_ros.train.network_fit import fit, scaling_of
from adk_ros.train.single_track_fit import (
    SingleTrack,
    filtered_commands,
    fit_single_track,
    lag_weights,
)
from adk_ros.train.train_settings import TrainSettings

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


def errors(single: SingleTrack, part: Sequences, scaling: Scaling) -> FloatArray:
    """The mean square error (3,) of an untrained network, in units of that of persistence."""
    network = Network(HISTORY, 4, 1, scaling.step_scale, None, single)
    x, u = as_tensor(scaling.scale_x(part.x)), as_tensor(scaling.scale_u(part.u))
    rows = part.rows[::20]
    past = np.arange(HISTORY + 1)
    with torch.no_grad():
        states = network.roll_out(
            x[rows[:, None] - past],
            u[rows[:, None] - 1 - past[:-1]],
            u[rows[:, None] + np.arange(60)],
        ).numpy()
    reference = scaling.scale_x(part.x_ref)[rows[:, None] + 1 + np.arange(60)]
    still = scaling.scale_x(part.x)[rows][:, None] - reference
    found = ((states - reference) ** 2).mean(axis=(0, 1)) / (still**2).mean(axis=(0, 1))
    return np.asarray(found)


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
        assert (errors(single, test, scaling_of(part)) < 0.02).all()


def test_without_past_samples_or_rollouts_there_is_none() -> None:
    part = driven(0)
    scaling = scaling_of(part)
    assert fit_single_track(replace(part, history=0), scaling) is None
    assert fit_single_track(replace(part, ahead=1), scaling) is None
    assert fit_single_track(replace(part, history=1), scaling) is not None
    with pytest.raises(UsageError, match="single_track needs a history of at least 1"):
        TrainSettings(single_track=True, history=0)


def test_a_state_that_is_not_measured_is_left_out() -> None:
    """Of a production car, v_y is a constant zero."""
    part = driven(0)
    x = part.x * [1.0, 0.0, 1.0]
    without = replace(part, x=x, x_ref=x)
    single = fit_single_track(without, scaling_of(without))
    assert single is not None
    assert np.isfinite(single.car).all()
    assert np.isfinite(single.limits).all()


def record_of(part: Sequences, name: str) -> Record:
    n = len(part.x)
    zeros = np.zeros(n, dtype=np.int64)
    stamp_ns = np.arange(n) * TICK_NS
    return Record(stamp_ns, part.x, part.u, np.zeros((n, 2)), zeros, part.x_ref, zeros, name)


def test_it_is_used_only_if_it_predicts_the_validation_part() -> None:
    settings = TrainSettings(
        steps=10, batch=32, hidden=8, validate_every=10, single_track=True, quadratic=False
    )
    right = record_of(driven(0), "right")
    assert fit([right], [record_of(driven(1), "other")], settings).single_track is not None
    random = np.random.default_rng(3)
    unrelated = replace(right, u=right.u[random.permutation(len(right.u))])
    assert fit([unrelated], [unrelated], settings).single_track is None


def test_beside_quadratic_features_it_must_make_them_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = TrainSettings(
        steps=10, batch=32, hidden=8, validate_every=10, single_track=True, history=2
    )
    data = [record_of(driven(0), "right")], [record_of(driven(1), "other")]
    losses = iter([0.05, 0.4, 0.04, 0.05])
    monkeypatch.setattr(network_fit._Trainer, "validate", lambda _: next(losses, 0.01))
    assert fit(*data, settings).single_track is not None
    losses = iter([0.05, 0.4, 0.06, 0.05])
    assert fit(*data, settings).single_track is None


def test_lag_weights_are_means_over_a_tick_and_sum_to_one() -> None:
    weights = lag_weights(0.05, 60)
    assert weights.sum() == pytest.approx(1.0)
    # A step at the start of a tick: 1 - exp(-t / lag), averaged over the ticks.
    step = np.cumsum(weights)
    t = 0.025 * np.arange(61)
    mean = 1.0 - 0.05 / 0.025 * (np.exp(-t / 0.05) - np.exp(-(t + 0.025) / 0.05))
    np.testing.assert_allclose(step[:40], mean[:40], atol=1e-9)
