# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delays and low-pass filters between two signals are told apart, and noise is neither."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from adk_ros.calibration.criteria import PERIOD_S
from adk_ros.calibration.grid import shifted, smooth
from adk_ros.calibration.lag import Lag, lag_between
from adk_ros.numerics.arrays import FloatArray

N = 10_000


def signal(seed: int = 0, tau_s: float = 0.3) -> FloatArray:
    """Return coloured noise of unit variance, as a yaw rate varies."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-PERIOD_S / tau_s)
    values = rng.standard_normal(N)
    for _ in range(2):
        values = lfilter([1.0 - keep], [1.0, -keep], values)
    return np.asarray(values / values.std())


def low_passed(values: FloatArray, tau_s: float) -> FloatArray:
    keep = np.exp(-PERIOD_S / tau_s)
    middle = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], middle))


def noise(size: float, seed: int) -> FloatArray:
    return np.asarray(size * np.random.default_rng(seed).standard_normal(N))


def lag(x: FloatArray, y: FloatArray) -> Lag:
    found = lag_between(smooth(x), smooth(y), np.ones(N))
    assert found is not None
    return found


@pytest.mark.parametrize("delay_s", [0.05, 0.2, -0.1])
def test_a_delay(delay_s: float) -> None:
    x = signal()
    found = lag(x + noise(0.02, 1), shifted(x, delay_s) + noise(0.02, 2))
    assert found.form == "delay"
    assert found.delay.value == pytest.approx(delay_s, abs=0.005)


@pytest.mark.parametrize("tau_s", [0.15, 0.35, 0.6])
def test_a_filter(tau_s: float) -> None:
    x = signal()
    found = lag(x + noise(0.02, 1), low_passed(x, tau_s) + noise(0.01, 2))
    assert found.form == "filter"
    assert found.filter.value == pytest.approx(tau_s, rel=0.05)


def test_a_filtered_reference_has_a_negative_time_constant() -> None:
    x = signal()
    found = lag(low_passed(x, 0.3), x)
    assert found.form == "filter"
    assert found.filter.value == pytest.approx(-0.3, rel=0.05)


def test_a_filter_and_a_delay() -> None:
    x = signal()
    found = lag(x + noise(0.01, 1), shifted(low_passed(x, 0.3), 0.2) + noise(0.005, 2))
    assert found.form == "both"
    assert found.filter.value == pytest.approx(0.3, rel=0.1)
    assert found.delay.value == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_lag(seed: int) -> None:
    x = signal(seed)
    found = lag(x + noise(0.3, 10 + seed), x + noise(0.1, 20 + seed))
    assert found.form == "none"
    assert abs(found.total.value) < 0.01


def test_slow_signals_leave_the_form_open() -> None:
    # With slow motion and much noise, delay and filter fit alike: only their sum is stated.
    x = signal(0, tau_s=4.0)
    y = low_passed(x, 0.3) + noise(0.05, 2)
    found = lag_between(smooth(x + noise(0.5, 1)), smooth(y), np.ones(N))
    assert found is None or found.form in ("lag", "none")


def test_unrelated_signals_are_not_decided() -> None:
    assert lag_between(signal(0), signal(1), np.ones(N)) is None


def test_too_few_blocks_are_not_decided() -> None:
    x = signal()[:1000]
    assert lag_between(x, x, np.ones(1000)) is None
