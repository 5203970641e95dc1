# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations and left-out losses by blocks, against refits and repeated draws."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.inference.block_scores import BlockScores
from adk_ros.mismatch.inference.significance import critical_value, least_significant
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import BoundedParameters, FitOptions, FitResult, minimise

N, PER_BLOCK = 800, 40
BLOCK: IntArray = np.repeat(np.arange(N // PER_BLOCK), PER_BLOCK)
COLUMNS = np.column_stack([np.sin(0.02 * np.arange(N)), np.ones(N)])


def fit_of(y: FloatArray, rows: BoolArray | None = None, sigma: float = np.inf) -> FitResult:
    """Fit a straight-line model to `y` (n,), with a prior of `sigma` on the second parameter."""
    used = np.ones(N, dtype=bool) if rows is None else rows
    wide = np.full(2, 1e6)
    parameters = BoundedParameters(
        np.zeros(2), -wide, wide, np.full(2, 1e-4), np.zeros(2), np.array([np.inf, sigma])
    )
    return minimise(lambda x: (y - COLUMNS @ x)[used], parameters, FitOptions(6, 1e-12, 1e-12))


def test_deviations_hold_for_noise_that_is_correlated_within_blocks() -> None:
    random = np.random.default_rng(3)

    def draw() -> tuple[FloatArray, FloatArray, FloatArray]:
        shared = np.repeat(random.normal(0.0, 0.5, N // PER_BLOCK), PER_BLOCK)
        fit = fit_of(random.normal(size=N) + shared)
        return fit.x, BlockScores.of_fit(fit, BLOCK).deviations(), fit.deviation()

    values, robust, white = (np.array(x) for x in zip(*(draw() for _ in range(200)), strict=True))
    actual = values.std(axis=0)
    assert (white.mean(axis=0) < 0.45 * actual).all()
    np.testing.assert_allclose(robust.mean(axis=0), actual, rtol=0.15)


def test_deviations_are_not_below_those_for_white_residuals() -> None:
    fit = fit_of(np.random.default_rng(1).normal(size=N))
    assert (BlockScores.of_fit(fit, BLOCK).deviations() >= 0.999 * fit.deviation()).all()


def test_losses_on_blocks_left_out_are_those_of_refits() -> None:
    y = np.random.default_rng(2).normal(size=N) + 0.3 * COLUMNS[:, 0]
    losses = BlockScores.of_fit(fit_of(y, sigma=0.1), BLOCK).left_out_losses()
    for number in (0, 7, 19):
        held = np.equal(BLOCK, number)
        without = fit_of(y, ~held, sigma=0.1)
        expected = ((y - COLUMNS @ without.x)[held] ** 2).sum()
        assert losses[number] == pytest.approx(expected, rel=1e-3)


def test_rows_without_data_count_in_no_block() -> None:
    y = np.random.default_rng(4).normal(size=N)
    fit = fit_of(y)
    fit.residuals[BLOCK == 3] = 0.0
    assert BlockScores.of_fit(fit, BLOCK).losses.size == N // PER_BLOCK - 1


def test_a_variable_is_active_in_the_blocks_that_inform_about_it() -> None:
    early = np.where(np.arange(N) < 5 * PER_BLOCK, 1.0, 0.0)
    normal = np.zeros((2, 2))
    wide = np.full(2, 1e6)
    jacobian = np.column_stack([early, np.ones(N)])
    residuals = np.random.default_rng(5).normal(size=N)
    fit = FitResult(np.zeros(2), 0.0, residuals, jacobian, normal, -wide, wide)
    scores = BlockScores.of_fit(fit, BLOCK)
    assert (scores.active_blocks(0), scores.active_blocks(1)) == (5, 20)


def test_critical_value_is_that_of_bonferroni_and_student() -> None:
    assert critical_value(10_000, 1) == pytest.approx(1.960, abs=1e-3)
    assert critical_value(17, 100) == pytest.approx(4.346, abs=1e-3)
    assert critical_value(5, 100) > critical_value(17, 100)


def test_an_effect_in_few_blocks_must_only_be_alike_in_those() -> None:
    """Chance among all tests is that of the noise, which the whole recording shows."""
    assert least_significant(17, 17, 100) == critical_value(17, 100)
    assert least_significant(5, 33, 2000) == critical_value(33, 2000)
    assert least_significant(2, 33, 2000) == critical_value(2, 1) > critical_value(33, 2000)
