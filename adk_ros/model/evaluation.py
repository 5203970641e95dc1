# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A model's errors on a record, as the vehicle would have met them.

Folds `Predictor.step` over the samples, adaptation included, and from chosen rows rolls the model
out under the commands that the record knows. Nothing after a row enters its prediction but those
commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.signals.channels import Record, Sample
from adk_ros.signals.score import scorable_rows

WARM_UP_STEPS = 2000
"""Samples before a scored stretch that the predictor may adapt on: 50 s, past data only."""


@dataclass(frozen=True)
class Rollouts:
    """
    Predictions (n, ahead, 3) made at `rows` (n,) of `record` in SI units under known commands.

    `held` (n, ahead, 3): the same under commands held from the row on, as the node publishes them.
    """

    record: Record
    rows: IntArray
    predicted: FloatArray
    held_input_predictions: FloatArray


def sample_at(record: Record, row: int) -> Sample:
    """The record's row as the sample it came from."""
    x, u, a = record.x[row], record.u[row], record.a[row]
    return Sample(
        int(record.stamp_ns[row]),
        (float(x[0]), float(x[1]), float(x[2])),
        (float(u[0]), float(u[1])),
        (float(a[0]), float(a[1])),
        int(record.flags[row]),
    )


def rollout_record(
    model: KoopmanModel,
    record: Record,
    online: OnlineSettings | None = None,
    scored: BoolArray | None = None,
    ahead: int = 80,
    stride: int = 4,
    min_history: int = 8,
    progress: Callable[[int, int], None] | None = None,
) -> Rollouts:
    """
    Predict from every `stride`-th row at which the measurements ahead are known.

    `scored` (n,) limits the rows scored (and their whole horizon); up to 20 s before each scored
    stretch are run through for adaptation. `min_history` keeps the rows the same for all models.
    """
    history = max(model.history, min_history)
    rows = scorable_rows(record, history, ahead)
    if scored is not None:
        outside = np.concatenate([[0], np.cumsum(~scored)])
        rows = rows[outside[rows + ahead + 1] == outside[rows]]
    rows = rows[::stride]
    wanted = np.zeros(len(record), dtype=bool)
    wanted[rows] = True
    needed = _rows_to_simulate(rows, len(record))
    predictor = Predictor(model, online, horizon_steps=ahead)
    kept, predicted, held = [], [], []
    last = -2
    todo = np.flatnonzero(needed)
    for done, row in enumerate(todo):
        if progress is not None and done % 500 == 0:
            progress(done, len(todo))
        if row != last + 1:
            predictor.reset()
        last = int(row)
        predictor.horizon_steps = ahead if wanted[row] else 0
        prediction = predictor.step(sample_at(record, last))
        if wanted[row] and prediction is not None:
            kept.append(last)
            held.append(prediction.horizon)
            predicted.append(predictor.rollout(record.u[last : last + ahead]))
    if progress is not None:
        progress(len(todo), len(todo))
    return Rollouts(
        record,
        np.array(kept, dtype=np.int64),
        np.array(predicted).reshape(-1, ahead, 3),
        np.array(held).reshape(-1, ahead, 3),
    )


def _rows_to_simulate(rows: IntArray, n: int) -> BoolArray:
    """Rows to run through: the scored ones and what comes before them."""
    change = np.zeros(n + 1, dtype=np.int64)
    np.add.at(change, np.maximum(rows - WARM_UP_STEPS, 0), 1)
    np.add.at(change, rows + 1, -1)
    return np.asarray(np.cumsum(change)[:n] > 0)
