# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pulses of which no single residual is beyond noise."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.mismatch.inference.lasting_residuals import WINDOWS, largest_mean, lasting_residuals
from adk_ros.numerics.arrays import FloatArray

BINS = 5500
"""Of 220 s."""


def noise(seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((6, BINS))


def test_noise_causes_none() -> None:
    for seed in range(20):
        assert not lasting_residuals(noise(seed)).any()


@pytest.mark.parametrize("width", [5, 8, 15, 30])
def test_a_weak_pulse_is_found_where_it_acts(width: int) -> None:
    e = noise()
    # A mean of eleven standard deviations, of which no residual exceeds eight.
    e[1, 1000 : 1000 + width] += 11.0 / np.sqrt(width)
    e[1] = np.clip(e[1], -7.9, 7.9)
    found = lasting_residuals(e)
    assert not found[[0, 2, 3, 4, 5]].any()
    at = np.flatnonzero(found[1])
    within = (at >= 1000) & (at < 1000 + width)
    assert within.sum() >= min(width, max(WINDOWS)) // 2
    assert at.min() >= 1000 - max(WINDOWS) // 2
    assert at.max() < 1000 + width + max(WINDOWS) // 2


def test_the_sign_of_a_pulse_does_not_matter_and_opposite_ones_cancel() -> None:
    e = noise()
    e[2, 300:320] -= 3.0
    assert lasting_residuals(e)[2, 305:315].all()
    alternating = noise()
    alternating[2, 300:320] += np.tile([3.0, -3.0], 10)
    assert not lasting_residuals(alternating).any()


def test_one_outlier_is_no_lasting_residual() -> None:
    e = noise()
    e[0, 200] = 100.0
    assert not lasting_residuals(e).any()


def test_what_lasts_in_all_of_a_channel_is_no_episode() -> None:
    """Correlated residuals of 1.8 times the noise: an error of the surrogate, not of seconds."""
    e = noise()
    for i in range(1, BINS):
        e[1, i] = 0.5 * e[1, i - 1] + np.sqrt(0.75) * e[1, i]
    e[1] *= 1.8
    assert not lasting_residuals(e).any()
    e[1, 1000:1020] += 8.0
    assert np.flatnonzero(lasting_residuals(e).any(axis=0)).min() > 980


@pytest.mark.parametrize("every", [2, 3])
def test_a_pulse_is_found_in_a_slow_sensor(every: int) -> None:
    """Of whose readings only every second or third bin has one."""
    e = noise()
    e[1, 1000:1020] += 15.0 / np.sqrt(20 / every)
    e = np.clip(e, -7.9, 7.9)
    e[:, np.arange(BINS) % every != 0] = 0.0
    assert lasting_residuals(e)[1].any()
    assert not lasting_residuals(e)[[0, 2, 3, 4, 5]].any()


def test_recordings_shorter_than_a_window_have_none() -> None:
    for bins in range(max(WINDOWS) + 2):
        assert lasting_residuals(np.full((6, bins), 1.0)).shape == (6, bins)


def test_the_largest_mean_has_its_channel_and_place() -> None:
    e = 0.1 * noise()
    e[3, 700:710] -= 2.0
    e[3, 710:720] += 3.0
    e[4, 60] = 5.0
    mean = largest_mean(e)
    assert (mean.channel, mean.bins) == (3, slice(710, 720))
    assert mean.sigmas == pytest.approx(3.0 * np.sqrt(10.0), rel=0.05)
    few = largest_mean(np.array([[1.0, 1.0, 1.0], [0.5, 4.0, 0.5]]))
    assert (few.channel, few.bins) == (1, slice(0, 3))
    assert few.sigmas == pytest.approx(5.0 / np.sqrt(3.0))


def test_windows_do_not_miss_much_between_their_durations() -> None:
    """A pulse of a duration between two windows loses at most 16 % of its size."""
    for width in range(WINDOWS[0], WINDOWS[-1] + 1):
        own = np.sqrt(width)
        best = max(min(w, width) / np.sqrt(w) for w in WINDOWS)
        assert best / own > 0.84
