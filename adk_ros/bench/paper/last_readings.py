# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Predictions of the baselines at rows that repeat an old reading: from the last new one.

Our predictor knows from the flags which readings are old, and goes on from its prediction. A
baseline that took an old reading for the present state would use less than it is given.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record

MAX_AGE = 8
"""Rows; no older reading is used: every start of the tests has as many before it."""

Predict = Callable[[IntArray, IntArray, int], FloatArray]
"""Of positions in `rows` (m,), rows to start from (m,) and steps: states (m, steps, 3)."""


def predict_from_new_readings(
    record: Record, rows: IntArray, ahead: int, predict: Predict, past: int = 0
) -> FloatArray:
    """
    Return states (n, ahead, 3) after `rows` (n,), each predicted from the last new reading.

    :param predict: called once for each age of a reading; what it predicts up to the row is left
        out.
    :param past: rows before a start that `predict` uses as well.
    """
    starts = last_new(record, rows, past)
    age = rows - starts
    out = np.empty((rows.shape[0], ahead, 3))
    for passed in np.unique(age).tolist():
        chosen = np.flatnonzero(age == passed)
        out[chosen] = predict(chosen, starts[chosen], ahead + passed)[:, passed:]
    return out


def last_new(record: Record, rows: IntArray, past: int = 0) -> IntArray:
    """Return the last row with a new reading up to each of `rows`; without one, the row itself."""
    last = np.maximum.accumulate(np.where(record.learnable, np.arange(len(record)), -1))[rows]
    first = last - past
    usable = first >= np.maximum(rows - MAX_AGE, 0)
    usable &= record.episode[np.maximum(first, 0)] == record.episode[rows]
    return np.asarray(np.where(usable, last, rows))
