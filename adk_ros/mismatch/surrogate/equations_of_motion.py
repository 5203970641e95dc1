# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Equations of motion of the surrogate model, integrated along a recording.

Body axes (REP-103), origin at the centre of gravity. v_x is prescribed (from a smoothed
measurement) or integrated; v_y and yaw rate r are integrated. An observer corrects each state with
its measurement, because a model on a slippery road would spin otherwise:

    dv_x/dt = a_x + r v_y - g sin(grade)           dr/dt = M_z / I_z
    dv_y/dt = a_y - r v_x - g sin(bank)

A sprung mass rolls and pitches with second-order lags behind a_y and a_x, and behind the bank and
grade of the road; an accelerometer on it measures the corresponding share of gravity.

Midpoint rule, with the middle of a step extrapolated by the derivative of the step before. The
slip relaxation uses its exact solution over a step.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.body_forces import BodyMotion, body_forces
from adk_ros.mismatch.surrogate.command_response import actuate
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms, RunBuffers, RunInputs
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    E_HEADING,
    E_V_X,
    E_V_Y,
    E_X,
    E_Y,
    E_YAW_RATE,
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
    V_X,
    V_Y,
    YAW_ACCELERATION,
    YAW_RATE,
)
from adk_ros.mismatch.surrogate.step_constants import (
    first_order_lag,
    second_order_lag,
    step_constants,
)
from adk_ros.mismatch.surrogate.wheel_forces import (
    SLIP,
    WHEEL_TABLE_SIZE,
    WHEELS,
    relax_slips,
    set_wheels,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.elementary import fast_sin
from adk_ros.numerics.numba_cache import relaxed_kernel
from adk_ros.numerics.similarity import FULL_SIZE_WHEELBASE, REFERENCE_WHEELBASE

MIN_BODY_GRADIENT = 1e-3
"""Least roll or pitch gradient of a sprung mass, rad s^2/m; below it the body counts as rigid."""
_MIN_RELAXATION_LENGTH = 1e-4
"""Least relaxation length, m: avoids a division by zero."""
_MAX_LATERAL_VELOCITY = 30.0
"""Limit of |v_y|, m/s: keeps a spinning surrogate finite."""
_MAX_YAW_RATE = 5.0
"""Limit of |yaw rate|, rad/s, of a full-size car: keeps a spinning surrogate finite."""

_L_F = INDEX["cg_to_front_axle"]
_L_R = INDEX["cg_to_rear_axle"]
_RELAXATION_LENGTH = INDEX["relaxation_length"]
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
def _set_parameters(base: FloatArray, terms: ActiveTerms, k: int, p: FloatArray) -> None:
    """Write into `p` the parameters `base` with the terms that act in step k."""
    p[:] = base
    for j in range(terms.entries.shape[0]):
        p[terms.entries[j]] += terms.amounts[j] * terms.activations[terms.rows[j], k]


@relaxed_kernel
def integrate(
    base: FloatArray, terms: ActiveTerms, inputs: RunInputs, buffers: RunBuffers
) -> None:
    """
    Run the surrogate model over the n steps of `buffers.output`.

    `base` (SIZE,) are the parameters; `terms` act in addition, step by step. `buffers.state` is
    advanced in place; outputs and end states are written.
    """
    step, measured, gains = inputs.step, inputs.measured, inputs.observer_gains
    prescribed_v_x, extra = inputs.prescribed_v_x, inputs.extra
    state, out, end_states = buffers.state, buffers.output, buffers.end_states
    n = out.shape[1]
    p = base.copy()
    wheelbase = base[_L_F] + base[_L_R]
    # As `numerics.similarity.length_scale`.
    size = 1.0 if wheelbase >= FULL_SIZE_WHEELBASE else wheelbase / REFERENCE_WHEELBASE
    fastest_turn = _MAX_YAW_RATE / math.sqrt(size)
    constants = step_constants(base, step)
    wheels = np.zeros(WHEEL_TABLE_SIZE)
    wheels[SLIP : SLIP + WHEELS] = state[S_SLIP : S_SLIP + WHEELS]
    last_v_x, last_v_y, last_yaw_rate = 0.0, 0.0, 0.0
    is_prescribed = prescribed_v_x.shape[0] > 0
    has_extra = extra.shape[0] > 0
    keeps_end_states = end_states.shape[0] > 0
    for k in range(n):
        changed = k == 0
        for j in range(terms.entries.shape[0]):
            row = terms.rows[j]
            if k > 0 and terms.activations[row, k] != terms.activations[row, k - 1]:
                changed = True
        if changed:
            _set_parameters(base, terms, k, p)
            constants = step_constants(p, step)
            set_wheels(wheels, p)
        v_x, v_y, yaw_rate = state[S_V_X], state[S_V_Y], state[S_YAW_RATE]
        v_x0 = prescribed_v_x[k] / p[_ODOMETRY_GAIN] if is_prescribed else v_x
        if keeps_end_states and k == 0:
            end_states[0, E_V_X], end_states[0, E_V_Y] = v_x0, v_y
            end_states[0, E_YAW_RATE] = yaw_rate
            end_states[0, E_X], end_states[0, E_Y] = state[S_X], state[S_Y]
            end_states[0, E_HEADING] = state[S_HEADING]
        time = inputs.start + k * step
        torque, delta = actuate(p, constants, state, inputs.commands, time, step, v_x0)
        if has_extra:
            delta += extra[k, 3]
        roll_rate = p[_ROLL_GRADIENT] * state[S_ROLL_RATE]
        # A change of grade accelerates a sprung mass vertically.
        vertical = v_x0 * state[S_SLOPE_RATE] if p[_PITCH_GRADIENT] > MIN_BODY_GRADIENT else 0.0
        load_x = state[S_LOAD_X]
        load_y = state[S_LOAD_Y]
        share = p[_SUSPENSION_LOAD_SHARE]
        if share != 0.0:
            damper_x = 2.0 * p[_PITCH_DAMPING] / p[_PITCH_FREQUENCY] * state[S_PITCH_RATE]
            damper_y = 2.0 * p[_ROLL_DAMPING] / p[_ROLL_FREQUENCY] * state[S_ROLL_RATE]
            load_x += share * (state[S_PITCH] + damper_x - load_x)
            load_y += share * (state[S_ROLL] + damper_y - load_y)
        x = v_x0 * step / max(p[_RELAXATION_LENGTH], _MIN_RELAXATION_LENGTH)
        half = math.exp(-0.5 * x)
        # Middle of the step, extrapolated by the derivative of the step before.
        v_y1 = v_y + 0.5 * step * last_v_y
        yaw_rate1 = yaw_rate + 0.5 * step * last_yaw_rate
        v_x1 = v_x0 + 0.5 * step * last_v_x
        if is_prescribed:
            v_x1 = 0.5 * (prescribed_v_x[k] + prescribed_v_x[k + 1]) / p[_ODOMETRY_GAIN]
        motion = BodyMotion(
            v_x1, v_y1, yaw_rate1, delta, torque, load_x, load_y, roll_rate, vertical
        )
        a_x, a_y, yaw_acceleration = body_forces(p, constants, motion, wheels, half)
        if has_extra:
            a_x += extra[k, 0]
            a_y += extra[k, 1]
            yaw_acceleration += extra[k, 2]
        last_v_x = a_x + yaw_rate1 * v_y1 - GRAVITY * constants.sin_grade
        last_v_y = a_y - yaw_rate1 * v_x1 - GRAVITY * constants.sin_bank
        last_yaw_rate = yaw_acceleration
        new_v_x = v_x + step * last_v_x
        new_v_y = v_y + step * last_v_y
        new_yaw_rate = yaw_rate + step * yaw_acceleration
        # An accelerometer on the body measures gravity by the body's angle to the road.
        lean_x = p[_PITCH_GRADIENT] * state[S_PITCH]
        lean_y = p[_ROLL_GRADIENT] * state[S_ROLL]
        if p[_PITCH_GRADIENT] > MIN_BODY_GRADIENT:
            lean_x += state[S_SLOPE] - p[_GRADE]
        if p[_ROLL_GRADIENT] > MIN_BODY_GRADIENT:
            lean_y += state[S_BANK] - p[_BANK]
        out[A_X, k] = a_x + GRAVITY * lean_x
        out[A_Y, k] = a_y + GRAVITY * lean_y
        out[YAW_ACCELERATION, k] = yaw_acceleration
        out[YAW_RATE, k] = 0.5 * (yaw_rate + new_yaw_rate)
        out[V_Y, k] = 0.5 * (v_y + new_v_y)
        out[V_X, k] = 0.5 * (v_x + new_v_x)
        mid_heading = state[S_HEADING] + 0.5 * step * out[YAW_RATE, k]
        cos, sin = fast_sin(mid_heading + 0.5 * math.pi), fast_sin(mid_heading)
        mean_x = out[V_X, k]
        state[S_X] += step * (mean_x * cos - out[V_Y, k] * sin)
        state[S_Y] += step * (mean_x * sin + out[V_Y, k] * cos)
        state[S_HEADING] += step * out[YAW_RATE, k]
        if not math.isnan(measured[k, 0]):
            new_v_x += gains[0] * (measured[k, 0] / p[_ODOMETRY_GAIN] - out[V_X, k])
        if not math.isnan(measured[k, 1]):
            new_v_y += gains[1] * (measured[k, 1] - out[V_Y, k])
        if not math.isnan(measured[k, 2]):
            # A filtered yaw rate is advanced by its lag.
            rate = measured[k, 2]
            if p[_ODOMETRY_LAG] > 0.0 and 0 < k < n - 1:
                rate += p[_ODOMETRY_LAG] * (measured[k + 1, 2] - measured[k - 1, 2]) / (2.0 * step)
            new_yaw_rate += gains[2] * (rate - out[YAW_RATE, k])
        state[S_V_X] = new_v_x
        state[S_V_Y] = min(max(new_v_y, -_MAX_LATERAL_VELOCITY), _MAX_LATERAL_VELOCITY)
        state[S_YAW_RATE] = min(max(new_yaw_rate, -fastest_turn), fastest_turn)
        _, state[S_LOAD_X] = first_order_lag(state[S_LOAD_X], a_x, constants.load)
        _, state[S_LOAD_Y] = first_order_lag(state[S_LOAD_Y], a_y, constants.load)
        state[S_ROLL], state[S_ROLL_RATE] = second_order_lag(
            state[S_ROLL], state[S_ROLL_RATE], a_y, constants.roll, step
        )
        state[S_PITCH], state[S_PITCH_RATE] = second_order_lag(
            state[S_PITCH], state[S_PITCH_RATE], a_x, constants.pitch, step
        )
        state[S_BANK], state[S_BANK_RATE] = second_order_lag(
            state[S_BANK], state[S_BANK_RATE], p[_BANK], constants.roll, step
        )
        state[S_SLOPE], state[S_SLOPE_RATE] = second_order_lag(
            state[S_SLOPE], state[S_SLOPE_RATE], p[_GRADE], constants.pitch, step
        )
        relax_slips(wheels, half * half)
        if keeps_end_states:
            end_states[k + 1, E_V_X], end_states[k + 1, E_V_Y] = state[S_V_X], state[S_V_Y]
            end_states[k + 1, E_YAW_RATE] = state[S_YAW_RATE]
            end_states[k + 1, E_X], end_states[k + 1, E_Y] = state[S_X], state[S_Y]
            end_states[k + 1, E_HEADING] = state[S_HEADING]
    state[S_SLIP : S_SLIP + WHEELS] = wheels[SLIP : SLIP + WHEELS]
