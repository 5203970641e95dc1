# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lifting of many candidates side by side: `encoder_kernels`, one candidate in each lane."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe import ndarray as numba_ndarray  # type: ignore[import-untyped, unused-ignore]

from adk_ros.model.lifting.encoder_kernels import EncoderArrays
from adk_ros.model.lifting.rational_tanh import rational_tanh
from adk_ros.model.lifting.single_track import CAR_SIZE, LIMITS_SIZE, single_track_features
from adk_ros.numerics.arrays import Float32Array, FloatArray
from adk_ros.numerics.float32_sums import add_lane_product
from adk_ros.numerics.numba_cache import ordered_kernel

to_fixed_tuple: Any = numba_ndarray.to_fixed_tuple
"""Typed here: its decorator hides what it returns."""


class BlockArrays(NamedTuple):
    """
    Scratch memory of a block of l candidates.

    `u` (2, l) and `x` (3, l): scaled, float64. float32: encoder input `row` (n, l) and `clamped`
    (n, l), its columns with quadratic features `chosen` (c, l), layers `first` (h, l) and `second`
    (h + q, l), their products with the output layer `lifted` (2, 3, l).
    """

    u: FloatArray
    x: FloatArray
    row: Float32Array
    clamped: Float32Array
    chosen: Float32Array
    first: Float32Array
    second: Float32Array
    lifted: Float32Array


@ordered_kernel
def activate(layer: Float32Array, n_hidden: int) -> None:
    """Apply tanh to the first `n_hidden` rows of `layer` (h, l)."""
    values = layer.reshape(-1)
    for i in range(n_hidden * layer.shape[1]):
        values[i] = rational_tanh(values[i])


@ordered_kernel
def fill_rows(layer: Float32Array, bias: Float32Array) -> None:
    """Write `bias` (m,) to each lane of `layer` (>= m, l)."""
    for j in range(bias.shape[0]):
        for lane in range(layer.shape[1]):
            layer[j, lane] = bias[j]


@ordered_kernel
def activations(block: BlockArrays, encoder: EncoderArrays) -> None:
    """Run `penultimate_activations` in each lane."""
    n_hidden, lanes = encoder.b2.shape[0], block.u.shape[1]
    for i in range(encoder.input_bound.shape[0]):
        bound = encoder.input_bound[i]
        for lane in range(lanes):
            block.clamped[i, lane] = min(max(block.row[i, lane], -bound), bound)
    fill_rows(block.first, encoder.b1)
    add_lane_product(block.first, encoder.w1, block.clamped)
    activate(block.first, n_hidden)
    fill_rows(block.second, encoder.b2)
    add_lane_product(block.second, encoder.w2, block.first)
    activate(block.second, n_hidden)
    squares = block.second[n_hidden : n_hidden + encoder.directions.shape[1]]
    for i in range(encoder.columns.shape[0]):
        column = encoder.columns[i]
        for lane in range(lanes):
            block.chosen[i, lane] = block.clamped[column, lane]
    values = squares.reshape(-1)
    for i in range(values.shape[0]):
        values[i] = np.float32(0.0)
    add_lane_product(squares, encoder.directions, block.chosen)
    for i in range(values.shape[0]):
        values[i] = values[i] * values[i]
    if encoder.car.shape[0] > 0:
        add_single_track_lanes(block, encoder)


@ordered_kernel
def add_single_track_lanes(block: BlockArrays, encoder: EncoderArrays) -> None:
    """Run `add_single_track` in each lane."""
    learned, lanes = encoder.b2.shape[0] + encoder.directions.shape[1], block.u.shape[1]
    row, second = block.row, block.second
    rest = second[learned:]
    commands = np.zeros((2, lanes), dtype=np.float32)
    for i in range(3, row.shape[0]):
        of_torque, of_delta = encoder.command_filter[i, 0], encoder.command_filter[i, 1]
        if of_torque != np.float32(0.0) or of_delta != np.float32(0.0):
            for lane in range(lanes):
                commands[0, lane] += of_torque * row[i, lane]
                commands[1, lane] += of_delta * row[i, lane]
    # Tuples: writing to `rest` might change an array, so that the compiler would not vectorise the
    # loop, and all candidates together would take 1.5 times as long.
    car = to_fixed_tuple(encoder.car, CAR_SIZE)
    limits = to_fixed_tuple(encoder.limits.reshape(-1), LIMITS_SIZE)
    for lane in range(lanes):
        f = single_track_features(
            row[0, lane],
            row[1, lane],
            row[2, lane],
            commands[0, lane],
            commands[1, lane],
            car,
            limits,
        )
        rest[0, lane], rest[1, lane], rest[2, lane] = f[0], f[1], f[2]
        rest[3, lane], rest[4, lane], rest[5, lane] = f[3], f[4], f[5]
        rest[6, lane] = f[6]
    for i in range(learned):
        for lane in range(lanes):
            second[i, lane] *= rest[6, lane]
    for i in range(row.shape[0]):
        for lane in range(lanes):
            rest[7 + i, lane] = rest[6, lane] * row[i, lane]
