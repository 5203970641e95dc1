# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import (
    GAUSS_NEWTON,
    BoundedParameters,
    DampingSchedule,
    FitOptions,
    Linearisation,
    bounded_step,
    huber_loss,
    linearise_dense,
    minimise,
)

RNG = np.random.default_rng(7)
MATRIX = RNG.standard_normal((40, 3))
TRUE = np.array([0.5, -1.0, 2.0])
EXACT = FitOptions(iterations=50, relative_tolerance=0.0, absolute_tolerance=0.0)


def parameters(bound: float = 10.0, deviation: float = np.inf) -> BoundedParameters:
    one = np.ones(3)
    return BoundedParameters(
        0.0 * one, -bound * one, bound * one, 1e-4 * one, 0.0 * one, deviation * one
    )


def linear(x: FloatArray) -> FloatArray:
    return np.asarray(MATRIX @ (x - TRUE))


def rosenbrock(x: FloatArray) -> FloatArray:
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0], 0.1 * x[2]])


def test_a_linear_problem_is_solved() -> None:
    found = minimise(linear, parameters(), EXACT)
    np.testing.assert_allclose(found.x, TRUE, atol=1e-5)
    expected = np.sqrt(np.diag(np.linalg.inv(MATRIX.T @ MATRIX)))
    np.testing.assert_allclose(found.deviation(), expected, rtol=1e-6)


@pytest.mark.parametrize(
    "damping", [DampingSchedule(), DampingSchedule(1e-3, 8.0, 1e-3, 0.2, 0.0, 10), GAUSS_NEWTON]
)
def test_a_curved_valley_is_followed(damping: DampingSchedule) -> None:
    found = minimise(rosenbrock, parameters(), FitOptions(100, 0.0, 0.0, damping=damping))
    np.testing.assert_allclose(found.x[:2], 1.0, atol=1e-2)


def test_the_prior_shifts_the_minimum() -> None:
    deviation = 0.3
    found = minimise(linear, parameters(deviation=deviation), EXACT)
    normal = MATRIX.T @ MATRIX
    expected = np.linalg.solve(normal + np.eye(3) / deviation**2, normal @ TRUE)
    np.testing.assert_allclose(found.x, expected, atol=1e-5)


def test_a_coupling_prior_acts_on_combinations() -> None:
    difference = np.array([[1.0, -1.0, 0.0]])
    coupling = 1e9 * difference.T @ difference
    base = parameters()
    coupled = BoundedParameters(
        base.start, base.low, base.high, base.step, base.mean, base.deviation, coupling
    )
    found = minimise(linear, coupled, EXACT)
    assert found.x[0] == pytest.approx(found.x[1], abs=1e-6)
    assert np.abs(found.x - TRUE).max() > 0.1


def test_bounds_hold_and_the_other_parameters_are_solved_again() -> None:
    found = minimise(linear, parameters(bound=1.2), EXACT)
    assert found.x[2] == 1.2
    free = MATRIX[:, :2]
    expected = np.linalg.lstsq(free, MATRIX @ TRUE - 1.2 * MATRIX[:, 2], rcond=None)[0]
    np.testing.assert_allclose(found.x[:2], expected, atol=1e-5)


def test_a_bounded_step_solves_the_free_components_again() -> None:
    normal = np.array([[2.0, 1.9], [1.9, 2.0]])
    step = bounded_step(
        normal, np.array([-1.0, -1.0]), 0.0, np.full(2, -1.0), np.array([0.1, 1.0])
    )
    np.testing.assert_allclose(step, [0.1, (1.0 - 0.19) / 2.0])


def test_an_outlier_counts_linearly() -> None:
    assert huber_loss(np.array([3.0])) == 9.0
    assert huber_loss(np.array([3.0]), threshold=1.0) == 5.0
    outliers = np.zeros(40)
    outliers[3] = 1e4
    found = minimise(lambda x: linear(x) + outliers, parameters(), EXACT)
    assert np.abs(found.x - TRUE).max() < 2.0


def test_known_columns_and_a_given_linearisation_give_the_same_minimum() -> None:
    by_differences = minimise(linear, parameters(), EXACT)
    known = minimise(linear, parameters(), EXACT, known_columns=MATRIX[:, :2])

    def linearise(x: FloatArray, e: FloatArray) -> Linearisation:
        return linearise_dense(MATRIX, e)

    given = minimise(linear, parameters(), EXACT, linearise=linearise)
    np.testing.assert_allclose(known.x, by_differences.x, atol=1e-6)
    np.testing.assert_allclose(given.x, by_differences.x, atol=1e-6)


def test_residuals_that_are_not_finite_end_the_fit_at_the_best_point() -> None:
    def broken(x: FloatArray) -> FloatArray:
        return linear(x) if np.abs(x).max() < 1e-3 else np.full(40, np.nan)

    found = minimise(broken, parameters(), FitOptions(iterations=3))
    assert np.isfinite(found.cost)
    np.testing.assert_array_equal(found.x, np.zeros(3))
