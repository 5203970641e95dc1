# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scores of 90 % prediction intervals: coverage, width and interval score.

The interval score is width + 20 times the distance of a measurement that lies outside
(Gneiting and Raftery, Strictly Proper Scoring Rules, 2007, section 6.2, alpha = 0.1). Its
expectation is least for the true 5 % and 95 % quantiles: an interval can neither cover by being
wide nor be narrow by missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import QUANTILE_90

_PENALTY = 20.0
"""2 / alpha."""


@dataclass(frozen=True)
class IntervalScore:
    """
    Scores of the intervals of a test by horizon and channel, (5, 3) each.

    `claimed`: number of intervals that a measurement was compared with, `covered`: of those that
    contain it. `width` and `score`: means, SI, NaN without an interval.
    """

    covered: IntArray
    claimed: IntArray
    width: FloatArray
    score: FloatArray


def score_intervals(
    predicted: FloatArray, variance: FloatArray, measured: FloatArray
) -> IntervalScore:
    """
    Score the intervals around `predicted` with the error `variance`, (m, 5, 3) each.

    `measured` (m, 5, 3), NaN where there is no measurement. A prediction that is not finite has an
    interval that misses; it has no distance and counts in `covered` alone.
    """
    finite = np.isfinite(predicted)
    has_interval = np.isfinite(variance) & np.isfinite(measured)
    half = QUANTILE_90 * np.sqrt(np.where(has_interval, variance, np.nan))
    distance = np.abs(np.where(finite, predicted, np.nan) - measured)
    within = distance <= half
    both = has_interval & finite
    count = np.maximum(both.sum(axis=0), 1)
    width = np.where(both, 2.0 * half, 0.0).sum(axis=0) / count
    beyond = np.where(both, np.maximum(distance - half, 0.0), 0.0).sum(axis=0) / count
    none = ~both.any(axis=0)
    width[none] = np.nan
    return IntervalScore(
        covered=(has_interval & within).sum(axis=0),
        claimed=has_interval.sum(axis=0),
        width=width,
        score=width + _PENALTY * beyond,
    )


def with_own_error(predicted: FloatArray, measured: FloatArray) -> IntervalScore:
    """
    Score a predictor without intervals, (m, 5, 3) each: with those from its RMSE on this test.

    No such predictor knows its error beforehand, so this favours it.
    """
    error = predicted - measured
    known = np.isfinite(error)
    count = np.maximum(known.sum(axis=0), 1)
    square = np.where(known, error, 0.0) ** 2
    variance = np.where(known.any(axis=0), square.sum(axis=0) / count, np.nan)
    return score_intervals(predicted, np.broadcast_to(variance, predicted.shape), measured)
