# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled open-loop rollouts: whole horizons, and single steps of rollouts that advance by tick.

If every step is lifted anew, the state's increment is linear in the activations s of the
encoder's last hidden layer and quadratic features, and in the encoder's input row. With

    features = w3' s + skip' row + b3

it follows that

    theta [x; features; u; 1] = w_hidden s + w_skip row + w_input u + bias

so theta and the encoder's output layer are multiplied once per rollout (`fold_output_layer`), and
the features are never computed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adk_ros.model.lifting.encoder_kernels import (
    EncoderArrays,
    pack_encoder_input,
    penultimate_activations,
    set_command,
)
from adk_ros.model.uncertainty.error_regression import predicted_error
from adk_ros.model.uncertainty.motion_limits import limit_step
from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.float32_sums import dot
from adk_ros.numerics.numba_cache import inlined_kernel, ordered_kernel, strict_kernel

MAX_SCALED_STATE = 50.0
"""Scaled states are clamped to +-50 standard deviations: far outside any data, and finite."""


class FoldedLayer(NamedTuple):
    """
    Output layer of the encoder multiplied by theta.

    `w_hidden` (3, h + q) and `w_skip` (3, n), float32; `w_input_bias` (3, 3): two columns for u,
    one for the bias.
    """

    w_hidden: Float32Array
    w_skip: Float32Array
    w_input_bias: FloatArray


class RolloutState(NamedTuple):
    """Encoder input `row` (n,), scaled state `x` (3,), slow and fast `disturbance` (2, 3)."""

    row: Float32Array
    x: FloatArray
    disturbance: FloatArray


class StepForm(NamedTuple):
    """
    How a step uses what the model predicts.

    `n_x`: columns of the row that are states; `residual`: the model predicts increments, in units
    of `step_scale` (3,); `gains` (5, 3): `ObserverGains.table`; `bounds` (4, 3) of `step_bounds`.
    """

    n_x: int
    residual: bool
    step_scale: FloatArray
    gains: FloatArray
    bounds: FloatArray


@ordered_kernel
def fold_output_layer(
    theta: FloatArray, affine: bool, encoder: EncoderArrays, folded: FoldedLayer
) -> None:
    """Compute `folded` from the state's three rows of `theta` (n_z, n_phi)."""
    w3, b3, skip = encoder.w3, encoder.b3, encoder.skip
    n_features = w3.shape[1]
    n_z = 3 + n_features
    for c in range(3):
        for i in range(w3.shape[0]):
            value = 0.0
            for j in range(n_features):
                value += theta[c, 3 + j] * w3[i, j]
            folded.w_hidden[c, i] = value
        for i in range(skip.shape[0]):
            # The row begins with the state.
            value = theta[c, i] if i < 3 else 0.0
            for j in range(n_features):
                value += theta[c, 3 + j] * skip[i, j]
            folded.w_skip[c, i] = value
        bias = theta[c, n_z + 2] if affine else 0.0
        for j in range(n_features):
            bias += theta[c, 3 + j] * b3[j]
        folded.w_input_bias[c, 0] = theta[c, n_z]
        folded.w_input_bias[c, 1] = theta[c, n_z + 1]
        folded.w_input_bias[c, 2] = bias


@inlined_kernel
def rollout_step(
    state: RolloutState,
    u0: Any,
    u1: Any,
    form: StepForm,
    encoder: EncoderArrays,
    folded: FoldedLayer,
    first: Float32Array,
    second: Float32Array,
) -> None:
    """
    Advance `state` by one step under the scaled command `u0`, `u1`.

    `first` (>= h + q + n,) and `second` (>= h + q,) are scratch memory.
    """
    row, x, disturbance = state.row, state.x, state.disturbance
    w_hidden, w_skip, w_input_bias = folded.w_hidden, folded.w_skip, folded.w_input_bias
    n, n_x = w_skip.shape[1], form.n_x
    set_command(row, n_x, u0, u1)
    penultimate_activations(row, encoder, first, second)
    s0 = dot(w_hidden[0], second) + dot(w_skip[0], row)
    s1 = dot(w_hidden[1], second) + dot(w_skip[1], row)
    s2 = dot(w_hidden[2], second) + dot(w_skip[2], row)
    before = x[0], x[1], x[2]
    for c in range(3):
        lifted = s0 if c == 0 else s1 if c == 1 else s2
        value = w_input_bias[c, 2] + lifted + w_input_bias[c, 0] * u0 + w_input_bias[c, 1] * u1
        value += disturbance[0, c] + disturbance[1, c]
        disturbance[0, c] *= form.gains[2, c]
        disturbance[1, c] *= form.gains[4, c]
        x[c] = value * form.step_scale[c] + (x[c] if form.residual else 0.0)
    limit_step(before, x, form.bounds)
    for c in range(3):
        x[c] = min(max(x[c], -MAX_SCALED_STATE), MAX_SCALED_STATE)
    for i in range(n_x - 1, 2, -1):
        row[i] = row[i - 3]
    for i in range(n - 1, n_x + 1, -1):
        row[i] = row[i - 2]
    for c in range(3):
        row[c] = x[c]


@ordered_kernel
def rollout_lifting(
    x_past: FloatArray,
    u_past: FloatArray,
    theta: FloatArray,
    u_ahead: FloatArray,
    disturbance: FloatArray,
    residual: bool,
    affine: bool,
    out: FloatArray,
    step_scale: FloatArray,
    gains: FloatArray,
    bounds: FloatArray,
    *encoder_arrays: Any,
) -> None:
    """Run `roll_out` with an encoder given by the fields of `EncoderArrays`."""
    encoder = EncoderArrays(*encoder_arrays)
    roll_out(
        x_past,
        u_past,
        theta,
        u_ahead,
        disturbance,
        residual,
        affine,
        out,
        step_scale,
        gains,
        bounds,
        encoder,
    )


@ordered_kernel
def roll_out(
    x_past: FloatArray,
    u_past: FloatArray,
    theta: FloatArray,
    u_ahead: FloatArray,
    disturbance: FloatArray,
    residual: bool,
    affine: bool,
    out: FloatArray,
    step_scale: FloatArray,
    gains: FloatArray,
    bounds: FloatArray,
    encoder: EncoderArrays,
) -> None:
    """
    Predict len(out) steps, lifting anew at each: out (h, 3), scaled.

    `x_past` (p + 1, 3), `u_past` (p, 2): newest first, scaled. `u_ahead` (up to h, 2): scaled,
    its last row repeated. `theta` (n_z, n_phi): the state's three rows are used. `disturbance`
    (>= 2, 3) is added to the increments and decays by `gains` (5, 3). No step exceeds `bounds`
    (4, 3) of `step_bounds`. The inputs are not changed.
    """
    n, n_hidden = encoder.w1.shape[0], encoder.w3.shape[0]
    n_x, last = 3 * x_past.shape[0], u_ahead.shape[0] - 1
    row = np.empty(n, dtype=np.float32)
    pack_encoder_input(x_past, u_past, row)
    first = np.empty(n_hidden + n, dtype=np.float32)
    second = np.empty(n_hidden, dtype=np.float32)
    folded = FoldedLayer(
        np.empty((3, n_hidden), dtype=np.float32),
        np.empty((3, n), dtype=np.float32),
        np.empty((3, 3)),
    )
    fold_output_layer(theta, affine, encoder, folded)
    state = RolloutState(row, x_past[0].copy(), disturbance.copy())
    form = StepForm(n_x, residual, step_scale, gains, bounds)
    for step in range(out.shape[0]):
        u0, u1 = u_ahead[min(step, last), 0], u_ahead[min(step, last), 1]
        rollout_step(state, u0, u1, form, encoder, folded, first, second)
        out[step] = state.x


@strict_kernel
def rollout_linear(z: FloatArray, theta: FloatArray, u_ahead: FloatArray, out: FloatArray) -> None:
    """
    Predict len(out) steps in the lifted space, z+ = A z + B u (eq. 5): out (h, 3), scaled.

    `z` (n_z,): lifted state; `theta` (n_z, n_z + 2) = [A B]; `u_ahead` as in `rollout_lifting`.
    """
    n_z = z.shape[0]
    last = u_ahead.shape[0] - 1
    now = z.copy()
    new = np.empty(n_z)
    for step in range(out.shape[0]):
        u = u_ahead[min(step, last)]
        for c in range(n_z):
            value = theta[c, n_z] * u[0] + theta[c, n_z + 1] * u[1]
            for j in range(n_z):
                value += theta[c, j] * now[j]
            new[c] = min(max(value, -MAX_SCALED_STATE), MAX_SCALED_STATE)
        now[:] = new
        out[step, :] = now[:3]


@inlined_kernel
def corrected_state(value: float, error: float, shrinkage: float, base: float) -> float:
    """Return the scaled state `value` with its predicted `error`, shrunk towards `base`."""
    corrected: float = min(max(value + error, -MAX_SCALED_STATE), MAX_SCALED_STATE)
    return base + shrinkage * (corrected - base)


@strict_kernel
def to_si(
    states: FloatArray,
    base: FloatArray,
    disturbance: FloatArray,
    weights: FloatArray,
    shrinkage: FloatArray,
    x_mean: FloatArray,
    x_scale: FloatArray,
) -> bool:
    """
    Correct scaled states (h, 3), convert them to SI in place, and return whether all are finite.

    The error predicted with `weights` (k, 3, K + 1) from `disturbance` (1, 3, 3), see
    `error_regression`, is added to the change since `base` (3,), scaled, and the sum is
    multiplied by `shrinkage` (k, 3). Both are by horizon step, the last row repeated; k = 0
    leaves the change as it is.
    """
    finite = True
    last = shrinkage.shape[0] - 1
    for i in range(states.shape[0]):
        for c in range(3):
            value = states[i, c]
            if last >= 0:
                h = min(i, last)
                error = predicted_error(h, c, 0, weights, disturbance)
                # Checked before clamping, which would turn NaN into a number.
                finite = finite and np.isfinite(value + error)
                value = corrected_state(value, error, shrinkage[h, c], base[c])
            states[i, c] = value * x_scale[c] + x_mean[c]
            finite = finite and np.isfinite(states[i, c])
    return finite
