# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled test of readings against the predicted state; `signals.gate` has the equations."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.array_table import (
    ArrayTable,
    floats_1,
    floats_2,
    floats_3,
    integers_1,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.channels import TICK_NS, Reading

ACCEPTED, REJECTED, NEW_LEVEL, MORE_NOISE = 0, 1, 2, 3
"""Decisions."""
_TICK_S = TICK_NS * 1e-9
_MEMORY_S = 2.5
"""s; time constant of the mean square of innovations, that of `Predictor`'s covariance."""
_PRIOR_READINGS = 20
"""Weight of the initial mean square, in readings: that of 20 has a deviation of a third."""
_MIN_FRACTION, _MAX_FRACTION = -2.0, 1.5
"""Range, in ticks from the predictor's tick, in which the line to the prediction is followed."""
_IMU, _ODOMETRY = 0, 1
MAX_BATCH = 128
"""Readings per call; 25 ms of an IMU at 2 kHz and an odometry at 1 kHz are 75."""
_COLUMNS = 9
_PACK_ROW = struct.Struct(f"{_COLUMNS}d").pack_into
_ROW_BYTES = 8 * _COLUMNS
_NO_VARIANCES = (math.nan, math.nan, math.nan)


class GateArrays(NamedTuple):
    """
    Statistics and expectation of the two streams: 0 IMU (a_x, a_y, yaw_rate), 1 odometry.

    `mean_square`, `floor`, `reported`, `level`, `slope`, `growth` (2, 3): s^2, c^2, mean reported
    variance, expected value at the tick, its change over a tick, and g; SI. `offset` (2,): of the
    specific force from the expected one, as accepted. `n_accepted` (2,):
    readings; `last_s` (2,): time of the last one; `n_refused` (2,) and `refused` (2,
    confirmations, 3): innovations of the readings rejected since. `batch` (MAX_BATCH, 9): readings
    to judge; `outcome` (MAX_BATCH, 4): decision on each, and channel, innovation and bound of a
    rejected one.
    """

    mean_square: FloatArray
    floor: FloatArray
    reported: FloatArray
    level: FloatArray
    slope: FloatArray
    growth: FloatArray
    offset: FloatArray
    n_accepted: NDArray[np.int64]
    last_s: FloatArray
    n_refused: NDArray[np.int64]
    refused: FloatArray
    batch: FloatArray
    outcome: FloatArray


class GateState:
    """
    Memory of the kernels below, without readings at first.

    :param mean_square: initial s^2 (2, 3), SI. :param floor: c^2 (2, 3), SI.
    """

    def __init__(self, mean_square: FloatArray, floor: FloatArray, confirmations: int) -> None:
        # Written by `struct`, which is faster than filling a numpy array from Python numbers.
        self._batch = bytearray(MAX_BATCH * _ROW_BYTES)
        arrays = GateArrays(
            mean_square=mean_square.copy(),
            floor=floor.copy(),
            reported=np.zeros((2, 3)),
            level=np.zeros((2, 3)),
            slope=np.zeros((2, 3)),
            growth=np.zeros((2, 3)),
            offset=np.zeros(2),
            n_accepted=np.full(2, _PRIOR_READINGS),
            last_s=np.zeros(2),
            n_refused=np.zeros(2, dtype=np.int64),
            refused=np.zeros((2, confirmations, 3)),
            batch=np.frombuffer(self._batch).reshape(MAX_BATCH, _COLUMNS),
            outcome=np.zeros((MAX_BATCH, 4)),
        )
        self.outcome = arrays.outcome
        self._table = ArrayTable(*arrays)
        self.rows = self._table.rows

    def pack(self, i: int, reading: Reading, after_s: float, now_s: float) -> None:
        """
        Write a reading to row i of the batch.

        `after_s`: its time since the tick of the expectation, `now_s` since the begin.
        """
        _PACK_ROW(
            self._batch,
            i * _ROW_BYTES,
            reading.source,
            after_s,
            now_s,
            *reading.values,
            *(reading.variances or _NO_VARIANCES),
        )


@strict_kernel
def _gate_arrays(rows: IntArray) -> GateArrays:
    """Return the structure that `GateState` passes to the kernels as a table."""
    return GateArrays(
        floats_2(rows, 0),
        floats_2(rows, 1),
        floats_2(rows, 2),
        floats_2(rows, 3),
        floats_2(rows, 4),
        floats_2(rows, 5),
        floats_1(rows, 6),
        integers_1(rows, 7),
        floats_1(rows, 8),
        integers_1(rows, 9),
        floats_3(rows, 10),
        floats_2(rows, 11),
        floats_2(rows, 12),
    )


@strict_kernel
def set_expectation(
    state: FloatArray, predicted: FloatArray, growth: FloatArray, rows: IntArray
) -> None:
    """Take over `state` (3,) at a tick, the one `predicted` for the next, and g (3,)."""
    gate = _gate_arrays(rows)
    for c in range(3):
        gate.level[_ODOMETRY, c] = state[c]
        gate.slope[_ODOMETRY, c] = predicted[c] - state[c]
        gate.growth[_ODOMETRY, c] = growth[c]
    # Specific force without gravity: the change of velocity in turning axes.
    gate.level[_IMU, 0] = gate.slope[_ODOMETRY, 0] / _TICK_S - state[2] * state[1] + gate.offset[0]
    gate.level[_IMU, 1] = gate.slope[_ODOMETRY, 1] / _TICK_S + state[2] * state[0] + gate.offset[1]
    gate.level[_IMU, 2] = state[2]
    gate.slope[_IMU, 2] = gate.slope[_ODOMETRY, 2]
    gate.growth[_IMU, 2] = growth[2]


@strict_kernel
def judge_readings(count: int, chi2: float, rows: IntArray) -> int:
    """
    Judge the first `count` readings of the batch in order; return how many are not ACCEPTED.

    `rows`: those of `GateState`.
    """
    gate = _gate_arrays(rows)
    others = 0
    for i in range(count):
        decision = _judge_reading(gate.batch[i], chi2, gate, gate.outcome[i])
        gate.outcome[i, 0] = decision
        others += decision != ACCEPTED
    return others


@strict_kernel
def _judge_reading(reading: FloatArray, chi2: float, gate: GateArrays, outcome: FloatArray) -> int:
    """Return the decision on a `reading` (9,) of the batch, and account for it."""
    stream, after_s, now_s = int(reading[0]), reading[1], reading[2]
    values, variances = reading[3:6], reading[6:9]
    fraction = min(max(after_s / _TICK_S, _MIN_FRACTION), _MAX_FRACTION)
    innovation, unexplained = np.empty(3), np.empty(3)
    exceeds = np.zeros(3, dtype=np.bool_)
    # Beyond that range, the expectation lies between the line's end and its continuation.
    beyond = after_s / _TICK_S - fraction
    worst, channel, bound = 1.0, -1, 0.0
    for c in range(3):
        e = values[c] - gate.level[stream, c] - fraction * gate.slope[stream, c]
        innovation[c] = e
        change = abs(beyond * gate.slope[stream, c])
        e -= min(max(e, -change), change)
        unexplained[c] = e
        allowed = gate.mean_square[stream, c] + gate.floor[stream, c] + gate.growth[stream, c]
        if variances[c] > gate.reported[stream, c]:
            allowed += variances[c] - gate.reported[stream, c]
        exceeds[c] = e * e > chi2 * allowed
        if e * e > worst * chi2 * allowed:
            worst, channel, bound = e * e / (chi2 * allowed), c, np.sqrt(chi2 * allowed)
    if channel < 0:
        gate.n_refused[stream] = 0
        gate.n_accepted[stream] += 1
        elapsed_s = max(now_s - gate.last_s[stream], 0.0)
        if elapsed_s > _MEMORY_S:
            # After a pause, one reading does not replace all that was learned before.
            elapsed_s = 0.0
        gate.last_s[stream] = now_s
        gain = max(elapsed_s / _MEMORY_S, 1.0 / gate.n_accepted[stream])
        for c in range(3):
            if np.isfinite(unexplained[c]):
                change = unexplained[c] * unexplained[c] - gate.mean_square[stream, c]
                gate.mean_square[stream, c] += gain * change
            if np.isfinite(variances[c]):
                gate.reported[stream, c] += gain * (variances[c] - gate.reported[stream, c])
        if stream == _IMU:
            # An accepted offset follows its cause, which may fade.
            for c in range(2):
                if gate.offset[c] != 0.0 and np.isfinite(unexplained[c]):
                    gate.offset[c] += gain * unexplained[c]
        return ACCEPTED
    refused = gate.refused[stream]
    refused[gate.n_refused[stream]] = innovation
    gate.n_refused[stream] += 1
    if gate.n_refused[stream] < refused.shape[0]:
        outcome[1], outcome[2], outcome[3] = channel, innovation[channel], bound
        return REJECTED
    gate.n_refused[stream] = 0
    for i in range(1, refused.shape[0]):
        for c in range(3):
            change = refused[i, c] - refused[i - 1, c]
            noise = gate.mean_square[stream, c] + gate.floor[stream, c]
            if change * change > 2.0 * chi2 * noise:
                _take_over_noise(refused, gate.mean_square[stream])
                return MORE_NOISE
    # The expectation is of the old level until the predictor has taken the new one.
    for c in range(3):
        if np.isfinite(innovation[c]):
            gate.level[stream, c] += innovation[c]
    if stream == _IMU:
        # The predictor has no state for an offset of the specific force.
        for c in range(2):
            if exceeds[c]:
                gate.offset[c] += refused[:, c].sum() / refused.shape[0]
    return NEW_LEVEL


@strict_kernel
def _take_over_noise(refused: FloatArray, mean_square: FloatArray) -> None:
    """Set `mean_square` (3,) to the mean square of the innovations `refused` (n, 3)."""
    for c in range(3):
        total, count = 0.0, 0
        for i in range(refused.shape[0]):
            if np.isfinite(refused[i, c]):
                total += refused[i, c] * refused[i, c]
                count += 1
        if count:
            mean_square[c] = total / count
