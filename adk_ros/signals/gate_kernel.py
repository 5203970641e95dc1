# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled test of readings against the predicted state; `signals.gate` has the equations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.signals.channels import TICK_NS

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


class GateArrays(NamedTuple):
    """
    Statistics and expectation of the two streams: 0 IMU (a_x, a_y, yaw_rate), 1 odometry.

    `mean_square`, `floor`, `reported`, `level`, `slope`, `growth` (2, 3): s^2, c^2, mean reported
    variance, expected value at the tick, its change over a tick, and g; SI. `n_accepted` (2,):
    readings; `last_s` (2,): time of the last one; `n_refused` (2,) and `refused` (2,
    confirmations, 3): innovations of the readings rejected since. `detail` (3,): channel,
    innovation and bound of the latest rejected reading.
    """

    mean_square: FloatArray
    floor: FloatArray
    reported: FloatArray
    level: FloatArray
    slope: FloatArray
    growth: FloatArray
    n_accepted: NDArray[np.int64]
    last_s: FloatArray
    n_refused: NDArray[np.int64]
    refused: FloatArray
    detail: FloatArray


def gate_arrays(mean_square: FloatArray, floor: FloatArray, confirmations: int) -> GateArrays:
    """Return statistics without readings; `mean_square` and `floor` (2, 3)."""
    return GateArrays(
        mean_square=mean_square.copy(),
        floor=floor,
        reported=np.zeros((2, 3)),
        level=np.zeros((2, 3)),
        slope=np.zeros((2, 3)),
        growth=np.zeros((2, 3)),
        n_accepted=np.full(2, _PRIOR_READINGS),
        last_s=np.zeros(2),
        n_refused=np.zeros(2, dtype=np.int64),
        refused=np.zeros((2, confirmations, 3)),
        detail=np.zeros(3),
    )


@strict_kernel
def set_expectation(
    state: FloatArray, predicted: FloatArray, growth: FloatArray, *arrays: Any
) -> None:
    """Take over `state` (3,) at a tick, the one `predicted` for the next, and g (3,)."""
    gate = GateArrays(*arrays)
    for c in range(3):
        gate.level[_ODOMETRY, c] = state[c]
        gate.slope[_ODOMETRY, c] = predicted[c] - state[c]
        gate.growth[_ODOMETRY, c] = growth[c]
    # Specific force without gravity: the change of velocity in turning axes.
    gate.level[_IMU, 0] = gate.slope[_ODOMETRY, 0] / _TICK_S - state[2] * state[1]
    gate.level[_IMU, 1] = gate.slope[_ODOMETRY, 1] / _TICK_S + state[2] * state[0]
    gate.level[_IMU, 2] = state[2]
    gate.slope[_IMU, 2] = gate.slope[_ODOMETRY, 2]
    gate.growth[_IMU, 2] = growth[2]


@strict_kernel
def judge_reading(
    stream: int,
    after_s: float,
    now_s: float,
    values: tuple[float, ...],
    variances: tuple[float, ...],
    chi2: float,
    *arrays: Any,
) -> int:
    """
    Return the decision on a reading, and account for it.

    `after_s`: time of the reading since the tick of the expectation, `now_s` since the begin;
    `variances`: as reported, NaN if not.
    """
    gate = GateArrays(*arrays)
    fraction = min(max(after_s / _TICK_S, _MIN_FRACTION), _MAX_FRACTION)
    innovation = np.empty(3)
    worst, channel, bound = 1.0, -1, 0.0
    for c in range(3):
        e = values[c] - gate.level[stream, c] - fraction * gate.slope[stream, c]
        innovation[c] = e
        allowed = gate.mean_square[stream, c] + gate.floor[stream, c] + gate.growth[stream, c]
        if variances[c] > gate.reported[stream, c]:
            allowed += variances[c] - gate.reported[stream, c]
        if e * e > worst * chi2 * allowed:
            worst, channel, bound = e * e / (chi2 * allowed), c, np.sqrt(chi2 * allowed)
    if channel < 0:
        gate.n_refused[stream] = 0
        gate.n_accepted[stream] += 1
        elapsed_s = min(max(now_s - gate.last_s[stream], 0.0), _MEMORY_S)
        gate.last_s[stream] = now_s
        gain = max(elapsed_s / _MEMORY_S, 1.0 / gate.n_accepted[stream])
        for c in range(3):
            if np.isfinite(innovation[c]):
                change = innovation[c] * innovation[c] - gate.mean_square[stream, c]
                gate.mean_square[stream, c] += gain * change
            if np.isfinite(variances[c]):
                gate.reported[stream, c] += gain * (variances[c] - gate.reported[stream, c])
        return ACCEPTED
    refused = gate.refused[stream]
    refused[gate.n_refused[stream]] = innovation
    gate.n_refused[stream] += 1
    if gate.n_refused[stream] < refused.shape[0]:
        gate.detail[0], gate.detail[1], gate.detail[2] = channel, innovation[channel], bound
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
