# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Many arrays as one argument of a kernel.

Numba unboxes an array argument in about 0.1 us, and in 1 us after a pause of some milliseconds,
when the array's header has left the cache. A kernel with forty arrays spends more on that than on
its work. Here a table lists their addresses and shapes, and the kernel rebuilds them from it.
"""

from __future__ import annotations

from typing import Any, NoReturn

import numba  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numba.extending import intrinsic  # type: ignore[import-untyped, unused-ignore]
from numpy.typing import NDArray

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel

_MAX_DIMENSIONS = 4


class ArrayTable:
    """
    Addresses and shapes of `arrays`, which it keeps alive; they are changed in place only.

    `rows` (n, 5): address and sizes, in the order of `arrays`. A kernel gets `rows` and rebuilds
    array i as `floats_2(rows, i)`, the function for its type and number of dimensions.
    :raises ValueError: an array is not contiguous, or has more than four dimensions.
    """

    def __init__(self, *arrays: NDArray[Any]) -> None:
        self._arrays = arrays
        self.rows = np.zeros((len(arrays), 1 + _MAX_DIMENSIONS), dtype=np.int64)
        for row, array in zip(self.rows, arrays, strict=True):
            if not array.flags.c_contiguous or array.ndim > _MAX_DIMENSIONS:
                raise ValueError("only contiguous arrays of up to four dimensions have a row")
            row[0] = array.ctypes.data
            row[1 : 1 + array.ndim] = array.shape

    def __reduce__(self) -> NoReturn:
        raise TypeError("a table of addresses cannot be copied or stored")


def _to_pointer(_context: Any, address: Any) -> Any:
    """Return an address as a pointer."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

    return numba.types.voidptr(address), generate


_pointer: Any = intrinsic(_to_pointer)
_numba: Any = numba
_carray = _numba.carray


@strict_kernel
def floats_1(rows: IntArray, i: int) -> FloatArray:
    """Return array i, (n,) float64."""
    out: FloatArray = _carray(_pointer(rows[i, 0]), (rows[i, 1],), np.float64)
    return out


@strict_kernel
def floats_2(rows: IntArray, i: int) -> FloatArray:
    """Return array i, (n, m) float64."""
    out: FloatArray = _carray(_pointer(rows[i, 0]), (rows[i, 1], rows[i, 2]), np.float64)
    return out


@strict_kernel
def floats_3(rows: IntArray, i: int) -> FloatArray:
    """Return array i, (n, m, k) float64."""
    shape = (rows[i, 1], rows[i, 2], rows[i, 3])
    out: FloatArray = _carray(_pointer(rows[i, 0]), shape, np.float64)
    return out


@strict_kernel
def floats_4(rows: IntArray, i: int) -> FloatArray:
    """Return array i, (n, m, k, l) float64."""
    shape = (rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4])
    out: FloatArray = _carray(_pointer(rows[i, 0]), shape, np.float64)
    return out


@strict_kernel
def singles_1(rows: IntArray, i: int) -> NDArray[np.float32]:
    """Return array i, (n,) float32."""
    out: NDArray[np.float32] = _carray(_pointer(rows[i, 0]), (rows[i, 1],), np.float32)
    return out


@strict_kernel
def singles_2(rows: IntArray, i: int) -> NDArray[np.float32]:
    """Return array i, (n, m) float32."""
    shape = (rows[i, 1], rows[i, 2])
    out: NDArray[np.float32] = _carray(_pointer(rows[i, 0]), shape, np.float32)
    return out


@strict_kernel
def singles_3(rows: IntArray, i: int) -> NDArray[np.float32]:
    """Return array i, (n, m, k) float32."""
    shape = (rows[i, 1], rows[i, 2], rows[i, 3])
    out: NDArray[np.float32] = _carray(_pointer(rows[i, 0]), shape, np.float32)
    return out


@strict_kernel
def integers_1(rows: IntArray, i: int) -> NDArray[np.int64]:
    """Return array i, (n,) int64."""
    out: NDArray[np.int64] = _carray(_pointer(rows[i, 0]), (rows[i, 1],), np.int64)
    return out
