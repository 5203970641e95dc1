# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled loops against plain numpy, torch and textbook formulae."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers.model import random_lift, weights

from adk_ros.model.estimation import disturbance as disturbance_kernels
from adk_ros.model.estimation import observer
from adk_ros.model.estimation.disturbance import RegressionArrays
from adk_ros.model.estimation.observer import ScalingArrays, TickArrays
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.lifting import encoder_kernels
from adk_ros.model.lifting.encoder import input_size

Random = np.random.Generator


@pytest.fixture
def random() -> Random:
    return np.random.default_rng(0)


@pytest.mark.parametrize(("history", "hidden", "features"), [
    (0, 1, 1), (0, 8, 4), (2, 16, 6), (4, 48, 12), (8, 31, 16), (1, 5, 3),
])  # fmt: skip
def test_perceptron_equals_the_torch_module(
    history: int, hidden: int, features: int, random: Random
) -> None:
    torch.manual_seed(history)
    encoder = random_lift(history, hidden, features)
    scratch = np.empty((2, hidden + 5 + input_size(history)), np.float32)
    out = np.empty(features, np.float32)
    for scale in (0.0, 0.1, 1.0, 30.0):
        row = (scale * random.normal(size=input_size(history))).astype(np.float32)
        with torch.no_grad():
            expected = encoder(torch.from_numpy(row)[None])[0].numpy()
        before = row.copy()
        encoder_kernels.perceptron(row, weights(encoder), scratch, out)
        np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-5 * max(1.0, scale))
        np.testing.assert_array_equal(row, before)


def test_kernels_compile_without_a_cache_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when installed by root and run by a user without a home directory."""
    from numba.core.registry import CPUDispatcher

    def refuse(_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(CPUDispatcher, "enable_caching", refuse)
    spec = importlib.util.spec_from_file_location(
        "kernels_without_cache", disturbance_kernels.__file__
    )
    assert spec is not None
    assert spec.loader is not None
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    covariance = np.zeros((3, 3))
    fresh.ewma_covariance(covariance, np.ones(3), 0.5)
    assert covariance.tolist() == [[0.5] * 3] * 3


def test_encoder_input_is_newest_first() -> None:
    row = np.zeros(15, np.float32)
    encoder_kernels.pack_encoder_input(
        np.arange(9.0).reshape(3, 3), np.arange(20.0, 24.0).reshape(2, 2), row
    )
    encoder_kernels.set_command(row, 9, 30.0, 31.0)
    assert row.tolist() == [*range(9), 30, 31, *range(20, 24)]
    alone = np.zeros(3, np.float32)
    encoder_kernels.pack_encoder_input(np.array([[1.0, 2.0, 3.0]]), np.zeros((0, 2)), alone)
    encoder_kernels.set_command(alone, 3, 30.0, 31.0)
    assert alone.tolist() == [1.0, 2.0, 3.0]


def test_shift_in() -> None:
    past = np.arange(6.0).reshape(3, 2)
    encoder_kernels.shift_in(past, np.array([8.0, 9.0]))
    assert past.tolist() == [[8.0, 9.0], [0.0, 1.0], [2.0, 3.0]]
    empty = np.zeros((0, 2))
    encoder_kernels.shift_in(empty, np.array([8.0, 9.0]))
    assert empty.shape == (0, 2)


@pytest.mark.parametrize("history", [0, 1, 3])
def test_observer_update_over_many_ticks(history: int, random: Random) -> None:
    """Row k = [x_k .. x_(k-p), u_k .. u_(k-p)], scaled."""
    x, u = random.normal(size=(12, 3)), random.normal(size=(12, 2))
    x_mean, x_scale = random.normal(size=3), random.uniform(0.5, 2.0, 3)
    u_mean, u_scale = random.normal(size=2), random.uniform(0.5, 2.0, 2)
    x_past, u_past, u_now = np.zeros((history + 1, 3)), np.zeros((history, 2)), np.zeros(2)
    u_previous = np.zeros(2)
    measured, expected = np.zeros(3), np.full(3, np.nan)
    row = np.zeros(input_size(history), np.float32)
    scaled_x, scaled_u = (x - x_mean) / x_scale, (u - u_mean) / u_scale
    for k in range(12):
        command = tuple(u[k].tolist())
        observer.observer_update(
            x[k], expected, command, ObserverGains.none().table(),
            ScalingArrays(x_mean, x_scale, u_mean, u_scale),
            TickArrays(measured, x_past, u_past, u_now, u_previous, row, np.zeros((3, 3))),
        )  # fmt: skip
        if k >= history:
            past = [scaled_x[k - i] for i in range(history + 1)]
            past += [scaled_u[k - i] for i in range(history + 1) if history]
            np.testing.assert_allclose(row, np.concatenate(past), rtol=1e-6)
            np.testing.assert_allclose(u_now, scaled_u[k])
            np.testing.assert_allclose(x_past[0], scaled_x[k])
            np.testing.assert_allclose(measured, scaled_x[k])


def test_observer_corrects_the_prediction() -> None:
    """x^ = p + K (x - p); without a prediction, the measurement."""
    gains = replace(ObserverGains.none(), observer_gain=np.array([0.25, 1.0, 0.5]))
    measured, x_past = np.zeros(3), np.zeros((1, 3))
    others = (np.zeros((0, 2)), np.zeros(2), np.zeros(2), np.zeros(3, np.float32))
    scaling = (np.array([1.0, 2.0, 3.0]), np.full(3, 2.0), np.zeros(2), np.ones(2))
    state = np.array([5.0, 6.0, 7.0])
    for predicted, seen in (
        ([1.0, 2.0, 3.0], [0.5, 2.0, 1.0]),
        ([np.nan] * 3, [2.0, 2.0, 2.0]),
    ):
        observer.observer_update(
            state, np.array(predicted), (0.0, 0.0), gains.table(), ScalingArrays(*scaling),
            TickArrays(measured, x_past, *others, np.zeros((3, 3))),
        )  # fmt: skip
        assert x_past[0].tolist() == seen
        assert others[-1].tolist() == seen
        assert measured.tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize(("lag", "gain"), [(0.0, 0.2), (0.95, 1.0)])
def test_observer_gain_increases_with_correlated_innovations(lag: float, gain: float) -> None:
    """White innovations leave the gain; correlated ones raise it to 1."""
    gains = replace(ObserverGains.none(), observer_gain=np.full(3, 0.2))
    measured, x_past, autocorrelation = np.zeros(3), np.zeros((1, 3)), np.zeros((3, 3))
    others = (np.zeros((0, 2)), np.zeros(2), np.zeros(2), np.zeros(3, np.float32))
    scaling = (np.zeros(3), np.ones(3), np.zeros(2), np.ones(2))
    random = np.random.default_rng(0)
    innovation, used = np.zeros(3), []
    for _ in range(2000):
        innovation = lag * innovation + np.sqrt(1.0 - lag**2) * random.normal(size=3)
        observer.observer_update(
            innovation, np.zeros(3), (0.0, 0.0), gains.table(), ScalingArrays(*scaling),
            TickArrays(measured, x_past, *others, autocorrelation),
        )  # fmt: skip
        used.append(x_past[0] / innovation)
    np.testing.assert_allclose(np.median(used[300:], axis=0), gain)


@pytest.mark.parametrize("affine", [True, False])
def test_pack_regressor(affine: bool) -> None:
    phi = np.full(6 + affine, np.nan)
    x, features = np.arange(6.0).reshape(2, 3), np.array([3.0], np.float32)
    encoder_kernels.pack_regressor(x, features, np.array([7.0, 8.0]), affine, phi)
    assert phi.tolist() == [0.0, 1.0, 2.0, 3.0, 7.0, 8.0] + [1.0] * affine


@pytest.mark.parametrize("residual", [True, False])
def test_regression_pair(residual: bool, random: Random) -> None:
    measured, features = random.normal(size=3), random.normal(size=2).astype(np.float32)
    phi, theta = random.normal(size=8), random.normal(size=(5, 8))
    step, gain, disturbance = np.array([0.1, 0.2, 0.5]), np.array([0.1, 0.0, 1.0]), np.ones((3, 3))
    fast_gain = np.array([1.0, 0.5, 0.3])
    gains = replace(ObserverGains.none(), slow_gain=gain, fast_gain=fast_gain).table()
    y = np.zeros(5)
    assert disturbance_kernels.regression_pair(
        features, theta, residual, RegressionArrays(measured, phi, step, gains, disturbance, y)
    )
    z = np.concatenate([measured, features])
    expected = z - phi[:5] if residual else z.copy()
    if residual:
        expected[:3] /= step
    np.testing.assert_allclose(y, expected)
    error = expected[:3] - theta[:3] @ phi
    slow = 1.0 + gain * (error - 1.0)
    fast, mean = 1.0 + fast_gain * (error - slow - 1.0), 1.0 + 0.1 * (error - 1.0)
    np.testing.assert_allclose(disturbance, [slow, fast, mean])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e4, -1e300])
@pytest.mark.parametrize("where", ["x", "features", "phi"])
def test_regression_pair_refuses_large_values_and_nan(
    bad: float, where: str, random: Random
) -> None:
    """A large regressor would leave its rounding error in the Gram matrix for good."""
    x, features, phi = random.normal(size=3), np.ones(2, np.float32), np.ones(8)
    arrays: dict[str, np.ndarray] = {"x": x, "features": features, "phi": phi}
    with np.errstate(over="ignore"):
        arrays[where].flat[1] = bad
    disturbance = np.ones((3, 3))
    assert not disturbance_kernels.regression_pair(
        features, np.zeros((5, 8)), True,
        RegressionArrays(x, phi, np.ones(3), np.full((5, 3), 0.5), disturbance, np.zeros(5)),
    )  # fmt: skip
    assert (disturbance == 1.0).all()


def test_ewma_covariance() -> None:
    covariance = np.diag([1.0, 2.0, 3.0])
    disturbance_kernels.ewma_covariance(covariance, np.array([1.0, -2.0, 0.5]), 0.25)
    expected = 0.75 * np.diag([1.0, 2.0, 3.0])
    expected += 0.25 * np.outer([1.0, -2.0, 0.5], [1.0, -2.0, 0.5])
    np.testing.assert_allclose(covariance, expected)
