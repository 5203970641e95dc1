# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled loops against plain numpy, torch and textbook formulae."""

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from model_tools import Array

from adk_ros.model import kernels
from adk_ros.model.lifting import input_size
from adk_ros.train.network import Encoder

Random = np.random.Generator


@pytest.fixture
def random() -> Random:
    return np.random.default_rng(0)


def weights(encoder: Encoder) -> list[Any]:
    names = ("w1", "b1", "w2", "b2", "w3", "b3", "skip")
    return [getattr(encoder, name).detach().numpy() for name in names]


@pytest.mark.parametrize(("history", "hidden", "features"), [
    (0, 1, 1), (0, 8, 4), (2, 16, 6), (4, 48, 12), (8, 31, 16), (1, 5, 3),
])  # fmt: skip
def test_perceptron_is_the_torch_module(
    history: int, hidden: int, features: int, random: Random
) -> None:
    torch.manual_seed(history)
    encoder = Encoder(history, hidden, features)
    scratch, out = np.empty((2, hidden), np.float32), np.empty(features, np.float32)
    for scale in (0.0, 0.1, 1.0, 30.0):
        row = (scale * random.normal(size=input_size(history))).astype(np.float32)
        with torch.no_grad():
            truth = encoder(torch.from_numpy(row)[None])[0].numpy()
        before = row.copy()
        kernels.perceptron(row, *weights(encoder), scratch, out)
        np.testing.assert_allclose(out, truth, rtol=1e-5, atol=1e-5 * max(1.0, scale))
        np.testing.assert_array_equal(row, before)


def test_where_no_cache_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed by root, run by somebody without a home: compiled at each start."""
    from numba.core.registry import CPUDispatcher

    def refuse(_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(CPUDispatcher, "enable_caching", refuse)
    spec = importlib.util.spec_from_file_location("kernels_without_cache", kernels.__file__)
    assert spec is not None
    assert spec.loader is not None
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    states = np.ones((1, 3))
    assert fresh.to_si(states, np.zeros(3), np.full(3, 2.0))
    assert states.tolist() == [[2.0, 2.0, 2.0]]


def test_fill_row_is_newest_first() -> None:
    row = np.zeros(13, np.float32)
    kernels.fill_row(np.arange(9.0).reshape(3, 3), np.arange(20.0, 24.0).reshape(2, 2), row)
    assert row.tolist() == [*range(9), *range(20, 24)]
    alone = np.zeros(3, np.float32)
    kernels.fill_row(np.array([[1.0, 2.0, 3.0]]), np.zeros((0, 2)), alone)
    assert alone.tolist() == [1.0, 2.0, 3.0]


def test_shift_in() -> None:
    past = np.arange(6.0).reshape(3, 2)
    kernels.shift_in(past, np.array([8.0, 9.0]))
    assert past.tolist() == [[8.0, 9.0], [0.0, 1.0], [2.0, 3.0]]
    empty = np.zeros((0, 2))
    kernels.shift_in(empty, np.array([8.0, 9.0]))
    assert empty.shape == (0, 2)


@pytest.mark.parametrize("history", [0, 1, 3])
def test_take_sample_over_many_ticks(history: int, random: Random) -> None:
    """Against the definition: row k = [x_k .. x_(k-p), u_(k-1) .. u_(k-p)], scaled."""
    x, u = random.normal(size=(12, 3)), random.normal(size=(12, 2))
    x_mean, x_scale = random.normal(size=3), random.uniform(0.5, 2.0, 3)
    u_mean, u_scale = random.normal(size=2), random.uniform(0.5, 2.0, 2)
    x_past, u_past, u_now = np.zeros((history + 1, 3)), np.zeros((history, 2)), np.zeros(2)
    row = np.zeros(input_size(history), np.float32)
    scaled_x, scaled_u = (x - x_mean) / x_scale, (u - u_mean) / u_scale
    for k in range(12):
        command = tuple(u[k].tolist())
        kernels.take_sample(
            x[k], command, x_mean, x_scale, u_mean, u_scale, x_past, u_past, u_now, row
        )  # fmt: skip
        if k >= history:
            past = [scaled_x[k - i] for i in range(history + 1)]
            past += [scaled_u[k - 1 - i] for i in range(history)]
            np.testing.assert_allclose(row, np.concatenate(past), rtol=1e-6)
            np.testing.assert_allclose(u_now, scaled_u[k])
            np.testing.assert_allclose(x_past[0], scaled_x[k])


@pytest.mark.parametrize("affine", [True, False])
def test_fill_phi(affine: bool) -> None:
    phi = np.full(6 + affine, np.nan)
    x, features = np.arange(6.0).reshape(2, 3), np.array([3.0], np.float32)
    kernels.fill_phi(x, features, np.array([7.0, 8.0]), affine, phi)
    assert phi.tolist() == [0.0, 1.0, 2.0, 3.0, 7.0, 8.0] + [1.0] * affine


@pytest.mark.parametrize("residual", [True, False])
def test_make_pair(residual: bool, random: Random) -> None:
    x, features = random.normal(size=(2, 3)), random.normal(size=2).astype(np.float32)
    phi, theta = random.normal(size=8), random.normal(size=(5, 8))
    step, gain, disturbance = np.array([0.1, 0.2, 0.5]), np.array([0.1, 0.0, 1.0]), np.ones(3)
    y = np.zeros(5)
    assert kernels.make_pair(
        x, features, phi, theta, step, residual, gain, disturbance, y, 1e3
    )  # fmt: skip
    z = np.concatenate([x[0], features])
    expected = z - phi[:5] if residual else z.copy()
    if residual:
        expected[:3] /= step
    np.testing.assert_allclose(y, expected)
    left = expected[:3] - theta[:3] @ phi
    np.testing.assert_allclose(disturbance, 1.0 + gain * (left - 1.0))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e4, -1e300])
@pytest.mark.parametrize("where", ["x", "features", "phi"])
def test_make_pair_refuses_what_is_absurd(bad: float, where: str, random: Random) -> None:
    """A regressor that large would leave its rounding in the Gram for good."""
    x, features, phi = random.normal(size=(1, 3)), np.ones(2, np.float32), np.ones(8)
    with np.errstate(over="ignore"):
        {"x": x, "features": features, "phi": phi}[where].flat[1] = bad
    disturbance = np.ones(3)
    assert not kernels.make_pair(
        x, features, phi, np.zeros((5, 8)), np.ones(3), True, np.full(3, 0.5), disturbance,
        np.zeros(5), 1e3,
    )  # fmt: skip
    assert disturbance.tolist() == [1.0, 1.0, 1.0]


def test_to_si() -> None:
    states = np.arange(6.0).reshape(2, 3)
    assert kernels.to_si(states, np.array([1.0, 2.0, 3.0]), np.array([10.0, 100.0, 1.0]))
    assert states.tolist() == [[1.0, 102.0, 5.0], [31.0, 402.0, 8.0]]
    for bad in (np.nan, np.inf):
        assert not kernels.to_si(np.array([[0.0, bad, 0.0]]), np.zeros(3), np.ones(3))


def test_follow_covariance() -> None:
    covariance = np.diag([1.0, 2.0, 3.0])
    kernels.follow_covariance(covariance, np.array([1.0, -2.0, 0.5]), 0.25)
    expected = 0.75 * np.diag([1.0, 2.0, 3.0])
    expected += 0.25 * np.outer([1.0, -2.0, 0.5], [1.0, -2.0, 0.5])
    np.testing.assert_allclose(covariance, expected)


def plain_roll_out(
    features_of: Callable[[Array], Array], x_past: Array, u_past: Array, theta: Array, step: Array,
    residual: bool, affine: bool, u_ahead: Array, disturbance: Array, decay: Array,
) -> Array:  # fmt: skip
    """The equations in the predictor's docstring, one line each."""
    xs, us = list(x_past), list(u_past)
    result = []
    for j, u in enumerate(u_ahead):
        row = np.concatenate([*xs[: len(x_past)], *us[: len(u_past)]])
        phi = np.concatenate([xs[0], features_of(row), u, [1.0] if affine else []])
        change = step * (theta[:3] @ phi + disturbance * decay**j)
        xs.insert(0, change + xs[0] if residual else change)
        us.insert(0, u)
        result.append(xs[0])
    return np.array(result)


@pytest.mark.parametrize("history", [0, 2, 5])
@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("affine", [True, False])
def test_roll_out_lifting(history: int, residual: bool, affine: bool, random: Random) -> None:
    torch.manual_seed(1)
    encoder, n_z = Encoder(history, 16, 5), 8
    n_phi = n_z + 2 + affine
    theta = random.normal(0.0, 0.03, (n_z, n_phi))
    theta[:3, :3] -= 0.3 * np.eye(3)
    x_past, u_past = random.normal(size=(history + 1, 3)), random.normal(size=(history, 2))
    u_ahead, disturbance = random.normal(size=(60, 2)), random.normal(size=3)
    decay, step = np.array([0.9, 0.99, 1.0]), np.array([0.05, 0.1, 0.2])
    out = np.empty((60, 3))
    given = (x_past, u_past, theta, u_ahead, disturbance, decay, step)
    before = [array.copy() for array in given]
    kernels.roll_out_lifting(
        x_past, u_past, theta, step, residual, affine, u_ahead, disturbance, decay,
        *weights(encoder), out,
    )  # fmt: skip

    def features_of(row: Array) -> Array:
        with torch.no_grad():
            return np.asarray(encoder(torch.tensor(row[None], dtype=torch.float32))[0].double())

    expected = plain_roll_out(
        features_of, x_past, u_past, theta, step, residual, affine, u_ahead, disturbance, decay
    )  # fmt: skip
    np.testing.assert_allclose(out, expected, atol=2e-4, rtol=2e-4)
    for array, kept in zip(given, before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_roll_out_lifting_is_bounded_and_shows_what_is_no_number(random: Random) -> None:
    encoder = Encoder(0, 4, 2)
    theta, out = np.zeros((5, 8)), np.empty((20, 3))
    fixed = (np.zeros((1, 3)), np.zeros((0, 2)))
    rest = (np.ones((20, 2)), np.zeros(3), np.ones(3), *weights(encoder), out)
    theta[:3, :3] = 3.0 * np.eye(3)
    theta[0, 7], theta[1, 7] = 1.0, -1.0
    kernels.roll_out_lifting(*fixed, theta, np.ones(3), True, True, *rest)
    assert out[-1].tolist() == [50.0, -50.0, 0.0]
    theta[1, 0] = np.nan
    kernels.roll_out_lifting(*fixed, theta, np.ones(3), True, True, *rest)
    assert not kernels.to_si(out, np.zeros(3), np.ones(3))


def test_roll_out_linear_is_matrix_powers(random: Random) -> None:
    a = 0.95 * np.linalg.qr(random.normal(size=(7, 7)))[0]
    b = random.normal(size=(7, 2))
    z, u = random.normal(size=7), random.normal(size=(40, 2))
    out = np.empty((40, 3))
    kept = z.copy()
    kernels.roll_out_linear(z, np.hstack([a, b]), u, out)
    for h in (1, 2, 10, 40):
        power = np.linalg.matrix_power
        expected = power(a, h) @ z + sum(power(a, h - 1 - j) @ b @ u[j] for j in range(h))
        np.testing.assert_allclose(out[h - 1], expected[:3], atol=1e-10)
    np.testing.assert_array_equal(z, kept)


def test_roll_out_linear_is_bounded() -> None:
    theta, out = np.hstack([2 * np.eye(4), np.zeros((4, 2))]), np.empty((100, 3))
    kernels.roll_out_linear(np.ones(4), theta, np.zeros((100, 2)), out)
    assert out.max() == 50.0
