# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled rollouts against their equations."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from helpers.model import Array, random_lift, weights

from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.uncertainty import compiled_rollout
from adk_ros.model.uncertainty.error_regression import N_REGRESSORS
from adk_ros.model.uncertainty.motion_limits import step_bounds

Random = np.random.Generator
NO_CORRECTION = np.zeros((1, 3, 3)), np.zeros((0, 3, N_REGRESSORS + 1)), np.ones((0, 3))
"""Disturbance, weights and shrinkage that leave a prediction unchanged."""
PLAIN = Scaling(np.zeros(3), np.ones(3), np.zeros(2), np.ones(2), np.ones(3))
NO_BOUNDS = step_bounds(np.zeros(0), PLAIN)


@pytest.fixture
def random() -> Random:
    return np.random.default_rng(0)


def test_to_si() -> None:
    states, start = np.arange(6.0).reshape(2, 3), np.ones(3)
    scaling = (np.array([1.0, 2.0, 3.0]), np.array([10.0, 100.0, 1.0]))
    kept = states.copy()
    assert compiled_rollout.to_si(states, start, *NO_CORRECTION, *scaling)
    assert states.tolist() == [[1.0, 102.0, 5.0], [31.0, 402.0, 8.0]]
    shrinkage = np.array([[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]])
    no_error = np.ones((1, 3, 3)), np.zeros((2, 3, N_REGRESSORS + 1))
    assert compiled_rollout.to_si(kept, start, *no_error, shrinkage, *scaling)
    assert kept.tolist() == [[1.0, 102.0, 4.0], [11.0, 252.0, 8.0]]
    longer = np.tile(np.array([1.0, 1.0, 5.0]), (3, 1))
    assert compiled_rollout.to_si(longer, start, *no_error, shrinkage, np.zeros(3), np.ones(3))
    assert longer[:, 2].tolist() == [1.0, 5.0, 5.0]
    zero, one = np.zeros(3), np.ones(3)
    for bad in (np.nan, np.inf):
        assert not compiled_rollout.to_si(
            np.array([[0.0, bad, 0.0]]), start, *NO_CORRECTION, zero, one
        )


def test_to_si_adds_the_predicted_error_and_shrinks_the_change() -> None:
    random = np.random.default_rng(0)
    states, start, disturbance = random.normal(size=(4, 3)), np.ones(3), random.normal(size=(3, 3))
    regressors = np.array(
        [[*disturbance[2], disturbance[0, c], disturbance[1, c]] for c in range(3)]
    )
    weights, shrinkage = random.normal(size=(2, 3, N_REGRESSORS + 1)), random.uniform(size=(2, 3))
    weights[..., N_REGRESSORS] = 1e3
    last_repeated = [0, 1, 1, 1]
    change = (
        states
        - start
        + np.einsum("hck,ck->hc", weights[last_repeated, :, :N_REGRESSORS], regressors)
    )
    assert compiled_rollout.to_si(
        states, start, disturbance[None], weights, shrinkage, np.zeros(3), np.ones(3)
    )
    np.testing.assert_allclose(states, start + shrinkage[last_repeated] * change)
    broken = np.full((1, 3), np.nan)
    assert not compiled_rollout.to_si(
        broken, start, disturbance[None], weights, np.ones((1, 3)), np.zeros(3), np.ones(3)
    )
    # Large values are clamped to the range of rollouts.
    far = np.zeros((1, 3))
    assert compiled_rollout.to_si(
        far, start, disturbance[None], 1e300 * weights, np.ones((1, 3)), np.zeros(3), np.ones(3)
    )
    assert (np.abs(far) == 50.0).all()


def test_last_command_is_repeated(random: Random) -> None:
    encoder, out = random_lift(1, 4, 2), np.empty((2, 30, 3))
    theta = random.normal(0.0, 0.1, (5, 8))
    for u_ahead, of in ((np.ones((1, 2)), out[0]), (np.ones((30, 2)), out[1])):
        compiled_rollout.rollout_lifting(
            np.zeros((2, 3)), np.zeros((1, 2)), theta, u_ahead, np.zeros((2, 3)), True, True, of,
            np.ones(3), np.ones((5, 3)), NO_BOUNDS, *weights(encoder),
        )  # fmt: skip
    np.testing.assert_array_equal(out[0], out[1])
    assert np.abs(out[0]).max() > 0.1


def expected_rollout(
    features_of: Callable[[Array], Array], x_past: Array, u_past: Array, theta: Array, step: Array,
    residual: bool, affine: bool, u_ahead: Array, disturbance: Array, decays: Array,
) -> Array:  # fmt: skip
    """The equations of the predictor's docstring."""
    xs, us = list(x_past), list(u_past)
    result = []
    for j, u in enumerate(u_ahead):
        commands = [u, *us[: len(u_past)]] if len(u_past) else []
        row = np.concatenate([*xs[: len(x_past)], *commands])
        phi = np.concatenate([xs[0], features_of(row), u, [1.0] if affine else []])
        change = step * (theta[:3] @ phi + (disturbance * decays**j).sum(axis=0))
        xs.insert(0, change + xs[0] if residual else change)
        us.insert(0, u)
        result.append(xs[0])
    return np.array(result)


@pytest.mark.parametrize("history", [0, 2, 5])
@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("affine", [True, False])
def test_rollout_lifting(history: int, residual: bool, affine: bool, random: Random) -> None:
    torch.manual_seed(1)
    encoder, n_z = random_lift(history, 16, 5), 8
    n_phi = n_z + 2 + affine
    theta = random.normal(0.0, 0.03, (n_z, n_phi))
    theta[:3, :3] -= 0.3 * np.eye(3)
    x_past, u_past = random.normal(size=(history + 1, 3)), random.normal(size=(history, 2))
    u_ahead, disturbance = random.normal(size=(60, 2)), random.normal(size=(2, 3))
    decays = np.array([[0.9, 0.99, 1.0], [0.5, 0.8, 0.0]])
    step = np.array([0.05, 0.1, 0.2])
    gains = replace(ObserverGains.none(), slow_decay=decays[0], fast_decay=decays[1]).table()
    out = np.empty((60, 3))
    given = (x_past, u_past, theta, u_ahead, disturbance, gains, step)
    before = [array.copy() for array in given]
    compiled_rollout.rollout_lifting(
        x_past, u_past, theta, u_ahead, disturbance, residual, affine, out, step, gains,
        NO_BOUNDS, *weights(encoder),
    )  # fmt: skip

    def features_of(row: Array) -> Array:
        with torch.no_grad():
            return np.asarray(encoder(torch.tensor(row[None], dtype=torch.float32))[0].double())

    expected = expected_rollout(
        features_of, x_past, u_past, theta, step, residual, affine, u_ahead, disturbance, decays
    )  # fmt: skip
    np.testing.assert_allclose(out, expected, atol=2e-4, rtol=2e-4)
    for array, kept in zip(given, before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_rollout_lifting_clamps_states_and_reports_nan(random: Random) -> None:
    encoder = random_lift(0, 4, 2)
    theta, out = np.zeros((5, 8)), np.empty((20, 3))
    past = (np.zeros((1, 3)), np.zeros((0, 2)))
    constant: tuple[Any, ...] = (
        np.ones((20, 2)), np.zeros((2, 3)), True, True, out, np.ones(3), np.ones((5, 3)),
        NO_BOUNDS, *weights(encoder),
    )  # fmt: skip
    theta[:3, :3] = 3.0 * np.eye(3)
    theta[0, 7], theta[1, 7] = 1.0, -1.0
    compiled_rollout.rollout_lifting(*past, theta, *constant)
    assert out[-1].tolist() == [50.0, -50.0, 0.0]
    theta[1, 0] = np.nan
    compiled_rollout.rollout_lifting(*past, theta, *constant)
    assert not compiled_rollout.to_si(out, np.zeros(3), *NO_CORRECTION, np.zeros(3), np.ones(3))


def test_rollout_lifting_keeps_to_the_limits_of_motion() -> None:
    """A model that feeds its own error back: without limits it reaches the clamp."""
    encoder, theta, out = random_lift(0, 4, 2), np.zeros((5, 8)), np.empty((80, 3))
    theta[:3, :3], theta[:3, 7] = 3.0 * np.eye(3), [1.0, 0.1, 0.1]
    scaling = replace(PLAIN, x_mean=np.array([20.0, 0.0, 0.0]), x_scale=np.array([5.0, 0.5, 0.2]))
    bounds = step_bounds(np.array([10.0, 8.0, 5.0, 12.0]), scaling)
    compiled_rollout.rollout_lifting(
        np.zeros((1, 3)), np.zeros((0, 2)), theta, np.zeros((1, 2)), np.zeros((2, 3)), True, True,
        out, np.ones(3), np.ones((5, 3)), bounds, *weights(encoder),
    )  # fmt: skip
    states = np.vstack([np.zeros(3), out]) * scaling.x_scale + scaling.x_mean
    rates = np.abs(np.diff(states, axis=0)) / 0.025
    assert (rates <= np.array([10.0, 8.0, 5.0]) + 1e-9).all()
    lateral = np.abs(states[:, 0] * states[:, 2])
    assert rates.max(axis=0).tolist() == pytest.approx([10.0, 8.0, 5.0])
    assert 11.9 < lateral.max() < 12.0 + 1e-9


def test_rollout_linear_equals_matrix_powers(random: Random) -> None:
    a = 0.95 * np.linalg.qr(random.normal(size=(7, 7)))[0]
    b = random.normal(size=(7, 2))
    z, u = random.normal(size=7), random.normal(size=(40, 2))
    out = np.empty((40, 3))
    kept = z.copy()
    compiled_rollout.rollout_linear(z, np.hstack([a, b]), u, out)
    for h in (1, 2, 10, 40):
        power = np.linalg.matrix_power
        expected = power(a, h) @ z + sum(power(a, h - 1 - j) @ b @ u[j] for j in range(h))
        np.testing.assert_allclose(out[h - 1], expected[:3], atol=1e-10)
    np.testing.assert_array_equal(z, kept)


def test_rollout_linear_clamps_states() -> None:
    theta, out = np.hstack([2 * np.eye(4), np.zeros((4, 2))]), np.empty((100, 3))
    compiled_rollout.rollout_linear(np.ones(4), theta, np.zeros((100, 2)), out)
    assert out.max() == 50.0
