# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Smoothing a sampled signal."""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray

WINDOW_SAMPLES = 25
"""Samples of a local fit: half a second of odometry."""
POLYNOMIAL_ORDER = 3


def savitzky_golay(
    values: FloatArray, window: int = WINDOW_SAMPLES, order: int = POLYNOMIAL_ORDER
) -> FloatArray:
    """
    Return `values` (n,), evenly sampled, each replaced by a polynomial fitted around it.

    A. Savitzky, M. J. E. Golay, Analytical Chemistry 36 (1964) 1627. At either end the first and
    the last whole window's polynomial holds. Series shorter than a window are returned as they
    are.
    """
    n = values.shape[0]
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
