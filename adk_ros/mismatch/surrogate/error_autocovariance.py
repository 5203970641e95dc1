# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Autocovariance of the surrogate's own error, in a form that a file can hold.

The whitening filter needs the autocovariance of the surrogate's residuals on the simulation after
they are clipped at a multiple of the recording's noise. That noise is not known when the file is
written, so the autocovariance is tabulated for several clip limits. Above the largest residual it
is exact. Between two limits, log(variance) is interpolated linearly in log(limit), and so is the
autocorrelation; below the smallest limit the variance is proportional to the squared limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray

MAX_LAG = 30
"""Bins of 40 ms: 1.2 s, longer than the correlation of the residuals."""
_MIN_PEAK = 1e-12
"""SI; keeps the limits of a channel without residuals positive."""
_MIN_VARIANCE = 1e-300
_LIMIT_SHARES = (0.015625, 0.03125, 0.0625, 0.125, 0.25, 0.5, 1.0)
"""Clip limits, as shares of a channel's largest residual."""


def autocovariance(values: FloatArray, max_lag: int = MAX_LAG) -> FloatArray:
    """Return the biased autocovariance (max_lag + 1,) of zero-mean values (n,)."""
    n = values.shape[0]
    return np.array([values[: n - k] @ values[k:] / n for k in range(max_lag + 1)])


@dataclass(frozen=True)
class ErrorAutocovariance:
    """
    Autocovariance of clipped residuals, squared SI units.

    `limits` (6, l) ascending clip limits by channel, `values` (6, l, lags + 1).
    """

    limits: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, residuals: FloatArray) -> ErrorAutocovariance:
        """Tabulate the autocovariance of residuals (6, bins)."""
        centred = residuals - residuals.mean(axis=1, keepdims=True)
        peak = np.maximum(np.abs(centred).max(axis=1), _MIN_PEAK)
        limits = np.outer(peak, _LIMIT_SHARES)
        values = [
            [autocovariance(np.clip(row, -limit, limit)) for limit in of_channel]
            for row, of_channel in zip(centred, limits, strict=True)
        ]
        return cls(limits, np.array(values))

    def clipped_at(self, channel: int, limit: float) -> FloatArray:
        """Return the autocovariance (lags + 1,) of a channel's residuals clipped at `limit`."""
        limits, values = self.limits[channel], self.values[channel]
        if limit >= limits[-1]:
            return np.asarray(values[-1])
        variance = np.maximum(values[:, 0], _MIN_VARIANCE)
        correlation = values / variance[:, None]
        above = int(np.searchsorted(limits, limit))
        if above == 0:
            return np.asarray(correlation[0] * variance[0] * (limit / limits[0]) ** 2)
        below = above - 1
        share = np.log(limit / limits[below]) / np.log(limits[above] / limits[below])
        interpolated = variance[below] ** (1.0 - share) * variance[above] ** share
        mean = (1.0 - share) * correlation[below] + share * correlation[above]
        return np.asarray(interpolated * mean)
