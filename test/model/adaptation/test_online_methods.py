# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each way to adapt against its equations written out, over long runs, and without excitation."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.model import Array
from hypothesis import given, settings
from hypothesis import strategies as st

from adk_ros.errors import UsageError
from adk_ros.model.adaptation.online_methods import (
    METHODS,
    OnlineMethod,
    OnlineSettings,
    PaperSWLS,
    RecursiveLeastSquares,
    WindowedRidge,
)

N_Z, N_PHI = 7, 10


def pairs(n: int, seed: int = 0, noise: float = 0.1) -> tuple[Array, Array, Array]:
    """Return phi (n, N_PHI), y (n, N_Z) = theta phi + noise, and theta."""
    random = np.random.default_rng(seed)
    theta = random.normal(size=(N_Z, N_PHI))
    phi = random.normal(size=(n, N_PHI))
    return phi, phi @ theta.T + noise * random.normal(size=(n, N_Z)), theta


def make(
    method: str, theta0: Array | None = None, has_constant: bool = False, **settings: Any
) -> Any:
    theta0 = np.zeros((N_Z, N_PHI)) if theta0 is None else theta0
    return METHODS[method](theta0, OnlineSettings(method, **settings), has_constant)


def fold(method: OnlineMethod, phi: Array, y: Array) -> Array:
    for one, other in zip(phi, y, strict=True):
        method.update(one, other)
    return method.theta


def ridge_solution(phi: Array, y: Array, theta0: Array, ridge: float) -> Array:
    """Argmin of sum |y - theta phi|^2 + ridge |theta - theta0|^2, by its normal equations."""
    gram = phi.T @ phi + ridge * np.eye(phi.shape[1])
    solution: Array = np.linalg.solve(gram, phi.T @ y + ridge * theta0.T).T
    return solution


@pytest.mark.parametrize("window", [2, 37, 400])
@pytest.mark.parametrize("ridge", [1e-3, 1.0, 1e4])
def test_windowed_is_the_batch_solution_at_every_tick(window: int, ridge: float) -> None:
    phi, y, _ = pairs(500)
    theta0 = np.random.default_rng(1).normal(size=(N_Z, N_PHI))
    method: WindowedRidge = make("windowed", theta0, window=window, ridge=ridge)
    for k in range(500):
        method.update(phi[k], y[k])
        if k % 23 == 0 or k == window - 1 or k == window:
            last = slice(max(0, k + 1 - window), k + 1)
            expected = ridge_solution(phi[last], y[last], theta0, ridge)
            tolerance = 1e-6 if window < N_PHI and ridge < 1.0 else 1e-9
            np.testing.assert_allclose(method.theta, expected, atol=tolerance)
            np.testing.assert_allclose(method.batch_solution(), expected, atol=tolerance)
    assert method.failures == 0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e2])
def test_windowed_does_not_drift_in_ten_thousand_ticks(scale: float) -> None:
    """Sums are added to and taken from ten thousand times; what rounding leaves stays tiny."""
    phi, y, _ = pairs(10_000, noise=0.5)
    phi, y = scale * phi, scale * y
    method: WindowedRidge = make("windowed", window=200, ridge=1e-3)
    fold(method, phi, y)
    expected = ridge_solution(phi[-200:], y[-200:], np.zeros((N_Z, N_PHI)), 1e-3)
    assert np.abs(method.theta - expected).max() < 1e-9
    assert np.abs(method.theta - method.batch_solution()).max() < 1e-9


@pytest.mark.parametrize(("window", "ridge"), [(37, 1.0), (400, 300.0)])
def test_the_constant_of_the_lateral_rows_is_hardly_penalised(window: int, ridge: float) -> None:
    phi, y, _ = pairs(500)
    phi[:, -1] = 1.0
    theta0 = np.random.default_rng(1).normal(size=(N_Z, N_PHI))
    method = WindowedRidge(theta0, OnlineSettings(window=window, ridge=ridge), has_constant=True)
    for k in range(500):
        method.update(phi[k], y[k])
        if k % 50 != 3:
            continue
        last = slice(max(0, k + 1 - window), k + 1)
        for row in range(N_Z):
            penalty = np.full(N_PHI, ridge)
            penalty[-1] *= 0.01 if row in (1, 2) else 1.0
            gram = phi[last].T @ phi[last] + np.diag(penalty)
            right = phi[last].T @ y[last, row] + penalty * theta0[row]
            expected = np.linalg.solve(gram, right)
            np.testing.assert_allclose(method.theta[row], expected, atol=1e-9)
        np.testing.assert_allclose(method.theta, method.batch_solution(), atol=1e-9)
    assert method.failures == 0


def test_a_cross_slope_leaves_the_lateral_dynamics_as_they_are() -> None:
    """Regressors that are not zero in the mean, as of a driven course, explain no constant."""
    phi, _, theta = pairs(2000, noise=0.0)
    phi[:, :-1] += 0.5
    phi[:, -1] = 1.0
    y = phi @ theta.T
    y[:, 1] += 0.7
    moved = {}
    for has_constant in (False, True):
        settings_ = OnlineSettings(window=2000, ridge=300.0)
        method = WindowedRidge(theta, settings_, has_constant)
        change = fold(method, phi, y) - theta
        moved[has_constant] = float(np.abs(change[1, :-1]).max())
        assert np.abs(np.delete(change, 1, axis=0)).max() < 1e-9
    assert moved[True] < 0.01
    assert moved[False] > 10.0 * moved[True]


@pytest.mark.parametrize("ridge", [1e-3, 1.0, 300.0])
def test_a_free_constant_does_not_drift_either(ridge: float) -> None:
    phi, y, _ = pairs(10_000, noise=0.5)
    phi[:, -1] = 1.0
    phi[300, :-1] *= 1e3
    method: WindowedRidge = make("windowed", has_constant=True, window=200, ridge=ridge)
    fold(method, phi, y)
    assert method.failures == 0
    assert np.abs(method.theta - method.batch_solution()).max() < 1e-9


def test_a_constant_without_excitation_is_all_that_moves() -> None:
    theta0 = np.random.default_rng(0).normal(size=(N_Z, N_PHI))
    phi = np.zeros(N_PHI)
    phi[-1] = 1.0
    method: WindowedRidge = make("windowed", theta0, has_constant=True, window=100, ridge=300.0)
    for _ in range(500):
        method.update(phi, theta0 @ phi + 1.0)
    assert method.failures == 0
    moved = method.theta - theta0
    assert np.abs(moved[:, :-1]).max() < 1e-12
    np.testing.assert_allclose(moved[[1, 2], -1], 100.0 / 103.0)
    np.testing.assert_allclose(np.delete(moved[:, -1], [1, 2]), 100.0 / 400.0)


def test_windowed_recovers_from_an_outlier() -> None:
    """A regressor a thousand times too large comes and goes, and leaves nothing worth the name."""
    phi, y, _ = pairs(900)
    phi[300] *= 1e3
    method: WindowedRidge = make("windowed", window=200, ridge=1e-3)
    fold(method, phi, y)
    assert np.abs(method.theta - method.batch_solution()).max() < 1e-9


def test_windowed_with_hardly_any_excitation() -> None:
    """Rank one for ever: the other directions stay with the offline model."""
    random = np.random.default_rng(0)
    direction = random.normal(size=N_PHI)
    direction /= np.linalg.norm(direction)
    theta0 = random.normal(size=(N_Z, N_PHI))
    method: WindowedRidge = make("windowed", theta0, window=100, ridge=1.0)
    for _ in range(5000):
        scale = random.normal()
        method.update(scale * direction, np.full(N_Z, scale))
    assert method.failures == 0
    moved = method.theta - theta0
    across = moved - np.outer(moved @ direction, direction)
    assert np.abs(across).max() < 1e-9
    assert method.theta @ direction == pytest.approx(np.ones(N_Z), abs=0.05)


def test_windowed_goes_to_the_offline_model_as_the_ridge_grows() -> None:
    phi, y, theta = pairs(300)
    theta0 = theta + 1.0
    distances = [
        np.abs(fold(make("windowed", theta0, ridge=ridge), phi, y) - theta0).max()
        for ridge in (1e-3, 1.0, 1e3, 1e6, 1e9, 1e12)
    ]
    assert distances == sorted(distances, reverse=True)
    assert distances[0] == pytest.approx(1.0, abs=0.1)
    assert distances[-1] < 1e-8


def test_windowed_forgets_pairs_outside_the_window() -> None:
    phi, y, theta = pairs(300, noise=0.0)
    y[:150] = -y[:150]
    method = make("windowed", window=100, ridge=1e-3)
    assert np.abs(fold(method, phi, y) - theta).max() < 1e-4


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_windowed_starts_afresh_when_it_cannot_solve(bad: float) -> None:
    phi, y, _ = pairs(50)
    theta0 = np.ones((N_Z, N_PHI))
    method: WindowedRidge = make("windowed", theta0, window=20, ridge=1.0)
    fold(method, phi, y)
    method.update(np.full(N_PHI, bad), y[0])
    assert method.failures == 1
    np.testing.assert_array_equal(method.theta, theta0)
    fold(method, phi[:5], y[:5])
    expected = ridge_solution(phi[:5], y[:5], theta0, 1.0)
    np.testing.assert_allclose(method.theta, expected, atol=1e-9)


def textbook(phi: Array, y: Array, theta: Array, p: Array, f: float) -> tuple[Array, Array]:
    for one, other in zip(phi, y, strict=True):
        gain = p @ one / (f + one @ p @ one)
        theta = theta + np.outer(other - theta @ one, gain)
        p = (p - np.outer(gain, one @ p)) / f
    return theta, p


@settings(max_examples=20)
@given(st.integers(0, 99), st.floats(0.9, 1.0), st.floats(0.01, 100.0))
def test_recursions_are_the_textbooks(seed: int, forgetting: float, initial: float) -> None:
    phi, y, _ = pairs(60, seed)
    method: RecursiveLeastSquares = make(
        "ffrls", forgetting=forgetting, initial_covariance=initial
    )
    theta, _ = textbook(phi, y, np.zeros((N_Z, N_PHI)), initial * np.eye(N_PHI), forgetting)
    np.testing.assert_allclose(fold(method, phi, y), theta, rtol=1e-6, atol=1e-7)
    plain: RecursiveLeastSquares = make("rls", forgetting=0.6, initial_covariance=initial)
    theta, p = textbook(phi, y, np.zeros((N_Z, N_PHI)), initial * np.eye(N_PHI), 1.0)
    np.testing.assert_allclose(fold(plain, phi, y), theta, rtol=1e-6, atol=1e-7)
    assert plain.condition_number() == pytest.approx(np.linalg.cond(p), rel=1e-4)


@pytest.mark.parametrize("initial", [0.1, 10.0])
def test_rls_is_batch_least_squares(initial: float) -> None:
    """With P_0 = c I: over all samples, with ridge 1 / c to the offline model."""
    phi, y, _ = pairs(2000)
    theta0 = np.full((N_Z, N_PHI), 0.5)
    method = make("rls", theta0, initial_covariance=initial)
    expected = ridge_solution(phi, y, theta0, 1.0 / initial)
    np.testing.assert_allclose(fold(method, phi, y), expected, atol=1e-9)


def test_ffrls_is_weighted_batch_least_squares() -> None:
    phi, y, _ = pairs(400)
    weights = 0.97 ** np.arange(399, -1, -1.0)
    root = np.sqrt(weights)[:, None]
    expected = ridge_solution(root * phi, root * y, np.zeros((N_Z, N_PHI)), 0.97**400)
    method = make("ffrls", forgetting=0.97)
    np.testing.assert_allclose(fold(method, phi, y), expected, atol=1e-8)


def test_ffrls_survives_weak_excitation() -> None:
    """P grows along what is not excited until it is no number; then it starts afresh, counted."""
    random = np.random.default_rng(0)
    direction = random.normal(size=N_PHI)
    method: RecursiveLeastSquares = make("ffrls", forgetting=0.98)
    for k in range(30_000):
        phi = math.sin(0.01 * k) * direction + 1e-9 * random.normal(size=N_PHI)
        method.update(phi, math.sin(0.01 * k) * np.ones(N_Z))
        assert np.isfinite(method.theta).all()
    assert method.failures > 0
    assert method.theta @ direction == pytest.approx(np.ones(N_Z), abs=0.2)


def algorithm_1(phi: Array, y: Array, theta: Array, length: int) -> Array:
    """
    The paper's Algorithm 1, eqs. (30) to (33), with the transpose that (33) lacks.

    X = [psi; U] holds the regressors as columns, up to and with the newest.
    """
    for k in range(1, len(phi) + 1):
        columns = phi[:k].T if k < length else phi[k - length : k].T
        p = np.linalg.pinv(columns @ columns.T, rcond=1e-12, hermitian=True)
        theta = theta + (y[k - 1] - theta @ phi[k - 1])[:, None] @ phi[k - 1][None, :] @ p
    return theta


@pytest.mark.parametrize("length", [12, 30, 200])
def test_swls_is_the_papers_algorithm(length: int) -> None:
    phi, y, _ = pairs(120)
    theta0 = np.full((N_Z, N_PHI), 0.1)
    method: PaperSWLS = make("swls", theta0, window=length)
    expected = algorithm_1(phi, y, theta0, length)
    # The window is kept as a ring, so sums are in another order.
    np.testing.assert_allclose(fold(method, phi, y), expected, rtol=1e-7, atol=1e-7)
    last = phi[-min(length, 120) :]
    assert method.condition_number() == pytest.approx(np.linalg.cond(last.T @ last), rel=1e-6)


def test_swls_is_no_windowed_least_squares() -> None:
    """Which is why it is not the default: old samples leave P, but not theta."""
    phi, y, theta = pairs(300, noise=0.0)
    y[:150] = -y[:150]
    swls = fold(make("swls", window=100), phi, y)
    windowed = fold(make("windowed", window=100, ridge=1e-3), phi, y)
    assert np.abs(windowed - theta).max() < 1e-3 < 0.02 < np.abs(swls - theta).max()


def test_swls_with_a_singular_gram() -> None:
    """Seventeen columns of rank six, as a lifted state's are: the pseudo-inverse bears it."""
    random = np.random.default_rng(0)
    basis = random.normal(size=(6, 17))
    theta = random.normal(size=(15, 17))
    method = PaperSWLS(np.zeros((15, 17)), OnlineSettings("swls", window=60))
    for _ in range(300):
        phi = random.normal(size=6) @ basis
        method.update(phi, theta @ phi)
    assert method.failures == 0
    assert method.condition_number() > 1e12
    np.testing.assert_allclose(method.theta @ basis.T, theta @ basis.T, atol=1e-6)


@pytest.mark.parametrize("phi", [np.zeros(N_PHI), np.full(N_PHI, 1e-300), np.full(N_PHI, 1e3)])
@pytest.mark.parametrize("method", METHODS)
def test_regressors_without_excitation(method: str, phi: Array) -> None:
    online = make(method, np.ones((N_Z, N_PHI)), window=10)
    for _ in range(30):
        online.update(phi, np.ones(N_Z))
        assert np.isfinite(online.theta).all()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e200])
@pytest.mark.parametrize("method", METHODS)
def test_no_method_keeps_nan(method: str, bad: float) -> None:
    """The predictor lets none through; a method bears it all the same."""
    phi, y, _ = pairs(40)
    online = make(method, window=10, ridge=1.0)
    fold(online, phi, y)
    for where in range(2):
        hurt = [phi[0].copy(), y[0].copy()]
        hurt[where][3] = bad
        with np.errstate(all="ignore"):
            online.update(*hurt)
            fold(online, phi, y)
        assert np.isfinite(online.theta).all()


@pytest.mark.parametrize("method", METHODS)
def test_reset_returns_to_the_offline_model(method: str) -> None:
    phi, y, _ = pairs(50)
    theta0 = np.random.default_rng(3).normal(size=(N_Z, N_PHI))
    kept = theta0.copy()
    online = make(method, theta0, window=20)
    first = fold(online, phi, y).copy()
    online.reset()
    np.testing.assert_array_equal(online.theta, kept)
    np.testing.assert_array_equal(fold(online, phi, y), first)
    np.testing.assert_array_equal(theta0, kept)
    assert (np.abs(first - kept).max() > 0.1) == (method != "constant")


@pytest.mark.parametrize("method", METHODS)
def test_update_does_not_change_its_arguments(method: str) -> None:
    phi, y, _ = pairs(30)
    before = phi.copy(), y.copy()
    fold(make(method, window=10), phi, y)
    np.testing.assert_array_equal(phi, before[0])
    np.testing.assert_array_equal(y, before[1])


def test_condition_numbers() -> None:
    phi, y, _ = pairs(150)
    assert math.isnan(make("constant").condition_number())
    windowed: WindowedRidge = make("windowed", window=100, ridge=0.5)
    assert windowed.condition_number() == pytest.approx(1.0)
    fold(windowed, phi, y)
    gram = phi[-100:].T @ phi[-100:] + 0.5 * np.eye(N_PHI)
    assert windowed.condition_number() == pytest.approx(np.linalg.cond(gram), rel=1e-6)
    assert make("swls").condition_number() == math.inf
    swls = make("swls", window=100)
    fold(swls, phi[:3], y[:3])
    assert swls.condition_number() > 1e12


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"method": "magic"}, "'magic' is unknown: choose one of constant, rls, ffrls, swls"),
        ({"window": 1}, "window is 1 samples: choose 2 to 100000"),
        ({"window": 100_001}, "window is 100001"),
        ({"ridge": 0.0}, "ridge is 0: choose 0.001 to 1e12"),
        ({"ridge": -1.0}, "ridge is -1"),
        ({"ridge": math.nan}, "ridge is nan"),
        ({"ridge": math.inf}, "ridge is inf"),
        ({"forgetting": 0.5}, "forgetting is 0.5: choose above 0.5 and at most 1"),
        ({"forgetting": 1.01}, "forgetting is 1.01"),
        ({"forgetting": math.nan}, "forgetting is nan"),
        ({"initial_covariance": 0.0}, "initial_covariance is 0: choose above 0"),
        ({"initial_covariance": math.nan}, "initial_covariance is nan"),
    ],
)
def test_settings_out_of_range(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError) as refused:
        OnlineSettings(**fields)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_settings_at_their_limits() -> None:
    for fields in (
        {"window": 2}, {"window": 100_000}, {"ridge": 1e-3}, {"ridge": 1e12}, {"forgetting": 1.0}
    ):  # fmt: skip
        assert replace(OnlineSettings(), **fields) is not None
