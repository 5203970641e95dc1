# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A trial whose run diverges costs much, and neither overflows nor ends the fit."""

from __future__ import annotations

import warnings

import numpy as np
from helpers.mismatch import car, case

from adk_ros.mismatch.surrogate.residuals import MAX_RESIDUAL, limited, prepare_residual_problem
from adk_ros.numerics.levenberg_marquardt import huber_loss


def test_residuals_of_a_diverging_run_are_finite() -> None:
    problem = prepare_residual_problem(case().recording)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        e = problem.residuals(car(extra_y=1e300))
        loss = huber_loss(e * problem.weights())
    assert np.isfinite(e).all()
    assert np.abs(e).max() == MAX_RESIDUAL
    assert np.isfinite(loss)
    assert loss > 1e3 * huber_loss(problem.residuals(car()) * problem.weights())


def test_usual_residuals_are_unchanged() -> None:
    e = np.array([[0.1, -3.0]])
    assert limited(e) is e
    given = np.array([[np.nan, -np.inf, 2.0]])
    np.testing.assert_array_equal(limited(given), [[MAX_RESIDUAL, -MAX_RESIDUAL, 2.0]])
