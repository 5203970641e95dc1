# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What odometry publishes of a yaw rate that it low-pass filters, and what the filter hides.

    lag dr_f/dt = r - r_f

r: yaw rate of the car, r_f: the published one. A prediction starts from r = r_f + lag dr_f/dt, and
is compared with r_f, which continues from the published value.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter  # type: ignore[import-untyped, unused-ignore]

from adk_ros.numerics.arrays import FloatArray

_SLOPE_INTERVALS = 2
"""
Intervals over which dr_f/dt is taken: the least that is longer than one, whose noise is twice as
large. The value is then one interval old.
"""


def without_lag(stamps_s: FloatArray, rate: FloatArray, lag_s: float) -> FloatArray:
    """
    Return the yaw rate (n,) before the filter, rad/s, of published ones (n,) at `stamps_s`.

    Each uses messages up to its stamp only.
    """
    if lag_s <= 0.0 or rate.size <= _SLOPE_INTERVALS:
        return rate
    slope = np.zeros_like(rate)
    span = stamps_s[_SLOPE_INTERVALS:] - stamps_s[:-_SLOPE_INTERVALS]
    change = rate[_SLOPE_INTERVALS:] - rate[:-_SLOPE_INTERVALS]
    slope[_SLOPE_INTERVALS:] = np.divide(change, span, out=np.zeros_like(change), where=span > 0)
    return np.asarray(rate + lag_s * slope)


def with_lag(rate: FloatArray, published: float, lag_s: float, step_s: float) -> FloatArray:
    """
    Return the published yaw rate (n,) at the ends of steps with the mean `rate` (n,), rad/s.

    `published`: before the first step.
    """
    keep = np.exp(-step_s / lag_s)
    out, _ = lfilter([1.0 - keep], [1.0, -keep], rate, zi=[keep * published])
    return np.asarray(out)
