# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Covariances whose 90 % intervals hold 90 % of what comes."""

import numpy as np
import pytest
from helpers.model import Array

from adk_ros.model.uncertainty.conformal import (
    FORGETTING,
    GAIN,
    SCALE_MAX,
    SCALE_MIN,
    ConformalScale,
    update_conformal_scale,
)
from adk_ros.numerics.constants import QUANTILE_90

START = np.array([[[0.04, 0.01, 0.0], [0.01, 0.09, -0.01], [0.0, -0.01, 0.01]]] * 4)


def run(errors: Array, delay: int, start: Array) -> tuple[ConformalScale, Array]:
    """Errors (n, 3) of one step, each promised a variance `delay` before; whether they held."""
    scale = ConformalScale(start, 5.0)
    promised = [np.diag(scale.calibrated[0]).copy()] * (delay + 1)
    held = []
    for error in errors:
        variance = promised.pop(0)
        held.append(np.abs(error) <= QUANTILE_90 * np.sqrt(variance))
        update_conformal_scale(0, error.copy(), error, variance, scale.arrays)
        promised.append(np.diag(scale.calibrated[0]).copy())
    return scale, np.array(held)


def test_kernel_equals_the_equations() -> None:
    random = np.random.default_rng(0)
    scale = ConformalScale(START, 5.0)
    count, covariance, factor = 5.0, START[1].copy(), np.zeros(3)
    for _ in range(500):
        error, surprise = random.standard_t(3, (2, 3)) * [0.2, 0.3, 0.1]
        variance = np.diag(scale.calibrated[1]).copy()
        update_conformal_scale(1, error.copy(), surprise, variance, scale.arrays)
        missed = np.abs(surprise) > 1.6448536269514722 * np.sqrt(variance)
        count = FORGETTING * count + 1.0
        covariance = covariance + (np.outer(error, error) - covariance) / count
        factor = np.clip(factor + GAIN * (missed - 0.1), np.log(SCALE_MIN), np.log(SCALE_MAX))
        wanted = covariance * np.outer(np.exp(factor), np.exp(factor))
        np.testing.assert_allclose(scale.calibrated[1], wanted, rtol=1e-9, atol=1e-15)
    # The other steps know nothing of it.
    for row in (0, 2, 3):
        np.testing.assert_array_equal(scale.calibrated[row], START[row])


@pytest.mark.parametrize("delay", [0, 8])
@pytest.mark.parametrize("kind", ["normal", "heavy tails", "drifting", "wrong start"])
def test_intervals_cover_ninety_percent(kind: str, delay: int) -> None:
    random = np.random.default_rng(3)
    n = 6000
    errors = random.normal(size=(n, 3))
    if kind == "heavy tails":
        errors = random.standard_t(2.5, (n, 3))
    elif kind == "drifting":
        errors *= np.exp(1.5 * np.sin(2.0 * np.pi * np.arange(n) / 700.0))[:, None]
    start = np.eye(3)[None] * (1e-4 if kind == "wrong start" else 1.0)
    _, held = run(errors * [0.3, 0.1, 0.02], delay, start * np.diag([0.09, 0.01, 0.0004]))
    assert (np.abs(held.mean(axis=0) - 0.9) < 0.02).all()


def test_unscaled_covariance_misses_ninety_percent_coverage() -> None:
    """What the factor is for: heavy tails make the deviation, and so the intervals, too wide."""
    random = np.random.default_rng(3)
    errors = random.standard_t(2.5, (6000, 3))
    scale, _ = run(errors, 0, np.eye(3)[None])
    spread = np.sqrt(np.mean(errors**2, axis=0))
    assert (np.mean(np.abs(errors) <= QUANTILE_90 * spread, axis=0) > 0.93).all()
    assert (scale.arrays.factor[0] < 1.0).all()


def test_the_factor_is_bounded_and_all_stays_finite() -> None:
    random = np.random.default_rng(0)
    for size, bound in ((0.0, SCALE_MIN), (1e300, SCALE_MAX)):
        scale = ConformalScale(START, 5.0)
        for _ in range(2000):
            error = size * random.normal(size=3)
            # Nothing that was promised holds, or everything does.
            update_conformal_scale(2, error.copy(), error, np.zeros(3), scale.arrays)
        np.testing.assert_array_equal(scale.arrays.factor[2], bound)
        table = scale.calibrated
        assert np.isfinite(table).all()
        np.testing.assert_array_equal(table, table.transpose(0, 2, 1))
        least = np.linalg.eigvalsh(table)[:, 0]
        assert (least >= -1e-12 * np.trace(table, axis1=1, axis2=2)).all()


def test_reset_forgets_and_the_start_is_symmetric() -> None:
    lopsided = START.copy()
    lopsided[:, 0, 1] += 1e-9
    scale = ConformalScale(lopsided, 5.0)
    before = scale.calibrated.copy()
    np.testing.assert_array_equal(before, before.transpose(0, 2, 1))
    update_conformal_scale(0, np.ones(3), np.ones(3), np.zeros(3), scale.arrays)
    assert (scale.calibrated[0] != before[0]).any()
    scale.reset()
    np.testing.assert_array_equal(scale.calibrated, before)
    np.testing.assert_array_equal(scale.arrays.n_effective, 5.0)
