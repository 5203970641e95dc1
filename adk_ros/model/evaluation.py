# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rollouts of a model along a record, with the errors that the vehicle would have seen.

The predictor steps through the samples, adaptation included, and is rolled out from chosen rows
under the recorded commands. Of the data after a row, only those commands enter its prediction.
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
"""
Samples before a scored row on which the predictor adapts: 50 s, the window of the default online
method, so that its window is full.
"""


@dataclass(frozen=True)
class Rollouts:
    """
    Predictions made at `rows` (n,) of `record`, SI.

    `predicted` (n, ahead, 3): under known commands; `held_input_predictions` (n, ahead, 3): with
    the commands held constant from the row on, as the node publishes them.
    """

    record: Record
    rows: IntArray
    predicted: FloatArray
    held_input_predictions: FloatArray


def sample_at(record: Record, row: int) -> Sample:
    """Return a row of the record as the sample that it was made from."""
    x, u, a = record.x[row], record.u[row], record.a[row]
    return Sample(
        int(record.stamp_ns[row]),
        (float(x[0]), float(x[1]), float(x[2])),
        (float(u[0]), float(u[1])),
        (float(a[0]), float(a[1])),
        int(record.flags[row]),
    )


def observed_states(model: KoopmanModel, record: Record, count: int | None = None) -> FloatArray:
    """
    Return the states (n, 3) of the model's observer along a record, SI.

    The measured ones where it makes no prediction, and from row `count` on.
    """
    predictor = Predictor(model, horizon_steps=0)
    states: FloatArray = record.x.copy()
    for row in range(len(record) if count is None else count):
        if row and record.episode[row] != record.episode[row - 1]:
            predictor.reset()
        if predictor.step(sample_at(record, row)) is not None:
            states[row] = predictor.filtered_state
    return states


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
    Predict from every `stride`-th row that has `ahead` measurements after it.

    `scored` (n,) restricts the rows and their whole horizons. The predictor adapts on up to
    `WARM_UP_STEPS` samples before each. `min_history`: past samples required of a row, so that
    models of different history are scored on the same rows. `progress(done, total)` counts
    samples.
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
    kept, predicted, held_input = [], [], []
    last = -2
    todo = np.flatnonzero(needed)
    for done, row in enumerate(todo):
        if progress is not None and done % 500 == 0:
            progress(done, len(todo))
        if row != last + 1:
            predictor.reset()
        last = int(row)
        prediction = predictor.step(sample_at(record, last), with_horizon=bool(wanted[row]))
        if wanted[row] and prediction is not None:
            kept.append(last)
            held_input.append(prediction.horizon)
            predicted.append(predictor.rollout(record.u[last : last + ahead]))
    if progress is not None:
        progress(len(todo), len(todo))
    return Rollouts(
        record,
        np.array(kept, dtype=np.int64),
        np.array(predicted).reshape(-1, ahead, 3),
        np.array(held_input).reshape(-1, ahead, 3),
    )


def _rows_to_simulate(rows: IntArray, n: int) -> BoolArray:
    """Return a mask (n,) of the scored rows and the warm-up samples before them."""
    change = np.zeros(n + 1, dtype=np.int64)
    np.add.at(change, np.maximum(rows - WARM_UP_STEPS, 0), 1)
    np.add.at(change, rows + 1, -1)
    return np.asarray(np.cumsum(change)[:n] > 0)
