# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a prediction's error could have been told from."""

import numpy as np
import pytest
from helpers.model import Array, make_model, sample

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.model.uncertainty.error_regression import (
    FORGETTING,
    N_REGRESSORS,
    ErrorRegression,
    accumulate_moments,
    solve_shrunk_regression,
)
from adk_ros.numerics.numba_cache import strict_kernel

STEPS = 40
TRUE = np.array([30.0, 0.0, -2.0, 0.0, 5.0])


@strict_kernel
def _account(h, c, error, lane, disturbance, moments):
    accumulate_moments(h, c, error, lane, disturbance, moments)


@strict_kernel
def _learn(h, c, moments, weights):
    solve_shrunk_regression(h, c, moments, np.empty((N_REGRESSORS, N_REGRESSORS)), weights)


def disturbance(signs: Array) -> Array:
    """Slow, fast and running mean, of which channel 1 of lane 1 has those `signs`."""
    own = [[9.0, signs[3], 9.0], [9.0, signs[4], 9.0], signs[:3]]
    return np.array([np.full((3, 3), 9.0), own])


def mean_square(errors: Array) -> float:
    kept = FORGETTING ** np.arange(len(errors) - 1, -1, -1)
    return float(np.average(np.square(errors), weights=kept))


def learned(signs: Array, errors: Array, h: int) -> Array:
    hindsight = ErrorRegression(STEPS)
    for row, error in zip(signs, errors, strict=True):
        _account(h, 1, error, 1, disturbance(row), hindsight.moments)
    _learn(h, 1, hindsight.moments, hindsight.weights)
    weights: Array = hindsight.weights.copy()
    own = weights[h, 1].copy()
    weights[h, 1] = 0.0
    assert not weights.any()
    np.testing.assert_allclose(own[N_REGRESSORS] ** 2, 9.0 * mean_square(errors), rtol=1e-9)
    return np.asarray(own[:N_REGRESSORS])


@pytest.mark.parametrize("h", [0, 39])
def test_weights_are_the_shrunk_regression(h: int) -> None:
    random = np.random.default_rng(h)
    signs = random.normal(size=(300, N_REGRESSORS)) * [1.0, 0.1, 2.0, 1.0, 0.5]
    errors = signs @ TRUE + 5.0 * random.normal(size=300)
    kept = FORGETTING ** np.arange(299, -1, -1)
    n = kept.sum()
    gram = signs.T @ (kept[:, None] * signs)
    moment = signs.T @ (kept * errors)
    plain = np.linalg.solve(gram + 3.0 / n * np.diag(np.diag(gram)), moment)
    told = plain @ moment
    rest = ((kept * errors**2).sum() - told) / n
    fewer = max(0.5 * (h + 1) / 10, 1.0)
    factor = 1.0 - N_REGRESSORS * fewer * rest / told
    assert 0.5 < factor < 1.0
    np.testing.assert_allclose(learned(signs, errors, h), factor * plain, rtol=1e-9)
    np.testing.assert_allclose(learned(signs, errors, h), TRUE, atol=3.0)


def test_weights_shrink_to_zero_on_noise() -> None:
    """Errors that no sign tells of: with K signs, twenty of twenty-five times nothing is left."""
    random = np.random.default_rng(5)
    moved = [
        np.abs(learned(random.normal(size=(300, N_REGRESSORS)), random.normal(size=300), 39)).max()
        for _ in range(25)
    ]
    assert np.median(moved) == 0.0
    assert max(moved) < 0.15


def test_an_error_without_bounds_leaves_finite_weights() -> None:
    signs = np.ones((3, N_REGRESSORS))
    hindsight = ErrorRegression(STEPS)
    for error in (1.0, 1e300, -1e300):
        _account(0, 1, error, 1, disturbance(signs[0]), hindsight.moments)
    _learn(0, 1, hindsight.moments, hindsight.weights)
    assert np.isfinite(hindsight.moments).all()
    assert np.isfinite(hindsight.weights).all()


def test_zero_regressors_predict_no_error() -> None:
    random = np.random.default_rng(6)
    assert not learned(np.zeros((200, N_REGRESSORS)), random.normal(size=200), 3).any()


def test_no_more_is_foreseen_than_thrice_the_usual_error() -> None:
    """A reading that jumps leaves signs far beyond all that the weights were learned from."""
    car, x, u = Predictor(lost()), *hills(3000)
    for k in range(2900):
        car.step(sample(k, x[k], u[k]))
    assert car.rollout_monitor is not None
    usual = (
        car.rollout_monitor.error_regression.weights[79, 0, N_REGRESSORS]
        / 3.0
        * car.model.scaling.x_scale[0]
    )
    x[2900] += [3.0, 0.0, 0.0]
    car.step(sample(2900, x[2900], u[2900]))
    ahead = car.rollout(u[:80])
    assert abs(ahead[79, 0] - x[2900, 0]) <= 3.0 * usual + 1e-9
    assert 0.1 < usual < 1.0


def hills(n: int) -> tuple[Array, Array]:
    """Speeds of a car whose model knows of no hills, and commands that are nothing to it."""
    t = np.arange(n) * 0.025
    x = np.zeros((n, 3))
    x[:, 0] = 20.0 + 0.5 * np.cos(2 * np.pi * t / 8.0)
    return x, np.zeros((n, 2))


def lost() -> KoopmanModel:
    """A model that predicts no change."""
    return make_model(
        theta0=np.zeros_like(make_model().theta0),
        mean_square_change=np.outer(np.arange(1.0, 81.0), [1e-2, 1e-5, 1e-5]),
        online=OnlineSettings("constant"), observer_gains=ObserverGains.none(),
    )  # fmt: skip


def test_error_regression_predicts_sign_reversal_on_hills() -> None:
    """The model knows of no change; what it leaves tells how that goes on, and turns round."""
    of = lost()
    x, u = hills(6000)
    told, plain = Predictor(of, horizon_steps=0), Predictor(of, horizon_steps=0)
    wrong = {}
    for name, car in (("told", told), ("plain", plain)):
        errors = []
        for k in range(5900):
            made = car.step(sample(k, x[k], u[k]))
            assert car.rollout_monitor is not None
            if name == "plain":
                car.rollout_monitor.error_regression.reset()
            if made is not None and k > 3000 and k % 7 == 0:
                errors.append(car.rollout(u[k : k + 80])[:, 0] - x[k + 1 : k + 81, 0])
        wrong[name] = np.sqrt(np.mean(np.square(errors), axis=0))
    # After a quarter of a period half of the square error can be told from how it now changes.
    better = wrong["told"] / wrong["plain"]
    assert (better[[9, 39, 79]] < [0.35, 0.6, 0.9]).all(), better
    assert told.rollout_monitor is not None
    told.reset()
    assert not told.rollout_monitor.error_regression.weights.any()
