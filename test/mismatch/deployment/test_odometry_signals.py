# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A yaw rate that odometry filters, before and after the filter."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.deployment.odometry_signals import with_lag, without_lag
from adk_ros.numerics.arrays import FloatArray

STEP_S, LAG_S = 0.005, 0.3
AT_S: FloatArray = STEP_S * np.arange(4000, dtype=np.float64)
RATE: FloatArray = 0.3 * np.sin(2.0 * np.pi * 0.4 * AT_S)


def test_the_filter_is_the_differential_equation() -> None:
    """Amplitude and phase of a first-order lag at 0.4 Hz, after it has settled."""
    settled = slice(2000, None)
    w = 2.0 * np.pi * 0.4
    # A mean over a step is that of its middle, and the filter gives the end of the step.
    expected = (RATE[settled] - LAG_S * w * 0.3 * np.cos(w * AT_S[settled])) / (
        1.0 + (LAG_S * w) ** 2
    )
    found = with_lag(RATE, 0.0, LAG_S, STEP_S)[settled]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_the_rate_before_the_filter_is_found_from_past_messages() -> None:
    published = with_lag(RATE, 0.0, LAG_S, STEP_S)
    every = slice(None, None, 8)
    stamps, values = AT_S[every], published[every]
    found = without_lag(stamps, values, LAG_S)
    # One interval of 40 ms late: 0.3 rad/s at 0.4 Hz change by 0.03 rad/s in it.
    assert np.abs(found - RATE[every])[10:].max() < 0.035
    assert np.abs(values - RATE[every])[10:].max() > 0.15
    later = values.copy()
    later[200:] += 1.0
    np.testing.assert_array_equal(without_lag(stamps, later, LAG_S)[:200], found[:200])


def test_without_a_filter_nothing_changes() -> None:
    np.testing.assert_array_equal(without_lag(AT_S, RATE, 0.0), RATE)
    np.testing.assert_array_equal(without_lag(AT_S[:2], RATE[:2], LAG_S), RATE[:2])
