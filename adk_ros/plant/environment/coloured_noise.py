# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coloured noise for driver excitation and wind gusts."""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray


def coloured_noise(
    rng: np.random.Generator, n: int, period_s: float, bandwidth_hz: float
) -> FloatArray:
    """Return unit-variance white noise filtered by two first-order low-passes, (n,)."""
    keep = math.exp(-2.0 * math.pi * bandwidth_hz * period_s)
    white = rng.standard_normal(n)
    out = np.empty(n)
    first = second = 0.0
    for k in range(n):
        first = keep * first + (1.0 - keep) * white[k]
        second = keep * second + (1.0 - keep) * first
        out[k] = second
    # Variance of the cascade in steady state, from its impulse response (1 - a)^2 (k + 1) a^k.
    power = (1.0 - keep) ** 4 * (1.0 + keep**2) / (1.0 - keep**2) ** 3
    return out / math.sqrt(power)
