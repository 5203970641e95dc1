# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled roll-outs against their equations."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers.model import Array, random_lift, weights

from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.uncertainty import compiled_rollout
from adk_ros.model.uncertainty.error_regression import N_REGRESSORS

Random = np.random.Generator
ALL = np.zeros((1, 3, 3)), np.zeros((0, 3, N_REGRESSORS + 1)), np.ones((0, 3))
"""Disturbance, its weights and trust of a prediction that is left as it is."""


@pytest.fixture
def random() -> Random:
    return np.random.default_rng(0)


def test_to_si() -> None:
    states, start = np.arange(6.0).reshape(2, 3), np.ones(3)
    scaling = (np.array([1.0, 2.0, 3.0]), np.array([10.0, 100.0, 1.0]))
    kept = states.copy()
    assert compiled_rollout.to_si(states, start, *ALL, *scaling)
    assert states.tolist() == [[1.0, 102.0, 5.0], [31.0, 402.0, 8.0]]
    trust = np.array([[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]])
    untold = np.ones((1, 3, 3)), np.zeros((2, 3, N_REGRESSORS + 1))
    assert compiled_rollout.to_si(kept, start, *untold, trust, *scaling)
    assert kept.tolist() == [[1.0, 102.0, 4.0], [11.0, 252.0, 8.0]]
    longer = np.tile(np.array([1.0, 1.0, 5.0]), (3, 1))
    assert compiled_rollout.to_si(longer, start, *untold, trust, np.zeros(3), np.ones(3))
    assert longer[:, 2].tolist() == [1.0, 5.0, 5.0]
    zero, one = np.zeros(3), np.ones(3)
    for bad in (np.nan, np.inf):
        assert not compiled_rollout.to_si(np.array([[0.0, bad, 0.0]]), start, *ALL, zero, one)


def test_to_si_adds_what_is_foreseen_then_trusts_a_share() -> None:
    random = np.random.default_rng(0)
    states, start, gone = random.normal(size=(4, 3)), np.ones(3), random.normal(size=(3, 3))
    signs = np.array([[*gone[2], gone[0, c], gone[1, c]] for c in range(3)])
    weights, trust = random.normal(size=(2, 3, N_REGRESSORS + 1)), random.uniform(size=(2, 3))
    weights[..., N_REGRESSORS] = 1e3
    held = [0, 1, 1, 1]
    change = states - start + np.einsum("hck,ck->hc", weights[held, :, :N_REGRESSORS], signs)
    assert compiled_rollout.to_si(
        states, start, gone[None], weights, trust, np.zeros(3), np.ones(3)
    )
    np.testing.assert_allclose(states, start + trust[held] * change)
    broken = np.full((1, 3), np.nan)
    assert not compiled_rollout.to_si(
        broken, start, gone[None], weights, np.ones((1, 3)), np.zeros(3), np.ones(3)
    )
    # However large, it stays where roll-outs stay.
    far = np.zeros((1, 3))
    assert compiled_rollout.to_si(
        far, start, gone[None], 1e300 * weights, np.ones((1, 3)), np.zeros(3), np.ones(3)
    )
    assert (np.abs(far) == 50.0).all()


def test_commands_that_end_are_held(random: Random) -> None:
    encoder, out = random_lift(1, 4, 2), np.empty((2, 30, 3))
    theta = random.normal(0.0, 0.1, (5, 8))
    for u_ahead, of in ((np.ones((1, 2)), out[0]), (np.ones((30, 2)), out[1])):
        compiled_rollout.rollout_lifting(
            np.zeros((2, 3)), np.zeros((1, 2)), theta, np.ones(3), True, True, u_ahead,
            np.zeros((2, 3)), np.ones((5, 3)), *weights(encoder), of,
        )  # fmt: skip
    np.testing.assert_array_equal(out[0], out[1])
    assert np.abs(out[0]).max() > 0.1


def plain_roll_out(
    features_of: Callable[[Array], Array], x_past: Array, u_past: Array, theta: Array, step: Array,
    residual: bool, affine: bool, u_ahead: Array, disturbance: Array, decays: Array,
) -> Array:  # fmt: skip
    """The equations in the predictor's docstring, one line each."""
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
def test_roll_out_lifting(history: int, residual: bool, affine: bool, random: Random) -> None:
    torch.manual_seed(1)
    encoder, n_z = random_lift(history, 16, 5), 8
    n_phi = n_z + 2 + affine
    theta = random.normal(0.0, 0.03, (n_z, n_phi))
    theta[:3, :3] -= 0.3 * np.eye(3)
    x_past, u_past = random.normal(size=(history + 1, 3)), random.normal(size=(history, 2))
    u_ahead, disturbance = random.normal(size=(60, 2)), random.normal(size=(2, 3))
    decays = np.array([[0.9, 0.99, 1.0], [0.5, 0.8, 0.0]])
    step = np.array([0.05, 0.1, 0.2])
    correction = replace(ObserverGains.none(), slow_decay=decays[0], fast_decay=decays[1]).table()
    out = np.empty((60, 3))
    given = (x_past, u_past, theta, u_ahead, disturbance, correction, step)
    before = [array.copy() for array in given]
    compiled_rollout.rollout_lifting(
        x_past, u_past, theta, step, residual, affine, u_ahead, disturbance, correction,
        *weights(encoder), out,
    )  # fmt: skip

    def features_of(row: Array) -> Array:
        with torch.no_grad():
            return np.asarray(encoder(torch.tensor(row[None], dtype=torch.float32))[0].double())

    expected = plain_roll_out(
        features_of, x_past, u_past, theta, step, residual, affine, u_ahead, disturbance, decays
    )  # fmt: skip
    np.testing.assert_allclose(out, expected, atol=2e-4, rtol=2e-4)
    for array, kept in zip(given, before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_roll_out_lifting_is_bounded_and_shows_what_is_no_number(random: Random) -> None:
    encoder = random_lift(0, 4, 2)
    theta, out = np.zeros((5, 8)), np.empty((20, 3))
    fixed = (np.zeros((1, 3)), np.zeros((0, 2)))
    rest = (np.ones((20, 2)), np.zeros((2, 3)), np.ones((5, 3)), *weights(encoder), out)
    theta[:3, :3] = 3.0 * np.eye(3)
    theta[0, 7], theta[1, 7] = 1.0, -1.0
    compiled_rollout.rollout_lifting(*fixed, theta, np.ones(3), True, True, *rest)
    assert out[-1].tolist() == [50.0, -50.0, 0.0]
    theta[1, 0] = np.nan
    compiled_rollout.rollout_lifting(*fixed, theta, np.ones(3), True, True, *rest)
    assert not compiled_rollout.to_si(out, np.zeros(3), *ALL, np.zeros(3), np.ones(3))


def test_roll_out_linear_is_matrix_powers(random: Random) -> None:
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


def test_roll_out_linear_is_bounded() -> None:
    theta, out = np.hstack([2 * np.eye(4), np.zeros((4, 2))]), np.empty((100, 3))
    compiled_rollout.rollout_linear(np.ones(4), theta, np.zeros((100, 2)), out)
    assert out.max() == 50.0
