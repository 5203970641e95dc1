# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
From commands to what acts: dead times, lags, play and limits of steering and drive.

Dead times by the mean of the held command over a step, lags by their exact solution over a step,
so that all are smooth in their parameters and may be zero.
"""

from __future__ import annotations

import math

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.state_index import (
    S_LOAD_Y,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_TORQUE,
    S_TORQUE_MORE,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import relaxed_kernel

_RADIUS = INDEX["wheel_radius"]
_STEER_GAIN = INDEX["steer_gain"]
_STEER_OFFSET = INDEX["steer_offset"]
_STEER_DELAY = INDEX["steer_delay"]
_STEER_LAG = INDEX["steer_lag"]
_STEER_MORE = INDEX["steer_lag_more"]
_GAP = INDEX["steer_half_gap"]
_COMPLIANCE = INDEX["steer_compliance"]
_GAIN = INDEX["torque_gain"]
_BRAKE = INDEX["brake_gain"]
_OFFSET = INDEX["torque_offset"]
_T_DELAY = INDEX["torque_delay"]
_T_LAG = INDEX["torque_lag"]
_T_MORE = INDEX["torque_lag_more"]
_POWER = INDEX["power_inverse"]
_DELAY = INDEX["command_delay"]


@relaxed_kernel
def first_order_lag(state: float, to: float, time: float, step: float) -> tuple[float, float]:
    """Return a first-order lag's (mean over, value after) a step towards a constant input."""
    if time < 1e-6 * step:
        return to, to
    x = step / time
    keep = math.exp(-x)
    return to + (state - to) * (1.0 - keep) / x, to + (state - to) * keep


@relaxed_kernel
def second_order_lag(
    state: float, rate: float, to: float, frequency: float, damping: float, step: float
) -> tuple[float, float]:
    """Return a second-order lag's (value, rate) after a step towards a constant input."""
    # Implicit: stable at any frequency.
    x = frequency * step
    rate = (rate + x * frequency * (to - state)) / (1.0 + 2.0 * damping * x + x * x)
    return state + step * rate, rate


@relaxed_kernel
def zoh_mean(total: FloatArray, spacing: float, begin: float, step: float) -> float:
    """Return the mean of a held signal from `begin` on for `step`; `total` is its integral."""
    last = total.shape[0] - 1
    at = min(max(begin / spacing, 0.0), last - 1e-6)
    i = int(at)
    first = total[i] + (at - i) * (total[i + 1] - total[i])
    at = min(max((begin + step) / spacing, 0.0), last - 1e-6)
    i = int(at)
    second = total[i] + (at - i) * (total[i + 1] - total[i])
    most = last * spacing
    span = min(max(begin + step, 0.0), most) - min(max(begin, 0.0), most)
    mean: float = (second - first) / max(span, 1e-9)
    if span < 0.5 * step:
        # Before the first command, or after the last: that one holds.
        mean = (total[1] - total[0]) / spacing
        if begin > step:
            mean = (total[last] - total[last - 1]) / spacing
    return mean


@relaxed_kernel
def actuate(
    p: FloatArray,
    state: FloatArray,
    torques: FloatArray,
    angles: FloatArray,
    spacing: float,
    time: float,
    step: float,
    v_x: float,
) -> tuple[float, float]:
    """
    Return the (torque, road-wheel angle) that act over the step from `time` on; advances lags.

    `torques`, `angles` are the commands' integrals over time, every `spacing` seconds.
    """
    begin = time - p[_DELAY]
    wish = zoh_mean(angles, spacing, begin - p[_STEER_DELAY], step)
    wish = p[_STEER_GAIN] * wish
    gap = p[_GAP]
    play = min(max(state[S_PLAY], wish - gap), wish + gap)
    state[S_PLAY] = play
    mean, state[S_STEER] = first_order_lag(state[S_STEER], play, p[_STEER_LAG], step)
    delta, state[S_STEER_MORE] = first_order_lag(state[S_STEER_MORE], mean, p[_STEER_MORE], step)
    delta += p[_STEER_OFFSET] - p[_COMPLIANCE] * state[S_LOAD_Y]
    asked = zoh_mean(torques, spacing, begin - p[_T_DELAY], step)
    asked *= p[_GAIN] * (p[_BRAKE] if asked < 0.0 else 1.0)
    mean, state[S_TORQUE] = first_order_lag(state[S_TORQUE], asked, p[_T_LAG], step)
    torque, state[S_TORQUE_MORE] = first_order_lag(state[S_TORQUE_MORE], mean, p[_T_MORE], step)
    torque += p[_OFFSET]
    if p[_POWER] > 0.0:
        torque = min(torque, p[_RADIUS] / (p[_POWER] * max(v_x, 1.0)))
    return torque, delta
