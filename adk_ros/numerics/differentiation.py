# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Smoothing of evenly sampled signals."""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray

SMOOTHING_WINDOW_S = 0.5
"""Window of a local polynomial, s: passes the dynamics of a car (below 2 Hz), averages noise."""
POLYNOMIAL_ORDER = 3


def window_samples(
    sample_period_s: float,
    window_s: float = SMOOTHING_WINDOW_S,
    order: int = POLYNOMIAL_ORDER,
) -> int:
    """
    Return the number of samples of a window: odd, nearest to `window_s`, at least order + 2.

    With fewer than order + 2 samples the polynomial would pass through every sample.
    """
    nearest = 2 * int(window_s / sample_period_s / 2.0) + 1
    least = order + 2 + (order + 1) % 2
    return max(nearest, least)


def savitzky_golay(
    values: FloatArray,
    sample_period_s: float,
    window_s: float = SMOOTHING_WINDOW_S,
    order: int = POLYNOMIAL_ORDER,
) -> FloatArray:
    """
    Return `values` (n,), sampled every `sample_period_s`, smoothed by local polynomials.

    Each value is replaced by the least-squares polynomial of the window around it; near the ends
    by the polynomial of the first or last complete window. A series shorter than a window is
    returned unchanged. A. Savitzky, M. J. E. Golay, Analytical Chemistry 36 (1964) 1627.
    """
    n = values.shape[0]
    window = window_samples(sample_period_s, window_s, order)
    if n < window:
        return np.array(values, dtype=np.float64)
    half = window // 2
    at = np.arange(-half, window - half, dtype=np.float64)
    basis = np.vander(at / half, order + 1, increasing=True)
    hat = basis @ np.linalg.pinv(basis)
    out = np.convolve(values, hat[half][::-1], mode="same")
    out[:half] = hat[:half] @ values[:window]
    out[n - (window - half) :] = hat[half:] @ values[n - window :]
    return np.asarray(out, dtype=np.float64)
