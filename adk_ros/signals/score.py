# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How good is a prediction: errors by horizon, and what anyone could have predicted without a model.

All predictors start from the same causal samples `x` and are scored against the same measurement
with hindsight `x_ref`. An error one step ahead is an innovation: the prediction was made before
the sample was known.
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
"""One step, and 0.25, 0.5, 1 and 2 s."""
DIVERGED = 1e3
"""A prediction further off than this (m/s or rad/s) has diverged and counts as just this far."""
REPORT_SCALE = np.array([3.6, 3.6, 180.0 / math.pi])
"""From m/s, m/s, rad/s to the km/h, km/h, deg/s of reports."""


@dataclass(frozen=True)
class ErrorTable:
    """
    Errors of one predictor: `rmse` and `worst` (steps, 3) in SI units, over `count` starts.

    `diverged` counts the starts whose prediction was not finite or further off than `DIVERGED`.
    """

    steps: tuple[int, ...]
    rmse: FloatArray
    worst: FloatArray
    count: int
    diverged: int


def scorable_rows(record: Record, history: int, ahead: int, stride: int = 1) -> IntArray:
    """
    Rows from which all predictors can be scored.

    `history` samples before and `ahead` after must lie in the same episode, the row itself and its
    history be learnable, and the measurements ahead known.
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
    """The state stays: x_(k+j) = x_k. Shape (n, ahead, 3)."""
    return np.repeat(record.x[rows][:, None, :], ahead, axis=1)


def linear_extrapolation(record: Record, rows: IntArray, ahead: int) -> FloatArray:
    """The last change goes on: x_(k+j) = x_k + j (x_k - x_(k-1)). Shape (n, ahead, 3)."""
    slope = record.x[rows] - record.x[rows - 1]
    return record.x[rows][:, None, :] + np.arange(1, ahead + 1)[None, :, None] * slope[:, None, :]


def imu_integration(record: Record, rows: IntArray, ahead: int) -> FloatArray:
    """
    The specific force stays: dv_x = (a_x + r v_y) dt, dv_y = (a_y - r v_x) dt, r held.

    Shape (n, ahead, 3). The pair is linear with constant coefficients, so each step is its exact
    solution (a turn by -r dt), not an Euler step. NaN where there is no IMU.
    """
    v_x, v_y, rate = (record.x[rows, i].copy() for i in range(3))
    a_x, a_y = record.a[rows, 0], record.a[rows, 1]
    angle = rate * TICK_S
    cos, sin = np.cos(angle), np.sin(angle)
    # Integrals of cos and sin over the step; their limits where the vehicle does not turn.
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
    """All predictors without a model that this record allows, by name."""
    result = {
        "persistence": persistence(record, rows, ahead),
        "straight line": linear_extrapolation(record, rows, ahead),
    }
    if np.isfinite(record.a[rows]).all():
        result["IMU integration"] = imu_integration(record, rows, ahead)
    return result


def score(
    record: Record,
    rows: IntArray,
    predicted: FloatArray,
    steps: tuple[int, ...] = HORIZON_STEPS,
) -> ErrorTable:
    """Score `predicted` (n, ahead, 3), made at `rows` (n,), against the measurement."""
    index = np.array(steps)
    error = predicted[:, index - 1, :] - record.x_ref[rows[:, None] + index[None, :]]
    lost = ~np.isfinite(error) | (np.abs(error) > DIVERGED)
    error = np.where(lost, DIVERGED, error)
    return ErrorTable(
        steps=steps,
        rmse=np.sqrt(np.mean(error**2, axis=0)),
        worst=np.abs(error).max(axis=0),
        count=int(rows.shape[0]),
        diverged=int(lost.any(axis=(1, 2)).sum()),
    )


def pool(scores: Sequence[ErrorTable]) -> ErrorTable:
    """One score over all starts of several, of the same steps; empty ones are left out."""
    used = [item for item in scores if item.count]
    if not used:
        raise ValueError("nothing was scored")
    weights = np.array([item.count for item in used], dtype=np.float64)
    squares = np.array([item.rmse**2 for item in used])
    return ErrorTable(
        steps=used[0].steps,
        rmse=np.sqrt(np.tensordot(weights / weights.sum(), squares, axes=1)),
        worst=np.max([item.worst for item in used], axis=0),
        count=int(weights.sum()),
        diverged=sum(item.diverged for item in used),
    )


def noise_floor(record: Record) -> FloatArray:
    """
    Deviation (3,) of the white noise in `x_ref`, SI.

    A predictor cannot come closer to a noisy measurement than this.
    """
    return white_noise(record.x_ref)


def white_noise(values: FloatArray) -> FloatArray:
    """
    Deviation (k,) of the white noise on evenly sampled signals (n, k); NaN if too few.

    From third differences, in which a smooth signal is gone and white noise is sqrt(20) times as
    large; rows that are not finite are left out.
    """
    third = np.diff(values, n=3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    if third.shape[0] < 10:
        return np.full(values.shape[1], np.nan)
    # The median, so that a few real jerks do not pass for noise.
    return np.asarray(np.median(np.abs(third), axis=0) / 0.6745 / math.sqrt(20.0))


def best_naive(scores: Mapping[str, ErrorTable]) -> FloatArray:
    """Smallest RMSE of any of the given scores, cell by cell, shape (steps, 3)."""
    return np.asarray(np.min([item.rmse for item in scores.values()], axis=0))
