# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled inner loops of the lift: the encoder's input row and its perceptron.

Arrays are updated in place; nothing is allocated but small temporaries. The perceptron is float32,
everything else float64.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.numba_cache import fused_kernel, inlined_kernel, strict_kernel

_single = np.float32
_TANH_CLIP = _single(-6.3)
_P0, _P1, _P2, _P3 = (_single(v) for v in (34459425, 4729725, 135135, 990))
_Q1, _Q2, _Q3, _Q4 = (_single(v) for v in (16216200, 945945, 13860, 45))


@inlined_kernel
def add_product(out, matrix, vector):  # type: ignore[no-untyped-def]
    """out (m,) += matrix' vector, matrix (n, m): four rows at a time, to save loads."""
    n, m = matrix.shape
    i = 0
    while i + 4 <= n:
        v0, v1, v2, v3 = vector[i], vector[i + 1], vector[i + 2], vector[i + 3]
        for j in range(m):
            out[j] += (
                matrix[i, j] * v0
                + matrix[i + 1, j] * v1
                + matrix[i + 2, j] * v2
                + matrix[i + 3, j] * v3
            )
        i += 4
    while i < n:
        for j in range(m):
            out[j] += matrix[i, j] * vector[i]
        i += 1


@inlined_kernel
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


@inlined_kernel
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


@fused_kernel
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


@strict_kernel
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


@inlined_kernel
def set_command(row, n_x, u0, u1):  # type: ignore[no-untyped-def]
    """Set the command in force, scaled, in a row whose first `n_x` columns are states."""
    if row.shape[0] > n_x:
        row[n_x], row[n_x + 1] = u0, u1


@strict_kernel
def shift_in(past, value):  # type: ignore[no-untyped-def]
    """Put `value` in front of `past` (rows, newest first) and drop the oldest."""
    for i in range(past.shape[0] - 1, 0, -1):
        past[i, :] = past[i - 1, :]
    if past.shape[0] > 0:
        past[0, :] = value


@strict_kernel
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
