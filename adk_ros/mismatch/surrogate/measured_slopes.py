# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A measured grade and bank as terms of a run, and what their error leaves in the residuals."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.recording.measured_road import MeasuredRoad
from adk_ros.mismatch.surrogate.error_autocovariance import MAX_LAG, autocovariance
from adk_ros.mismatch.surrogate.residuals import MAX_RESIDUAL, ResidualProblem
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import FloatArray

HOLD_S = 0.04
"""s over which a slope is held: a residual bin; at 10 m/s a road changes little over 0.4 m."""


def slope_terms(road: MeasuredRoad, at_s: FloatArray) -> ActiveTerms:
    """Return the measured slopes as terms at the middles of steps (n,), s."""
    return _terms(road, road.values_at(_held(at_s)))


def slope_error_autocovariance(
    problem: ResidualProblem, parameters: FloatArray, terms: ActiveTerms
) -> FloatArray:
    """
    Return what the errors of measured slopes add to the residuals' autocovariance (6, lags + 1).

    In units of the variance of a bin's noise. Specific force and velocity deviate from the slopes
    by the errors of all three, so this is an upper bound.
    """
    road = problem.log.road
    out = np.zeros((problem.counts.shape[0], MAX_LAG + 1))
    if road is None:
        return out
    base = problem.residuals(parameters, terms)
    errors = _terms(road, road.errors_at(_held(problem.middle_s)))
    changed = problem.residuals(parameters, terms.merged_with(errors)) - base
    if max(np.abs(base).max(), np.abs(changed).max()) >= MAX_RESIDUAL:
        return out
    for channel, row in enumerate(changed / problem.bin_noise[:, None]):
        out[channel] = autocovariance(row)
    return out


def _held(at_s: FloatArray) -> FloatArray:
    return np.asarray((np.floor(at_s / HOLD_S) + 0.5) * HOLD_S)


def _terms(road: MeasuredRoad, values: FloatArray) -> ActiveTerms:
    count = len(road.entries)
    rows = np.arange(1, count + 1)
    activations = np.vstack([np.ones(values.shape[1]), values])
    return ActiveTerms(road.index, np.ones(count), rows, activations)
