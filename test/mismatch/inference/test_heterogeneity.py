# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cochran's Q test and I² of estimates from several recordings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from adk_ros.mismatch.inference.heterogeneity import heterogeneity, odd_one_out


def test_cochrans_q_of_a_worked_example() -> None:
    tested = heterogeneity(np.array([1.0, 2.0, 4.0]), np.array([1.0, 1.0, 0.5]))
    mean = (1.0 + 2.0 + 4.0 * 4.0) / 6.0
    q = (1.0 - mean) ** 2 + (2.0 - mean) ** 2 + 4.0 * (4.0 - mean) ** 2
    assert tested.mean == pytest.approx(mean)
    assert tested.q == pytest.approx(q)
    assert tested.p_value == pytest.approx(chi2.sf(q, 2))
    assert tested.i_squared == pytest.approx(1.0 - 2.0 / q)


def test_equal_estimates_agree() -> None:
    tested = heterogeneity(np.full(3, 0.7), np.full(3, 0.1))
    assert tested.p_value == pytest.approx(1.0)
    assert tested.i_squared == 0.0


def test_the_false_alarm_rate_is_the_level() -> None:
    rng = np.random.default_rng(0)
    sigma = np.array([0.1, 0.2, 0.4])
    p = [heterogeneity(1.0 + sigma * rng.standard_normal(3), sigma).p_value for _ in range(4000)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.01)


def test_the_odd_one_is_named_where_the_others_agree() -> None:
    sigma = np.full(3, 0.02)
    assert odd_one_out(np.array([0.9, 0.91, 0.4]), sigma, 0.05) == 2
    assert odd_one_out(np.array([0.9, 0.6, 0.3]), sigma, 0.05) is None
    assert odd_one_out(np.array([0.9, 0.4]), sigma[:2], 0.05) is None
