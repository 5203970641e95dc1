# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Smoothing with a window in seconds."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay, window_samples


def local_cubic(values: FloatArray, window: int) -> FloatArray:
    """The definition: a cubic fitted to the window around each sample."""
    half = window // 2
    at = np.arange(-half, half + 1)
    out = np.full(values.shape[0], np.nan)
    for k in range(half, values.shape[0] - half):
        out[k] = np.polyfit(at, values[k - half : k + half + 1], 3)[-1]
    return out


@pytest.mark.parametrize(("rate", "samples"), [(10.0, 5), (50.0, 25), (200.0, 101)])
def test_the_window_is_half_a_second_at_any_rate(rate: float, samples: int) -> None:
    assert window_samples(1.0 / rate) == samples
    assert samples % 2 == 1
    assert samples / rate == pytest.approx(0.5, abs=1.001 / rate)
    values = np.random.default_rng(3).standard_normal(400)
    found, expected = savitzky_golay(values, 1.0 / rate), local_cubic(values, samples)
    inner = np.isfinite(expected)
    np.testing.assert_allclose(found[inner], expected[inner], atol=1e-9)


@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0])
def test_a_one_hertz_signal_passes_at_any_rate(rate: float) -> None:
    at = np.arange(0.0, 10.0, 1.0 / rate)
    wave = np.sin(2.0 * np.pi * at)
    assert np.abs(savitzky_golay(wave, 1.0 / rate) - wave).max() < 0.12


def test_the_window_tolerates_jitter_of_the_period() -> None:
    assert {window_samples(period) for period in (0.0195, 0.01999, 0.02, 0.02001, 0.0205)} == {25}


def test_the_window_has_at_least_order_plus_two_samples() -> None:
    assert window_samples(1.0) == 5
    assert window_samples(1.0, order=2) == 5
    assert window_samples(1.0, order=1) == 3


def test_a_cubic_is_unchanged_and_a_short_series_too() -> None:
    at = np.linspace(-1.0, 1.0, 60)
    cubic = 2.0 - at + 3.0 * at**3
    np.testing.assert_allclose(savitzky_golay(cubic, 0.02), cubic, atol=1e-12)
    np.testing.assert_array_equal(savitzky_golay(cubic[:20], 0.02), cubic[:20])
