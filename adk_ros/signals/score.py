# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction errors by horizon, and naive predictors, which need no model.

All predictors start from the same causal samples `x` and are scored against the same non-causal
reference measurement `x_ref`. A one-step error is an innovation: the prediction was made before
the sample was used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, Record

TICK_S = TICK_NS * 1e-9
HORIZON_STEPS = (1, 10, 20, 40, 80)
"""Scored horizons, steps of 25 ms: 25 ms, 0.25, 0.5, 1 and 2 s."""
DIVERGED = 1e3
"""m/s or rad/s; larger errors count as diverged, and as exactly this error in the RMSE."""
REPORT_SCALE = np.array([3.6, 3.6, 180.0 / math.pi])
"""Factors from m/s, m/s, rad/s to the km/h, km/h, deg/s of reports."""
DISPLAY_NAMES = {"straight line": "linear extrapolation"}
"""Names in printed tables of the predictors whose name in JSON files differs."""
NAIVE_PREDICTORS = ("persistence", "straight line", "IMU integration")
"""Names of the naive predictors; the last one needs an IMU."""
MAD_TO_SIGMA = 0.6745
"""Median of the absolute value of a standard normal variable."""


@dataclass(frozen=True)
class ErrorTable:
    """
    Errors of one predictor: `rmse` and `worst` (steps, 3) in SI units, over `count` starts.

    `diverged` counts the starts with a prediction that is not finite or off by over `DIVERGED`.
    """

    steps: tuple[int, ...]
    rmse: FloatArray
    worst: FloatArray
    count: int
    diverged: int


def scorable_rows(record: Record, history: int, ahead: int, stride: int = 1) -> IntArray:
    """
    Return the rows from which all predictors can be scored.

    The `history` samples before and the `ahead` samples after a row are in the same episode, the
    row and its history are learnable, and the later measurements are known.
    """
    n = len(record)
    good = record.learnable & np.isfinite(record.x).all(axis=1)
    known = np.isfinite(record.x_ref).all(axis=1) & np.isfinite(record.u).all(axis=1)
    rows = np.arange(history, n - ahead)
    if rows.size == 0:
        return rows.astype(np.int64)
    same = record.episode[rows - history] == record.episode[rows + ahead]
    bad_before = np.concatenate([[0], np.cumsum(~good)])
    bad_after = np.concatenate([[0], np.cumsum(~known)])
    clean = bad_before[rows + 1] == bad_before[rows - history]
    clean &= bad_after[rows + ahead + 1] == bad_after[rows]
    chosen: IntArray = rows[same & clean][::stride].astype(np.int64)
    return chosen


def persistence(record: Record, rows: IntArray, ahead: int) -> FloatArray:
    """Return the naive predictor of persistence, x_(k+j) = x_k, shape (n, ahead, 3)."""
    return np.repeat(record.x[rows][:, None, :], ahead, axis=1)


def linear_extrapolation(record: Record, rows: IntArray, ahead: int) -> FloatArray:
    """
    Return the naive predictor of linear extrapolation, shape (n, ahead, 3).

    x_(k+j) = x_k + j (x_k - x_(k-1)).
    """
    slope = record.x[rows] - record.x[rows - 1]
    return record.x[rows][:, None, :] + np.arange(1, ahead + 1)[None, :, None] * slope[:, None, :]


def imu_integration(record: Record, rows: IntArray, ahead: int) -> FloatArray:
    """
    Return the naive predictor of IMU integration, shape (n, ahead, 3).

    Specific force and yaw rate r stay constant: dv_x = (a_x + r v_y) dt, dv_y = (a_y - r v_x) dt.
    The system is linear with constant coefficients, so each step is its exact solution (a rotation
    by -r dt). NaN without an IMU.
    """
    v_x, v_y, rate = (record.x[rows, i].copy() for i in range(3))
    a_x, a_y = record.a[rows, 0], record.a[rows, 1]
    angle = rate * TICK_S
    cos, sin = np.cos(angle), np.sin(angle)
    # Integrals of cos and sin over the step, with their limits for zero yaw rate.
    safe = np.where(np.abs(angle) < 1e-9, 1.0, angle)
    into = np.where(np.abs(angle) < 1e-9, 1.0, np.sin(safe) / safe) * TICK_S
    across = np.where(np.abs(angle) < 1e-9, 0.0, (1.0 - np.cos(safe)) / safe) * TICK_S
    result = np.empty((rows.shape[0], ahead, 3))
    for step in range(ahead):
        v_x, v_y = (
            cos * v_x + sin * v_y + into * a_x + across * a_y,
            -sin * v_x + cos * v_y - across * a_x + into * a_y,
        )
        result[:, step, 0], result[:, step, 1], result[:, step, 2] = v_x, v_y, rate
    return result


def naive_predictions(record: Record, rows: IntArray, ahead: int) -> dict[str, FloatArray]:
    """
    Return the predictions of each naive predictor that the record allows, by name.

    Rows without an IMU, as before its first reading, have persistence in place of its integration;
    a record without any IMU at these rows has no such predictor.
    """
    without_imu, with_imu = NAIVE_PREDICTORS[:2], NAIVE_PREDICTORS[2]
    functions = persistence, linear_extrapolation
    result = {
        name: function(record, rows, ahead)
        for name, function in zip(without_imu, functions, strict=True)
    }
    known = np.asarray(np.isfinite(record.a[rows]).all(axis=1))
    if known.any():
        integrated = imu_integration(record, rows, ahead)
        result[with_imu] = np.where(known[:, None, None], integrated, result[without_imu[0]])
    return result


def score(
    record: Record,
    rows: IntArray,
    predicted: FloatArray,
    steps: tuple[int, ...] = HORIZON_STEPS,
) -> ErrorTable:
    """
    Return the errors of `predicted` (n, ahead, 3), made at `rows` (n,), against `x_ref`.

    NaN for channels that are not measured: a constant is predicted without error by persistence.
    """
    index = np.array(steps)
    error = predicted[:, index - 1, :] - record.x_ref[rows[:, None] + index[None, :]]
    diverged = ~np.isfinite(error) | (np.abs(error) > DIVERGED)
    error = np.where(diverged, DIVERGED, error)
    error[:, :, ~record.measured] = np.nan
    return ErrorTable(
        steps=steps,
        rmse=np.sqrt(np.mean(error**2, axis=0)),
        worst=np.abs(error).max(axis=0),
        count=int(rows.shape[0]),
        diverged=int(diverged.any(axis=(1, 2)).sum()),
    )


def pool(scores: Sequence[ErrorTable]) -> ErrorTable:
    """
    Return one table over all starts of several tables with equal steps; empty ones are skipped.

    :raises ValueError: all tables are empty.
    """
    used = [item for item in scores if item.count]
    if not used:
        raise ValueError("no table has a scored start")
    counts = np.array([item.count for item in used], dtype=np.float64)
    squares = np.array([item.rmse**2 for item in used])
    # A channel that one recording does not measure is that of the others.
    weights = np.where(np.isfinite(squares), counts[:, None, None], 0.0)
    total = np.nansum(weights * squares, axis=0)
    weight = weights.sum(axis=0)
    return ErrorTable(
        steps=used[0].steps,
        rmse=np.sqrt(np.divide(total, weight, out=np.full_like(total, np.nan), where=weight > 0)),
        worst=np.fmax.reduce([item.worst for item in used]),
        count=int(counts.sum()),
        diverged=sum(item.diverged for item in used),
    )


def reference_noise(record: Record) -> FloatArray:
    """
    Return the standard deviation (3,) of the white noise in `x_ref`, SI units.

    It is a lower bound of the RMSE of every predictor against a noisy measurement.
    """
    return white_noise(record.x_ref)


def white_noise(values: FloatArray) -> FloatArray:
    """
    Return the standard deviation (k,) of the white noise in evenly sampled signals (n, k).

    Estimated from third differences, which suppress smooth signals and amplify white noise by
    sqrt(20). Rows that are not finite are skipped; NaN if fewer than ten remain.
    """
    third = np.diff(values, n=3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    if third.shape[0] < 10:
        return np.full(values.shape[1], np.nan)
    # The median is robust against a few real jerks.
    return np.asarray(np.median(np.abs(third), axis=0) / MAD_TO_SIGMA / math.sqrt(20.0))


WHITE_NOISE_VARIANCE_ERROR = 9.1
"""
Relative variance of the square of `white_noise` for Gaussian noise, times the number of samples:
4 / (2 f(m) m)² = 5.44 of the squared median of |x| (density f, median m) of independent samples,
times 1.67 for the correlation of third differences, 1 + 2 sum (P(|x_i| < m, |x_j| < m) - 1/4) /
(1/4) with correlations of -0.75, 0.3 and -0.05.
"""


def best_naive(scores: Mapping[str, ErrorTable]) -> FloatArray:
    """Return the smallest RMSE of the given tables for each (step, channel), shape (steps, 3)."""
    return np.asarray(np.min([item.rmse for item in scores.values()], axis=0))
