# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One run of the stand-in's equations along a recording.

Body axes, REP-103, origin at the centre of gravity. v_x is followed (taken from a smoothed
measurement) or simulated; v_y and yaw rate are simulated, each drawn towards its measurement by a
gain, since a slippery car's model would spin otherwise:

    dv_x/dt = a_x + r v_y - g sin(grade)           dr/dt = M_z / I_z
    dv_y/dt = a_y - r v_x - g sin(bank)

A body on springs leans by a second-order lag behind a_x and a_y, and behind the road where that
leans; an accelerometer on it feels gravity by as much. Integrated by the midpoint rule, its middle
reached by the last step's derivative; the slip's build-up by its exact solution over a step.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.command_response import actuate, first_order_lag, second_order_lag
from adk_ros.mismatch.surrogate.state_index import (
    S_BANK,
    S_BANK_RATE,
    S_HEADING,
    S_LOAD_X,
    S_LOAD_Y,
    S_PITCH,
    S_PITCH_RATE,
    S_ROLL,
    S_ROLL_RATE,
    S_SLIP,
    S_SLOPE,
    S_SLOPE_RATE,
    S_V_X,
    S_V_Y,
    S_X,
    S_Y,
    S_YAW_RATE,
)
from adk_ros.mismatch.surrogate.tyre_forces import body_forces
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import relaxed_kernel

_MIN_BODY_GRADIENT = 1e-3
"""rad s^2/m; a body that leans less than this is rigid."""

_RELAX = INDEX["relaxation_length"]
_LOAD_LAG = INDEX["load_lag"]
_ROLL_GRADIENT = INDEX["roll_gradient"]
_ROLL_FREQUENCY = INDEX["roll_frequency"]
_ROLL_DAMPING = INDEX["roll_damping"]
_PITCH_GRADIENT = INDEX["pitch_gradient"]
_PITCH_FREQUENCY = INDEX["pitch_frequency"]
_PITCH_DAMPING = INDEX["pitch_damping"]
_SUSPENSION_LOAD_SHARE = INDEX["load_springs"]
_GRADE = INDEX["grade"]
_BANK = INDEX["bank"]
_ODOMETRY_GAIN = INDEX["odometry_gain"]
_ODOMETRY_LAG = INDEX["odometry_lag"]


@relaxed_kernel
def _set_parameters(
    base: FloatArray,
    index: IntArray,
    amount: FloatArray,
    gate: IntArray,
    gates: FloatArray,
    k: int,
    p: FloatArray,
) -> None:
    p[:] = base
    for j in range(index.shape[0]):
        p[index[j]] += amount[j] * gates[gate[j], k]


@relaxed_kernel
def integrate(
    base: FloatArray,
    index: IntArray,
    amount: FloatArray,
    gate: IntArray,
    gates: FloatArray,
    torques: FloatArray,
    angles: FloatArray,
    spacing: float,
    start: float,
    step: float,
    followed: FloatArray,
    measured: FloatArray,
    gains: FloatArray,
    extra: FloatArray,
    state: FloatArray,
    out: FloatArray,
    states: FloatArray,
) -> None:
    """
    Run the stand-in over `n` steps from `start` (s after the commands' integrals begin).

    The parameters are `base` plus `amount[j]` times row `gate[j]` of `gates` (g, n) at entry
    `index[j]`. `followed` (n + 1,) is v_x at the ends of the steps; empty: v_x is simulated.
    `measured` (n, 3) is (v_x, v_y, yaw rate) at the middle of each step, NaN where there is none,
    and `gains` (3,) the share of the difference that is made up at once. `extra` (n, 3) is added
    to the accelerations (a_x, a_y, yaw), and may be empty. `state` (STATE_SIZE,) is advanced in
    place; `out` (OUTPUTS, n) receives the middles of the steps, `states` (n + 1, 6) unless empty
    the v_x, v_y, yaw rate, x, y and heading at their ends.
    """
    n = out.shape[1]
    p = base.copy()
    slip_to = np.zeros(4)
    last_v_x, last_v_y, last_yaw_rate = 0.0, 0.0, 0.0
    follows = followed.shape[0] > 0
    more = extra.shape[0] > 0
    keeps = states.shape[0] > 0
    for k in range(n):
        changed = k == 0
        for j in range(index.shape[0]):
            if k > 0 and gates[gate[j], k] != gates[gate[j], k - 1]:
                changed = True
        if changed:
            _set_parameters(base, index, amount, gate, gates, k, p)
        v_x, v_y, yaw_rate = state[S_V_X], state[S_V_Y], state[S_YAW_RATE]
        v_x0 = followed[k] / p[_ODOMETRY_GAIN] if follows else v_x
        if keeps and k == 0:
            states[0, 0], states[0, 1], states[0, 2] = v_x0, v_y, yaw_rate
            states[0, 3], states[0, 4] = state[S_X], state[S_Y]
            states[0, 5] = state[S_HEADING]
        torque, delta = actuate(p, state, torques, angles, spacing, start + k * step, step, v_x0)
        roll_rate = p[_ROLL_GRADIENT] * state[S_ROLL_RATE]
        # Where the slope changes a car on springs is pressed down, or lifted.
        heave = v_x0 * state[S_SLOPE_RATE] if p[_PITCH_GRADIENT] > _MIN_BODY_GRADIENT else 0.0
        load_x = state[S_LOAD_X]
        load_y = state[S_LOAD_Y]
        springs = p[_SUSPENSION_LOAD_SHARE]
        if springs != 0.0:
            by_x = 2.0 * p[_PITCH_DAMPING] / p[_PITCH_FREQUENCY] * state[S_PITCH_RATE]
            by_y = 2.0 * p[_ROLL_DAMPING] / p[_ROLL_FREQUENCY] * state[S_ROLL_RATE]
            load_x += springs * (state[S_PITCH] + by_x - load_x)
            load_y += springs * (state[S_ROLL] + by_y - load_y)
        x = v_x0 * step / max(p[_RELAX], 1e-4)
        half = math.exp(-0.5 * x)
        slips = state[S_SLIP : S_SLIP + 4]
        sin_grade, sin_bank = math.sin(p[_GRADE]), math.sin(p[_BANK])
        # The middle of the step, by the last step's derivative.
        v_y1 = v_y + 0.5 * step * last_v_y
        yaw_rate1 = yaw_rate + 0.5 * step * last_yaw_rate
        v_x1 = v_x0 + 0.5 * step * last_v_x
        if follows:
            v_x1 = 0.5 * (followed[k] + followed[k + 1]) / p[_ODOMETRY_GAIN]
        a_x, a_y, w = body_forces(
            p,
            v_x1,
            v_y1,
            yaw_rate1,
            delta,
            torque,
            load_x,
            load_y,
            roll_rate,
            heave,
            slips,
            half,
            slip_to,
        )
        if more:
            a_x += extra[k, 0]
            a_y += extra[k, 1]
            w += extra[k, 2]
        last_v_x = a_x + yaw_rate1 * v_y1 - GRAVITY * sin_grade
        last_v_y = a_y - yaw_rate1 * v_x1 - GRAVITY * sin_bank
        last_yaw_rate = w
        new_v_x = v_x + step * last_v_x
        new_v_y = v_y + step * last_v_y
        new_yaw_rate = yaw_rate + step * w
        # A sensor on the body feels gravity by what the body leans against the road.
        lean_x = p[_PITCH_GRADIENT] * state[S_PITCH]
        lean_y = p[_ROLL_GRADIENT] * state[S_ROLL]
        if p[_PITCH_GRADIENT] > _MIN_BODY_GRADIENT:
            lean_x += state[S_SLOPE] - p[_GRADE]
        if p[_ROLL_GRADIENT] > _MIN_BODY_GRADIENT:
            lean_y += state[S_BANK] - p[_BANK]
        out[0, k] = a_x + GRAVITY * lean_x
        out[1, k] = a_y + GRAVITY * lean_y
        out[5, k] = w
        out[2, k] = 0.5 * (yaw_rate + new_yaw_rate)
        out[3, k] = 0.5 * (v_y + new_v_y)
        out[4, k] = 0.5 * (v_x + new_v_x)
        mid_heading = state[S_HEADING] + 0.5 * step * out[2, k]
        cos, sin = math.cos(mid_heading), math.sin(mid_heading)
        mean_x = out[4, k]
        state[S_X] += step * (mean_x * cos - out[3, k] * sin)
        state[S_Y] += step * (mean_x * sin + out[3, k] * cos)
        state[S_HEADING] += step * out[2, k]
        if not math.isnan(measured[k, 0]):
            new_v_x += gains[0] * (measured[k, 0] / p[_ODOMETRY_GAIN] - out[4, k])
        if not math.isnan(measured[k, 1]):
            new_v_y += gains[1] * (measured[k, 1] - out[3, k])
        if not math.isnan(measured[k, 2]):
            # A filtered rate is brought forward by what it lags behind.
            rate = measured[k, 2]
            if p[_ODOMETRY_LAG] > 0.0 and 0 < k < n - 1:
                rate += p[_ODOMETRY_LAG] * (measured[k + 1, 2] - measured[k - 1, 2]) / (2.0 * step)
            new_yaw_rate += gains[2] * (rate - out[2, k])
        state[S_V_X] = new_v_x
        state[S_V_Y] = min(max(new_v_y, -30.0), 30.0)
        state[S_YAW_RATE] = min(max(new_yaw_rate, -5.0), 5.0)
        _, state[S_LOAD_X] = first_order_lag(state[S_LOAD_X], a_x, p[_LOAD_LAG], step)
        _, state[S_LOAD_Y] = first_order_lag(state[S_LOAD_Y], a_y, p[_LOAD_LAG], step)
        state[S_ROLL], state[S_ROLL_RATE] = second_order_lag(
            state[S_ROLL], state[S_ROLL_RATE], a_y, p[_ROLL_FREQUENCY], p[_ROLL_DAMPING], step
        )
        state[S_PITCH], state[S_PITCH_RATE] = second_order_lag(
            state[S_PITCH],
            state[S_PITCH_RATE],
            a_x,
            p[_PITCH_FREQUENCY],
            p[_PITCH_DAMPING],
            step,
        )
        state[S_BANK], state[S_BANK_RATE] = second_order_lag(
            state[S_BANK],
            state[S_BANK_RATE],
            p[_BANK],
            p[_ROLL_FREQUENCY],
            p[_ROLL_DAMPING],
            step,
        )
        state[S_SLOPE], state[S_SLOPE_RATE] = second_order_lag(
            state[S_SLOPE],
            state[S_SLOPE_RATE],
            p[_GRADE],
            p[_PITCH_FREQUENCY],
            p[_PITCH_DAMPING],
            step,
        )
        keep = math.exp(-x)
        for i in range(4):
            slips[i] = slip_to[i] + (slips[i] - slip_to[i]) * keep
        if keeps:
            states[k + 1, 0], states[k + 1, 1] = state[S_V_X], state[S_V_Y]
            states[k + 1, 2] = state[S_YAW_RATE]
            states[k + 1, 3], states[k + 1, 4] = state[S_X], state[S_Y]
            states[k + 1, 5] = state[S_HEADING]
