# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled Jacobians of the steps of a rollout, in float64.

The step of `compiled_rollout` with its weights in float64 and its derivative. Where a limit acts
(the bounds of the encoder's input, of tanh, of motion and of states), the derivative is that of
the active branch; at the switch itself it is one-sided. The single-track model is differentiated
by central differences.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.lifting.encoder_kernels import (
    EncoderArrays,
)
from adk_ros.model.lifting.rational_tanh import rational_tanh, rational_tanh_slope
from adk_ros.model.lifting.single_track import SINGLE_TRACK_FEATURES, single_track_derivative
from adk_ros.model.uncertainty.compiled_rollout import MAX_SCALED_STATE, FoldedLayer, StepForm
from adk_ros.model.uncertainty.motion_limits import (
    MIN_LIMITED_SPEED,
    limited_state,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import ordered_kernel


@ordered_kernel
def single_track_jacobian(
    row: FloatArray, encoder: EncoderArrays, values: FloatArray, by_row: FloatArray
) -> None:
    """Write features and weight of the single-track model (7,) and their derivative (7, n)."""
    point = np.zeros(5)
    point[:3] = row[:3]
    for i in range(3, row.shape[0]):
        for c in range(2):
            point[3 + c] += encoder.command_filter[i, c] * row[i]
    slopes = np.empty((SINGLE_TRACK_FEATURES + 1, 5))
    car, limits = encoder.car.astype(np.float64), encoder.limits.reshape(-1).astype(np.float64)
    single_track_derivative(point, car, limits, values, slopes)
    by_row[:] = 0.0
    for k in range(SINGLE_TRACK_FEATURES + 1):
        by_row[k, :3] = slopes[k, :3]
        for i in range(3, row.shape[0]):
            for c in range(2):
                by_row[k, i] += slopes[k, 3 + c] * encoder.command_filter[i, c]


@ordered_kernel
def lift_jacobian(
    row: FloatArray, encoder: EncoderArrays, folded: FoldedLayer, jacobian: FloatArray
) -> tuple[float, float, float]:
    """
    Return w_hidden s + w_skip row, see `compiled_rollout`; write its derivative by `row` (n,).

    `jacobian` (3, n); `folded` is float64.
    """
    n, n_hidden, n_squares = row.shape[0], encoder.b2.shape[0], encoder.directions.shape[1]
    clamped, inside = np.empty(n), np.empty(n)
    for i in range(n):
        bound = encoder.input_bound[i]
        clamped[i] = min(max(row[i], -bound), bound)
        inside[i] = 1.0 if clamped[i] == row[i] else 0.0
    sums = np.empty(n_hidden)
    first, first_slope, second, second_slope = (
        np.empty(n_hidden), np.empty(n_hidden), np.empty(n_hidden), np.empty(n_hidden)
    )  # fmt: skip
    for j in range(n_hidden):
        sums[j] = encoder.b1[j]
    for i in range(n):
        for j in range(n_hidden):
            sums[j] += encoder.w1[i, j] * clamped[i]
    for j in range(n_hidden):
        first[j], first_slope[j] = rational_tanh(sums[j]), rational_tanh_slope(sums[j])
        sums[j] = encoder.b2[j]
    for i in range(n_hidden):
        for j in range(n_hidden):
            sums[j] += encoder.w2[i, j] * first[i]
    for j in range(n_hidden):
        second[j], second_slope[j] = rational_tanh(sums[j]), rational_tanh_slope(sums[j])
    squared = np.zeros(n_squares)
    for i in range(encoder.columns.shape[0]):
        for j in range(n_squares):
            squared[j] += encoder.directions[i, j] * clamped[encoder.columns[i]]
    values, back, inner = np.zeros(3), np.empty(n_hidden), np.empty(n)
    known, weight = np.zeros(SINGLE_TRACK_FEATURES + 1), 1.0
    by_row = np.zeros((SINGLE_TRACK_FEATURES + 1, n))
    if encoder.car.shape[0] > 0:
        single_track_jacobian(row, encoder, known, by_row)
        weight = known[SINGLE_TRACK_FEATURES]
    for c in range(3):
        weights = folded.w_hidden[c]
        for j in range(n_hidden):
            values[c] += weights[j] * second[j]
        for j in range(n_squares):
            values[c] += weights[n_hidden + j] * squared[j] * squared[j]
        learned = values[c]
        values[c] *= weight
        for i in range(n):
            values[c] += folded.w_skip[c, i] * row[i]
        for i in range(n_hidden):
            back[i] = 0.0
            for j in range(n_hidden):
                back[i] += encoder.w2[i, j] * second_slope[j] * weights[j]
            back[i] *= first_slope[i]
        for i in range(n):
            inner[i] = 0.0
            for j in range(n_hidden):
                inner[i] += encoder.w1[i, j] * back[j]
        for i in range(encoder.columns.shape[0]):
            for j in range(n_squares):
                inner[encoder.columns[i]] += (
                    2.0 * encoder.directions[i, j] * squared[j] * weights[n_hidden + j]
                )
        for i in range(n):
            jacobian[c, i] = folded.w_skip[c, i] + weight * inside[i] * inner[i]
        if encoder.car.shape[0] > 0:
            # The rows of w3 after layer and squares: features, weight, weighted row.
            rest = weights[n_hidden + n_squares :]
            learned += rest[SINGLE_TRACK_FEATURES]
            for i in range(n):
                of_row = rest[SINGLE_TRACK_FEATURES + 1 + i]
                learned += of_row * row[i]
                jacobian[c, i] += weight * of_row
            for i in range(n):
                values[c] += rest[SINGLE_TRACK_FEATURES + 1 + i] * weight * row[i]
                jacobian[c, i] += learned * by_row[SINGLE_TRACK_FEATURES, i]
            values[c] += rest[SINGLE_TRACK_FEATURES] * weight
            for k in range(SINGLE_TRACK_FEATURES):
                values[c] += rest[k] * known[k]
                for i in range(n):
                    jacobian[c, i] += rest[k] * by_row[k, i]
    return values[0], values[1], values[2]


@ordered_kernel
def limit_jacobian(
    before: tuple[float, float, float],
    free: tuple[float, float, float],
    bounds: FloatArray,
    jacobian: FloatArray,
) -> tuple[float, float, float]:
    """
    Run `limited_state` on `free` and the clamp of states; apply their derivative to `jacobian`.

    `jacobian` (3, m): derivative of `free`, whose first three columns are those by `before`.
    """
    after = limited_state(before, free, bounds)
    n = jacobian.shape[1]
    for c in range(3):
        if abs(free[c] - before[c]) > bounds[0, c]:
            for i in range(n):
                jacobian[c, i] = 1.0 if i == c else 0.0
    change = bounds[0, 2]
    rate_free = min(max(free[2], before[2] - change), before[2] + change)
    if after[2] != rate_free:
        # The yaw rate is +-largest, largest = max(limit, |v0| |r0|) / |v|, with |v| >= v_min.
        speed_now = after[0] * bounds[2, 0] + bounds[1, 0]
        speed_before = before[0] * bounds[2, 0] + bounds[1, 0]
        rate_before = before[2] * bounds[2, 2] + bounds[1, 2]
        speed = max(abs(speed_now), MIN_LIMITED_SPEED)
        reached = max(abs(speed_before), MIN_LIMITED_SPEED) * abs(rate_before)
        sign = 1.0 if rate_free * bounds[2, 2] + bounds[1, 2] > 0.0 else -1.0
        by_speed = 0.0
        if abs(speed_now) > MIN_LIMITED_SPEED:
            by_speed = -max(bounds[3, 0], reached) / speed / speed * np.sign(speed_now)
        for i in range(n):
            jacobian[2, i] = sign * by_speed * bounds[2, 0] * jacobian[0, i] / bounds[2, 2]
        if reached > bounds[3, 0]:
            if abs(speed_before) > MIN_LIMITED_SPEED:
                slope = abs(rate_before) * np.sign(speed_before) * bounds[2, 0]
                jacobian[2, 0] += sign * slope / speed / bounds[2, 2]
            slope = max(abs(speed_before), MIN_LIMITED_SPEED) * np.sign(rate_before)
            jacobian[2, 2] += sign * slope / speed
    clamped = np.empty(3)
    for c in range(3):
        clamped[c] = min(max(after[c], -MAX_SCALED_STATE), MAX_SCALED_STATE)
        if clamped[c] != after[c]:
            for i in range(n):
                jacobian[c, i] = 0.0
    return clamped[0], clamped[1], clamped[2]


@ordered_kernel
def rollout_jacobians(
    u_ahead: FloatArray,
    disturbance: FloatArray,
    form: StepForm,
    encoder: EncoderArrays,
    folded: FoldedLayer,
    states: FloatArray,
    jacobians: FloatArray,
) -> None:
    """
    Roll out in float64 and write the derivative of each new state by what it is computed from.

    `u_ahead` (h, 2): scaled. `states` (h + 1, m): the delay-embedded state
    [x_k .. x_(k-p), u_(k-1) .. u_(k-p)], scaled, whose first row is given. `jacobians`
    (h, 3, m + 2): by [x_k .. x_(k-p), u_k, u_(k-1) .. u_(k-p)]. `folded`: float64.
    """
    n, n_x, m = encoder.w1.shape[0], form.n_x, states.shape[1]
    row, lifted = np.empty(n), np.empty((3, n))
    slow_fast = disturbance[:2].copy()
    for step in range(u_ahead.shape[0]):
        now, jacobian = states[step], jacobians[step]
        u = u_ahead[step]
        row[:n_x] = now[:n_x]
        if n > n_x:
            row[n_x : n_x + 2] = u
            row[n_x + 2 :] = now[n_x:]
        values = lift_jacobian(row, encoder, folded, lifted)
        free = np.empty(3)
        jacobian[:] = 0.0
        for c in range(3):
            w = folded.w_input_bias[c]
            total = w[2] + values[c] + w[0] * u[0] + w[1] * u[1]
            total += slow_fast[0, c] + slow_fast[1, c]
            slow_fast[0, c] *= form.gains[2, c]
            slow_fast[1, c] *= form.gains[4, c]
            free[c] = total * form.step_scale[c] + (now[c] if form.residual else 0.0)
            for i in range(n):
                jacobian[c, i] = lifted[c, i] * form.step_scale[c]
            for i in range(2):
                jacobian[c, n_x + i] += w[i] * form.step_scale[c]
            if form.residual:
                jacobian[c, c] += 1.0
        new = limit_jacobian(
            (now[0], now[1], now[2]), (free[0], free[1], free[2]), form.bounds, jacobian
        )
        after = states[step + 1]
        for i in range(n_x - 1, 2, -1):
            after[i] = now[i - 3]
        for i in range(m - 1, n_x + 1, -1):
            after[i] = now[i - 2]
        if m > n_x:
            after[n_x : n_x + 2] = u
        for c in range(3):
            after[c] = new[c]
