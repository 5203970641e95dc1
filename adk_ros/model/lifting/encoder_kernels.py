# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled lifting: the encoder's input row, the perceptron, and the regressor.

Arrays are updated in place. The perceptron is float32, everything else float64. Its
arithmetic is in a defined order, see `numerics.float32_sums`.

Numba unboxes a named tuple in about 0.3 us per array and a plain array in about 0.1 us. Kernels
that Python calls every tick therefore take the fields of a structure as `*arrays` and rebuild it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.float32_sums import add_product
from adk_ros.numerics.numba_cache import inlined_kernel, ordered_kernel, strict_kernel

_single = np.float32
_TANH_CLIP = _single(-6.3)
"""Arguments of tanh are clipped at +-6.3, where the approximant reaches 1 within float32."""
_P0, _P1, _P2, _P3 = (_single(v) for v in (34459425, 4729725, 135135, 990))
_Q1, _Q2, _Q3, _Q4 = (_single(v) for v in (16216200, 945945, 13860, 45))


class EncoderArrays(NamedTuple):
    """
    Weights of the encoder: two hidden tanh layers, quadratic features, and a linear skip path.

    `w1` (n, h), `w2` (h, h), `w3` (h + q, m), `skip` (n, m); biases `b1`, `b2` (h,), `b3` (m,).
    `columns` (c,): columns of the row that enter the quadratic features; `directions` (c, q).
    `input_bound` (n,): the row is clamped to +-input_bound before the layers and the quadratic
    features, not before the skip path. float32, except int64 `columns`.
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

    def scratch(self) -> Float32Array:
        """Return an array for `perceptron` to work in."""
        (n_in, hidden), squares = self.w1.shape, self.directions.shape[-1]
        return np.empty((2, hidden + squares + n_in), dtype=np.float32)


@inlined_kernel
def rational_tanh(x: Any) -> Any:
    """Return the Pade approximant of tanh, order 9/8, of a float32: error below 7e-6."""
    x = min(max(x, _TANH_CLIP), -_TANH_CLIP)
    s = x * x
    numerator = x * (_P0 + s * (_P1 + s * (_P2 + s * (_P3 + s))))
    return numerator / (_P0 + s * (_Q1 + s * (_Q2 + s * (_Q3 + s * _Q4))))


@ordered_kernel
def rational_tanh_slope(x: float) -> float:
    """Return the derivative of `rational_tanh`; zero where it is clipped."""
    if not abs(x) < -_TANH_CLIP:
        return 0.0
    s = x * x
    above = _P0 + s * (_P1 + s * (_P2 + s * (_P3 + s)))
    below = _P0 + s * (_Q1 + s * (_Q2 + s * (_Q3 + s * _Q4)))
    above_slope = _P1 + s * (2.0 * _P2 + s * (3.0 * _P3 + 4.0 * s))
    below_slope = _Q1 + s * (2.0 * _Q2 + s * (3.0 * _Q3 + 4.0 * s * _Q4))
    return float((above + 2.0 * s * (above_slope - above / below * below_slope)) / below)


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
    Write the second hidden layer and the q squares to `out` (>= h + q,).

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
