# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whitening of residuals by prediction-error filters.

The residuals of a correct hypothesis are the sensors' white noise, what the observer passes on of
it, and the surrogate's own error. Their autocovariance, in units of the noise variance of a bin,
is delta(k) + p(k) + c(k), with p from `surrogate.passed_noise` and c that of the surrogate's
residuals on the simulation less its known error. An autoregressive filter of order 30 from the
Yule-Walker equations makes them white with unit variance.
"""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.library.criteria import SURROGATE_ERROR_CLIP
from adk_ros.mismatch.surrogate.error_autocovariance import MAX_LAG, autocovariance
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray

_MIN_INNOVATION_VARIANCE = 1e-6


def prediction_error_filters(
    surrogate: SurrogateModel, bin_noise: FloatArray, passed_noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return filters (6, order + 1) for residuals over noise, and twice shares (6,).

    `bin_noise` (6,): standard deviation of a bin's mean, by channel; `passed_noise`
    (6, order + 1): what the observer adds to the autocovariance of the noise. A share is that of
    the surrogate's own error in the variance of its channel; the second without its white part,
    which is noise of the simulation's sensors.
    """
    order = MAX_LAG
    filters = np.zeros((6, order + 1))
    shares, smooth_shares = np.zeros(6), np.zeros(6)
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    for channel in range(6):
        covariance = _normalised_autocovariance(surrogate, channel, float(bin_noise[channel]))
        noise = passed_noise[channel].copy()
        noise[0] += 1.0
        shares[channel] = covariance[0] / (noise[0] + covariance[0])
        # Extrapolated from the next two bins: white noise is correlated with none.
        smooth = np.clip(2.0 * covariance[1] - covariance[2], 0.0, covariance[0])
        smooth_shares[channel] = smooth / (noise[0] + covariance[0])
        covariance += noise
        coefficients = np.linalg.solve(covariance[lags], covariance[1:])
        innovation = covariance[0] - coefficients @ covariance[1:]
        filters[channel] = np.concatenate([[1.0], -coefficients]) / np.sqrt(
            max(innovation, _MIN_INNOVATION_VARIANCE)
        )
    return filters, shares, smooth_shares


def _normalised_autocovariance(
    surrogate: SurrogateModel, channel: int, noise: float
) -> FloatArray:
    """Return the autocovariance (order + 1,) of the surrogate's error over the noise."""
    if surrogate.autocovariance is not None:
        clipped = surrogate.autocovariance.clipped_at(channel, SURROGATE_ERROR_CLIP * noise)
        return np.asarray(clipped / noise**2)
    error = surrogate.unexplained_residuals[channel] / noise
    error = np.clip(error - error.mean(), -SURROGATE_ERROR_CLIP, SURROGATE_ERROR_CLIP)
    return autocovariance(error)
