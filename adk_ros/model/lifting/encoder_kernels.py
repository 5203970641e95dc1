# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled lifting: the encoder's input row, the perceptron, and the regressor.

Arrays are updated in place. The perceptron and the single-track model are float32, everything else
float64. Their arithmetic is in a defined order, see `numerics.float32_sums`.

Numba unboxes a named tuple in about 0.3 us per array and a plain array in about 0.1 us. Kernels
that Python calls every tick therefore take the fields of a structure as `*arrays` and rebuild it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.model.lifting.rational_tanh import rational_tanh
from adk_ros.model.lifting.single_track import SINGLE_TRACK_FEATURES, single_track_features
from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.float32_sums import add_product
from adk_ros.numerics.numba_cache import inlined_kernel, ordered_kernel, strict_kernel


class EncoderArrays(NamedTuple):
    """
    Weights of the encoder: two hidden tanh layers, quadratic features, and a linear skip path.

    `w1` (n, h), `w2` (h, h), `w3` (h + q, m), `skip` (n, m); biases `b1`, `b2` (h,), `b3` (m,).
    `columns` (c,): columns of the row that enter the quadratic features; `directions` (c, q).
    `input_bound` (n,): the row is clamped to +-input_bound before the layers and the quadratic
    features, not before the skip path. float32, except int64 `columns`.

    With a single-track model (`single_track`), otherwise empty: `car` (24,), its parameters and
    scales; `command_filter` (n, 2), first-order lags of torque and steering; `limits` (3, 6) of
    the training data; float32. Learned features are then multiplied by its weight w, and
    `w3` has rows for [w hidden; w squares; its features (6); w; w row]: "h + q" rows, here and in
    other modules, are h + q + 7 + n.
    """

    w1: Float32Array
    b1: Float32Array
    w2: Float32Array
    b2: Float32Array
    w3: Float32Array
    b3: Float32Array
    skip: Float32Array
    columns: NDArray[np.int64]
    input_bound: Float32Array
    directions: Float32Array
    car: Float32Array
    command_filter: Float32Array
    limits: Float32Array

    def scratch(self) -> Float32Array:
        """Return an array for `perceptron` to work in."""
        return np.empty((2, self.w3.shape[0] + self.w1.shape[0]), dtype=np.float32)


@inlined_kernel
def hidden_layer(
    row: Float32Array, weights: Float32Array, bias: Float32Array, out: Float32Array
) -> None:
    """
    Write tanh(weights' row + bias) to the first m values of `out`.

    `weights` (n, m), `row` (>= n,).
    """
    for j in range(bias.shape[0]):
        out[j] = bias[j]
    add_product(out, weights, row)
    for j in range(bias.shape[0]):
        out[j] = rational_tanh(out[j])


@inlined_kernel
def penultimate_activations(
    row: Float32Array, encoder: EncoderArrays, first: Float32Array, out: Float32Array
) -> None:
    """
    Write all that `w3` has rows for to `out`: second hidden layer, the q squares, and the rest.

    `first` (>= h + n,) is scratch memory.
    """
    n_hidden = encoder.b2.shape[0]
    clamped = first[n_hidden:]
    for i in range(encoder.input_bound.shape[0]):
        clamped[i] = min(max(row[i], -encoder.input_bound[i]), encoder.input_bound[i])
    hidden_layer(clamped, encoder.w1, encoder.b1, first)
    hidden_layer(first, encoder.w2, encoder.b2, out)
    squares = out[n_hidden:]
    for i in range(encoder.columns.shape[0]):
        first[i] = clamped[encoder.columns[i]]
    for j in range(encoder.directions.shape[1]):
        squares[j] = np.float32(0.0)
    add_product(squares, encoder.directions, first)
    for j in range(encoder.directions.shape[1]):
        squares[j] = squares[j] * squares[j]
    if encoder.car.shape[0] > 0:
        add_single_track(row, encoder, out)


@inlined_kernel
def add_single_track(row: Float32Array, encoder: EncoderArrays, out: Float32Array) -> None:
    """Weight the layer and the squares in `out`, and write features, weight and weighted row."""
    learned = encoder.b2.shape[0] + encoder.directions.shape[1]
    torque, delta = np.float32(0.0), np.float32(0.0)
    for i in range(3, row.shape[0]):
        torque += encoder.command_filter[i, 0] * row[i]
        delta += encoder.command_filter[i, 1] * row[i]
    f = single_track_features(
        row[0], row[1], row[2], torque, delta, encoder.car, encoder.limits.reshape(-1)
    )
    weight = f[6]
    for i in range(learned):
        out[i] *= weight
    known = out[learned:]
    for k in range(SINGLE_TRACK_FEATURES):
        known[k] = f[k]
    known[SINGLE_TRACK_FEATURES] = weight
    for i in range(row.shape[0]):
        known[SINGLE_TRACK_FEATURES + 1 + i] = weight * row[i]


@ordered_kernel
def perceptron(
    row: Float32Array, encoder: EncoderArrays, scratch: Float32Array, out: Float32Array
) -> None:
    """
    Write the features to `out` (m,): w3' [s(w2' s(w1' r + b1) + b2); squares] + b3 + skip' row.

    s = tanh; r is the clamped row. `scratch` (2, >= h + q + n).
    """
    penultimate_activations(row, encoder, scratch[0], scratch[1])
    out[:] = encoder.b3
    add_product(out, encoder.w3, scratch[1])
    add_product(out, encoder.skip, row)


@strict_kernel
def pack_encoder_input(x_past: FloatArray, u_past: FloatArray, row: Float32Array) -> None:
    """
    Write scaled past samples to the encoder's input, newest first.

    `x_past` (p + 1, 3), `u_past` (p, 2). If p > 0, two columns between them are left for the
    present command; see `set_command`.
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
def set_command(row: Float32Array, n_x: int, u0: Any, u1: Any) -> None:
    """Write the present command, scaled, to a row whose first `n_x` columns are states."""
    if row.shape[0] > n_x:
        row[n_x], row[n_x + 1] = u0, u1


@strict_kernel
def shift_in(past: FloatArray, value: FloatArray) -> None:
    """Insert `value` as the first row of `past` (newest first) and drop the last row."""
    for i in range(past.shape[0] - 1, 0, -1):
        past[i, :] = past[i - 1, :]
    if past.shape[0] > 0:
        past[0, :] = value


@strict_kernel
def pack_regressor(
    x_past: FloatArray, features: Float32Array, u: FloatArray, affine: bool, phi: FloatArray
) -> None:
    """Write phi = [z; u] or, if `affine`, [z; u; 1], with z = [first row of x_past; features]."""
    n_z = 3 + features.shape[0]
    for i in range(3):
        phi[i] = x_past[0, i]
    for i in range(3, n_z):
        phi[i] = features[i - 3]
    phi[n_z] = u[0]
    phi[n_z + 1] = u[1]
    if affine:
        phi[n_z + 2] = 1.0
