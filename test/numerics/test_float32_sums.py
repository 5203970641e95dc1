# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Float32 sums keep their order: by a plain loop, for one vector and for many lanes."""

import numpy as np
import pytest

from adk_ros.numerics import float32_sums
from adk_ros.numerics.arrays import Float32Array
from adk_ros.numerics.float32_sums import LANES
from adk_ros.numerics.numba_cache import ordered_kernel

N_LANES = 2 * LANES


@ordered_kernel
def products(
    out: Float32Array, matrix: Float32Array, vector: Float32Array, weights: Float32Array
) -> float:
    float32_sums.add_product(out, matrix, vector)
    value: float = float32_sums.dot(weights, vector)
    return value


@ordered_kernel
def lane_products(
    out: Float32Array, matrix: Float32Array, lanes: Float32Array, weights: Float32Array,
    sums: Float32Array,
) -> None:  # fmt: skip
    float32_sums.add_lane_product(out, matrix, lanes)
    float32_sums.lane_dot(weights, lanes, sums)


def expected_product(
    out: Float32Array, matrix: Float32Array, vector: Float32Array
) -> Float32Array:
    for row, factor in zip(matrix, vector, strict=True):
        out = out + row * factor
    return out


def expected_dot(a: Float32Array, b: Float32Array) -> np.float32:
    whole = len(a) // 8 * 8
    p = np.zeros(8, np.float32)
    for i in range(0, whole, 8):
        p = p + a[i : i + 8] * b[i : i + 8]
    total = ((p[0] + p[4]) + (p[2] + p[6])) + ((p[1] + p[5]) + (p[3] + p[7]))
    for x, y in zip(a[whole:], b[whole:], strict=True):
        total = total + x * y
    result: np.float32 = np.float32(float(total))
    return result


@pytest.mark.parametrize(
    ("n", "m"), [(30, 24), (24, 48), (7, 13), (72, 3), (1, 1), (0, 5), (9, 0)]
)
def test_sums_have_the_documented_order(n: int, m: int) -> None:
    random = np.random.default_rng(0)

    def normal(*shape: int) -> Float32Array:
        return random.normal(size=shape).astype(np.float32)

    matrix, weights, lanes, start = normal(n, m), normal(n), normal(n, N_LANES), normal(m)
    lane_out, sums = np.tile(start[:, None], (1, N_LANES)), normal(N_LANES)
    lane_products(lane_out, matrix, lanes, weights, sums)
    for lane in range(N_LANES):
        vector, out = np.ascontiguousarray(lanes[:, lane]), start.copy()
        value = products(out, matrix, vector, weights)
        np.testing.assert_array_equal(out, expected_product(start, matrix, vector))
        assert value == expected_dot(weights, vector)
        np.testing.assert_array_equal(lane_out[:, lane], out)
        assert sums[lane] == value


def test_only_what_the_sums_need_is_read() -> None:
    """Scratch memory is longer than the vectors in it."""
    out, vector = np.zeros(20, np.float32), np.full(20, np.nan, np.float32)
    vector[:3] = 1.0
    assert products(out, np.ones((3, 17), np.float32), vector, np.ones(3, np.float32)) == 3.0
    assert out.tolist() == 17 * [3.0] + 3 * [0.0]
