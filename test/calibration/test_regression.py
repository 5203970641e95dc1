# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regression with instruments, and the coverage of its block-bootstrap intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from adk_ros.calibration.regression import regress

N = 15_000


def coloured(rng: np.random.Generator) -> np.ndarray:
    return np.asarray(lfilter([0.02], [1.0, -0.98], rng.standard_normal(N)))


def test_intervals_hold_with_residuals_that_are_correlated_in_time() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(40):
        x = coloured(rng)
        fit = regress(x[:, None], 2.0 * x + coloured(rng), np.ones(N))
        assert fit is not None
        estimate = fit.estimate(0)
        inside += estimate.low <= 2.0 <= estimate.high
    # 90 % of 40, and four binomial standard deviations of 1.9 below.
    assert inside >= 29


def test_instruments_remove_the_bias_of_noisy_columns() -> None:
    rng = np.random.default_rng(1)
    truth = coloured(rng)
    noise = truth.std()
    one, two = (truth + noise * rng.standard_normal(N) for _ in range(2))
    biased = regress(one[:, None], truth, np.ones(N))
    unbiased = regress(one[:, None], truth, np.ones(N), two[:, None])
    assert biased is not None
    assert unbiased is not None
    assert biased.values[0] == pytest.approx(0.5, abs=0.05)
    assert unbiased.values[0] == pytest.approx(1.0, abs=0.05)


def test_few_blocks_give_no_estimate() -> None:
    x = np.arange(1000.0)
    assert regress(x[:, None], x, np.ones(1000)) is None
