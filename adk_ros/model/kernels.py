# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The compiled inner loops of a tick: sample in, perceptron, and the pair that is learned from.

Arrays are updated in place, nothing is allocated in a tick but small temporaries. Everything is
float64 but the perceptron. Equation numbers are the paper's.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.compiled import fast, inlined, jit
from adk_ros.model.hindsight import MEAN_GAIN

_single = np.float32
_TANH_CLIP = _single(-6.3)
_AUTOCORRELATION_GAIN, _AUTOCORRELATION_LOW, _AUTOCORRELATION_HIGH = 0.03, 0.3, 0.7
_P0, _P1, _P2, _P3 = (_single(v) for v in (34459425, 4729725, 135135, 990))
_Q1, _Q2, _Q3, _Q4 = (_single(v) for v in (16216200, 945945, 13860, 45))


@inlined
def add_product(out, matrix, vector):  # type: ignore[no-untyped-def]
    """out (m,) += matrix' vector, matrix (n, m): four rows at a time, to save loads."""
    n, m = matrix.shape
    i = 0
    while i + 4 <= n:
        v0, v1, v2, v3 = vector[i], vector[i + 1], vector[i + 2], vector[i + 3]
        for j in range(m):
            out[j] += (
                matrix[i, j] * v0 + matrix[i + 1, j] * v1
                + matrix[i + 2, j] * v2 + matrix[i + 3, j] * v3
            )
        i += 4
    while i < n:
        for j in range(m):
            out[j] += matrix[i, j] * vector[i]
        i += 1


@inlined
def hidden_layer(row, weights, bias, out):  # type: ignore[no-untyped-def]
    """out (>= m,) begins with tanh(weights' row + bias), weights (n, m); row (>= n,)."""
    for j in range(bias.shape[0]):
        out[j] = bias[j]
    add_product(out, weights, row)
    for j in range(bias.shape[0]):
        # Pade's approximant of order 9/8: to 7e-6, and loops over it are vectorised.
        x = min(max(out[j], _TANH_CLIP), -_TANH_CLIP)
        s = x * x
        above = x * (_P0 + s * (_P1 + s * (_P2 + s * (_P3 + s))))
        out[j] = above / (_P0 + s * (_Q1 + s * (_Q2 + s * (_Q3 + s * _Q4))))


@inlined
def penultimate_activations(  # type: ignore[no-untyped-def]
    row, w1, b1, w2, b2, columns, reach, directions, first, out
):
    """
    out (>= h + q,): the second hidden layer and q squares; `first` (>= h + n,) is scratch.

    Of the row held within +-`reach` (n,). The squares are of directions' c, c its `columns`.
    """
    held = first[b2.shape[0] :]
    for i in range(reach.shape[0]):
        held[i] = min(max(row[i], -reach[i]), reach[i])
    hidden_layer(held, w1, b1, first)
    hidden_layer(first, w2, b2, out)
    squares = out[b2.shape[0] :]
    for i in range(columns.shape[0]):
        first[i] = held[columns[i]]
    for j in range(directions.shape[1]):
        squares[j] = np.float32(0.0)
    add_product(squares, directions, first)
    for j in range(directions.shape[1]):
        squares[j] = squares[j] * squares[j]


@fast
def perceptron(  # type: ignore[no-untyped-def]
    row, w1, b1, w2, b2, w3, b3, skip, columns, reach, directions, scratch, out
):
    """
    out (m,) = w3' [s(w2' s(w1' row + b1) + b2); squares] + b3 + skip' row with s = tanh.

    `scratch` (2, >= h + q + n).
    """
    penultimate_activations(
        row, w1, b1, w2, b2, columns, reach, directions, scratch[0], scratch[1]
    )
    out[:] = b3
    add_product(out, w3, scratch[1])
    add_product(out, skip, row)


@jit
def pack_encoder_input(x_past, u_past, row):  # type: ignore[no-untyped-def]
    """
    Encoder input from scaled pasts, newest first: x_past (p + 1, 3), u_past (p, 2).

    The command in force has a place between the two, if p is not 0; see `set_command`.
    """
    position = 0
    for i in range(x_past.shape[0]):
        for j in range(3):
            row[position] = x_past[i, j]
            position += 1
    position += 2
    for i in range(u_past.shape[0]):
        for j in range(2):
            row[position] = u_past[i, j]
            position += 1


@inlined
def set_command(row, n_x, u0, u1):  # type: ignore[no-untyped-def]
    """Set the command in force, scaled, in a row whose first `n_x` columns are states."""
    if row.shape[0] > n_x:
        row[n_x], row[n_x + 1] = u0, u1


@jit
def shift_in(past, value):  # type: ignore[no-untyped-def]
    """Put `value` in front of `past` (rows, newest first) and drop the oldest."""
    for i in range(past.shape[0] - 1, 0, -1):
        past[i, :] = past[i - 1, :]
    if past.shape[0] > 0:
        past[0, :] = value


@jit
def observer_update(  # type: ignore[no-untyped-def]
    state, predicted, correction, command, x_mean, x_scale, u_mean, u_scale,
    measured, x_past, u_past, u_now, row, whiteness
):
    """
    Scale a state (3,) and command (2,), shift both pasts, fill the encoder's input row.

    `measured` (3,) is the state scaled, and x_past's first row what the observer makes of it and
    of what was `predicted` (3,) for it, SI, NaN if nothing was. `correction` (5, 3) as
    `Correction.table` gives it. `whiteness` (3, 3): the last innovation, and running means of its
    product with the one before and of its square, by which the observer's gain goes up; see
    `correction`.
    """
    shift_in(u_past, u_now)
    for i in range(x_past.shape[0] - 1, 0, -1):
        x_past[i, :] = x_past[i - 1, :]
    for c in range(3):
        measured[c] = (state[c] - x_mean[c]) / x_scale[c]
        x_past[0, c] = measured[c]
        if correction[0, c] < 1.0 and np.isfinite(predicted[c]):
            expected = (predicted[c] - x_mean[c]) / x_scale[c]
            innovation = measured[c] - expected
            gain = correction[0, c]
            if gain > 0.0:
                last = whiteness[0, c]
                whiteness[0, c] = innovation
                whiteness[1, c] += _AUTOCORRELATION_GAIN * (innovation * last - whiteness[1, c])
                whiteness[2, c] += _AUTOCORRELATION_GAIN * (innovation * innovation - whiteness[2, c])
                alike = whiteness[1, c] / (whiteness[2, c] + 1e-30)
                gain += (1.0 - gain) * min(max((alike - _AUTOCORRELATION_LOW) / (_AUTOCORRELATION_HIGH - _AUTOCORRELATION_LOW), 0.0), 1.0)
            x_past[0, c] = expected + gain * innovation
    for c in range(2):
        u_now[c] = (command[c] - u_mean[c]) / u_scale[c]
    pack_encoder_input(x_past, u_past, row)
    set_command(row, 3 * x_past.shape[0], u_now[0], u_now[1])


@jit
def regression_pair(  # type: ignore[no-untyped-def]
    measured, features, phi, theta, step_scale, residual, correction, disturbance, y, limit
):
    """
    Target y (n_z,) of the tick that has just ended, the disturbances moved towards what is left.

    `measured` (3,) scaled and `features` make up z; `phi` is of the tick before and begins with
    its z, the observer's state in it; `disturbance` (3, 3) slow, fast and the running mean of what
    is left. Return False, with the disturbance as it was, if the pair is absurd and must not be
    learned: a regressor of 1e6 would leave 1e-4 of rounding in the Gram for good.
    """
    for j in range(phi.shape[0]):
        if not abs(phi[j]) < limit:
            return False
    for i in range(y.shape[0]):
        value = measured[i] if i < 3 else np.float64(features[i - 3])
        if residual:
            value -= phi[i]
            if i < 3:
                value /= step_scale[i]
        y[i] = value
        if not abs(value) < limit:
            return False
    for c in range(3):
        left = y[c]
        for j in range(phi.shape[0]):
            left -= theta[c, j] * phi[j]
        disturbance[2, c] += MEAN_GAIN * (left - disturbance[2, c])
        disturbance[0, c] += correction[1, c] * (left - disturbance[0, c])
        left -= disturbance[0, c]
        disturbance[1, c] += correction[3, c] * (left - disturbance[1, c])
    return True


@jit
def pack_regressor(x, features, u_now, affine, phi):  # type: ignore[no-untyped-def]
    """phi = [z; u] or [z; u; 1] with z = [x; features], `x` (>= 1, 3) with its first row."""
    n_z = 3 + features.shape[0]
    for i in range(3):
        phi[i] = x[0, i]
    for i in range(3, n_z):
        phi[i] = features[i - 3]
    phi[n_z] = u_now[0]
    phi[n_z + 1] = u_now[1]
    if affine:
        phi[n_z + 2] = 1.0


@jit
def ewma_covariance(covariance, innovation, gain):  # type: ignore[no-untyped-def]
    """covariance += gain (innovation innovation' - covariance), all (3, ...)."""
    for i in range(3):
        for j in range(3):
            covariance[i, j] += gain * (innovation[i] * innovation[j] - covariance[i, j])
