# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weights of the naive predictors that take over from a model, from its errors outside the test.

For each channel and scored horizon, with errors m of the model and n of the naive predictor that
has the smallest RMSE there, both over the training and the validation part:

    L = log(RMSE m / RMSE n)                     the model is better below 0
    w = sum m (m - n) / sum (m - n)^2            least squares of the error m + w (n - m)

The model stays alone, w = 0, where it is better by more than one standard error of L. Elsewhere
the naive predictor has the benefit of the doubt: w plus one standard error, from 0 to 1. Between
the scored horizons the weights are linear.

A recording of one minute has 4 s of validation data, too few to decide alone. On training data
the errors of the model are too small: they are multiplied by the factor by which its RMSE ratio is
larger on validation data. The logarithm D > 0 of this factor, with standard error s, is shrunk by
1 - s^2 / D^2, as James and Stein shrink a mean.

Standard errors are those of ratios of sums over blocks of 2 s, the longest horizon: errors in
different blocks overlap at most with those of the neighbouring one. They are multiplied by the
quantile of Student's t that corresponds to one standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from adk_ros.model.evaluation import WARM_UP_STEPS, Rollouts, rollout_record
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.uncertainty.fallback import COMMANDS, Fallback
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.signals.score import HORIZON_STEPS, NAIVE_PREDICTORS, naive_predictions
from adk_ros.train.dataset import TRAIN, VALIDATION, Split

_AHEAD = HORIZON_STEPS[-1]
_STRIDE = 8
"""Rows between two rollouts, as for the covariances of the horizon."""
_ONE_DEVIATION = float(ndtr(1.0))
"""Share of a normal variable below one standard deviation over its mean."""
_NO_ERROR = 1e-12
"""Mean square, SI, below which an error counts as none: a channel that never changes."""

Progress = Callable[[int, int], None]


class _Part(NamedTuple):
    """
    Errors at the scored horizons on one part of the data, all records joined.

    `model` (2, n, steps, 3): by kind of commands. `naive` (predictors, n, steps, 3). `block` (n,):
    number of the block of a row. `measured` (n, 3): whether the record measures the channel.
    """

    model: FloatArray
    naive: FloatArray
    block: IntArray
    measured: BoolArray


class _Pair(NamedTuple):
    """Errors (n,) of a model and of a naive predictor, and the number of the block of each."""

    model: FloatArray
    naive: FloatArray
    block: IntArray


def find_fallback(
    model: KoopmanModel,
    split: Split,
    validated: Sequence[Rollouts],
    progress: Progress | None = None,
) -> Fallback:
    """
    Return the fallback of a model, whose predictions on the validation part are `validated`.

    Of the training part, the rows count before which the adaptation has had time: a full window,
    or, in a recording that is too short for that, half the samples before its validation part.
    """
    trained = []
    for number, (record, parts) in enumerate(zip(split.records, split.parts, strict=True)):

        def report(done: int, total: int, number: int = number) -> None:
            if progress is not None:
                progress(number * total + done, len(split.records) * total)

        # A later row would leave one block or none of a short recording, and with so little to go
        # by, naive predictors would take over from a model that is three times as good.
        first = min([WARM_UP_STEPS, *(np.flatnonzero(parts == VALIDATION)[:1] // 2)])
        scored = (parts == TRAIN) & (np.arange(len(record)) >= first)
        trained.append(
            rollout_record(model, record, None, scored, _AHEAD, _STRIDE, progress=report)
        )
    return fallback_of(trained, validated)


def fallback_of(trained: Sequence[Rollouts], validated: Sequence[Rollouts]) -> Fallback:
    """Return the fallback for rollouts on the training and on the validation part."""
    trained = [item for item in trained if item.rows.size]
    validated = [item for item in validated if item.rows.size]
    if not validated:
        return Fallback.none()
    names = _common_names([*trained, *validated])
    parts = [_joined(part, names) for part in (trained, validated) if part]
    found = np.zeros((len(COMMANDS), len(NAIVE_PREDICTORS), len(HORIZON_STEPS), 3))
    for commands, step, channel in np.ndindex(len(COMMANDS), len(HORIZON_STEPS), 3):
        if not parts[-1].measured[:, channel].any():
            continue
        used = [part for part in parts if part.measured[:, channel].any()]
        best = _best_naive(used, step, channel)
        pairs = [
            _Pair(
                part.model[commands, part.measured[:, channel], step, channel],
                part.naive[best, part.measured[:, channel], step, channel],
                part.block[part.measured[:, channel]],
            )
            for part in used
        ]
        found[commands, best, step, channel] = _weight(_pooled(pairs))
    return Fallback(_at_all_steps(found)) if found.any() else Fallback.none()


def _common_names(rolled: Sequence[Rollouts]) -> tuple[str, ...]:
    """Return the naive predictors that all records allow: the last one needs an IMU."""
    with_imu = all(np.isfinite(item.record.a[item.rows]).all() for item in rolled)
    return NAIVE_PREDICTORS if with_imu else NAIVE_PREDICTORS[:-1]


def _joined(rolled: Sequence[Rollouts], names: Sequence[str]) -> _Part:
    index = np.array(HORIZON_STEPS)
    model, naive, block, measured = [], [], [], []
    blocks = 0
    for item in rolled:
        reference = item.record.x_ref[item.rows[:, None] + index]
        tables = item.predicted, item.held_input_predictions
        model.append([table[:, index - 1] - reference for table in tables])
        predictions = naive_predictions(item.record, item.rows, _AHEAD)
        naive.append([predictions[name][:, index - 1] - reference for name in names])
        block.append(blocks + _blocks(item.rows))
        blocks = int(block[-1][-1]) + 1
        measured.append(np.tile(item.record.measured, (item.rows.size, 1)))
    return _Part(
        np.concatenate(model, axis=1),
        np.concatenate(naive, axis=1),
        np.concatenate(block),
        np.concatenate(measured),
    )


def _blocks(rows: IntArray) -> IntArray:
    """Return the number of the block of each row: as long as the horizon, without a gap."""
    block = np.zeros(rows.size, dtype=np.int64)
    start, number = rows[0], 0
    for i in range(1, rows.size):
        if rows[i] - rows[i - 1] > _AHEAD or rows[i] - start >= _AHEAD:
            start, number = rows[i], number + 1
        block[i] = number
    return block


def _best_naive(parts: Sequence[_Part], step: int, channel: int) -> int:
    """Return the naive predictor with the smallest sum of squares over all parts."""
    squares = [
        np.square(part.naive[:, part.measured[:, channel], step, channel]).sum(axis=1)
        for part in parts
    ]
    return int(np.argmin(np.sum(squares, axis=0)))


def _pooled(pairs: Sequence[_Pair]) -> _Pair:
    """Return all errors of the parts, those of the model on training data made larger."""
    if len(pairs) == 1:
        return pairs[0]
    trained, validated = pairs
    (of_trained, error), (of_validated, other) = _log_ratio(trained), _log_ratio(validated)
    difference = of_validated - of_trained
    factor = 0.0
    if difference > 0.0:
        factor = difference * max(0.0, 1.0 - (error**2 + other**2) / difference**2)
    return _Pair(
        np.concatenate([trained.model * np.exp(factor), validated.model]),
        np.concatenate([trained.naive, validated.naive]),
        np.concatenate([trained.block, validated.block + trained.block[-1] + 1]),
    )


def _weight(pair: _Pair) -> float:
    """Return the weight of the naive predictor."""
    if max(np.mean(pair.model**2), np.mean(pair.naive**2)) < _NO_ERROR:
        return 0.0
    log_ratio, error = _log_ratio(pair)
    if log_ratio + error < 0.0:
        return 0.0
    difference = pair.model - pair.naive
    weight, error = _ratio(pair.model * difference, difference**2, pair.block)
    return float(np.clip(weight + error, 0.0, 1.0))


def _log_ratio(pair: _Pair) -> tuple[float, float]:
    """Return the logarithm of the RMSE of the model over that of the other, and its error."""
    ratio, error = _ratio(pair.model**2, pair.naive**2, pair.block)
    # d log sqrt(q) = dq / 2q.
    return 0.5 * float(np.log(max(ratio, _NO_ERROR))), 0.5 * error / max(ratio, _NO_ERROR)


def _ratio(above: FloatArray, below: FloatArray, block: IntArray) -> tuple[float, float]:
    """
    Return the ratio of two sums and its standard error from the sums of blocks.

    The error is that of a ratio estimator (Cochran, Sampling Techniques, 1977, eq. 6.13), times
    the quantile of Student's t; infinite from one block.
    """
    numbers = np.unique(block, return_inverse=True)[1]
    a, b = np.bincount(numbers, above), np.bincount(numbers, below)
    n, total = a.size, max(float(b.sum()), _NO_ERROR)
    ratio = float(a.sum()) / total
    if n < 2:
        return ratio, np.inf
    spread = float(np.sqrt(n / (n - 1) * np.sum((a - ratio * b) ** 2))) / total
    return ratio, float(stdtrit(n - 1, _ONE_DEVIATION)) * spread


def _at_all_steps(found: FloatArray) -> FloatArray:
    """Return weights at the scored horizons (2, predictors, 5, 3) at all steps, linear between."""
    steps = np.arange(1, _AHEAD + 1)
    weights = np.zeros((*found.shape[:2], _AHEAD, found.shape[3]))
    for i, j, c in np.ndindex(found.shape[0], found.shape[1], found.shape[3]):
        weights[i, j, :, c] = np.interp(steps, HORIZON_STEPS, found[i, j, :, c])
    return weights
