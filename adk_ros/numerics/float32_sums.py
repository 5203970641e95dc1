# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Products of float32 matrices and vectors with sums in a defined order.

A compiler that may reorder a sum does so by the vector width of the machine and by what surrounds
the loop, and float32 results differ in the seventh digit. Here the order is part of the function,
so that one vector and many lanes (`lanes` vectors side by side, the last index contiguous) give
bit-identical results, on any machine:

    product    ((out_j + w_0j v_0) + w_1j v_1) + ...
    dot        p_k = ((a_k b_k + a_(k+8) b_(k+8)) + ...), k = 0 .. 7, over whole blocks of eight;
               ((p_0 + p_4) + (p_2 + p_6)) + ((p_1 + p_5) + (p_3 + p_7)); then the last products

Products are rounded before they are added. The functions are inlined, and a kernel that calls them
keeps the order if it is an `ordered_kernel` or a `strict_kernel`. The vector instructions are
written out, since LLVM does not find them in loops as short as these. Arrays are contiguous and
float32; sizes are not checked.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils as untyped_cgutils  # type: ignore[import-untyped, unused-ignore]
from numba.core import types  # type: ignore[import-untyped, unused-ignore]
from numba.extending import intrinsic  # type: ignore[import-untyped, unused-ignore]

from adk_ros.numerics.arrays import Float32Array
from adk_ros.numerics.numba_cache import inlined_kernel

cgutils: Any = untyped_cgutils
ir: Any = cgutils.ir

LANES = 16
"""Lanes are processed in blocks of this many: one vector of AVX-512, two of AVX2."""
_PARTS = 8
_COLUMNS = 4
"""Columns of a matrix whose sums are in registers at a time, for each block of lanes."""
_FLOAT = ir.FloatType()
_INDEX = ir.IntType(64)


def _index(value: int) -> Any:
    return ir.Constant(_INDEX, value)


class _Code:
    """Generates loads, stores and sums of vectors of `width` floats."""

    def __init__(self, builder: Any, width: int) -> None:
        self.builder = builder
        self.width = width
        self.type = ir.VectorType(_FLOAT, width)

    def _pointer(self, base: Any, index: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(base, [index]), self.type.as_pointer())

    def load(self, base: Any, index: Any) -> Any:
        return self.builder.load(self._pointer(base, index), align=4)

    def store(self, base: Any, index: Any, value: Any) -> None:
        self.builder.store(value, self._pointer(base, index), align=4)

    def repeated(self, base: Any, index: Any) -> Any:
        """Return one float in all elements."""
        value = self.builder.load(self.builder.gep(base, [index]))
        empty = ir.Constant(self.type, ir.Undefined)
        vector = self.builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), self.width), [0] * self.width)
        return self.builder.shuffle_vector(vector, empty, zeros)

    def sums(self, values: list[Any]) -> list[Any]:
        """Return variables that start from `values`."""
        variables = [cgutils.alloca_once(self.builder, self.type) for _ in values]
        for variable, value in zip(variables, values, strict=True):
            self.builder.store(value, variable)
        return variables

    def zeros(self, count: int) -> list[Any]:
        return self.sums([ir.Constant(self.type, None)] * count)

    def add(self, variable: Any, a: Any, b: Any) -> None:
        total = self.builder.fadd(self.builder.load(variable), self.builder.fmul(a, b))
        self.builder.store(total, variable)

    def tree(self, parts: list[Any]) -> Any:
        """Return the sum of eight parts, in the order of the module's docstring."""
        add = self.builder.fadd
        half = [add(parts[k], parts[k + 4]) for k in range(4)]
        return add(add(half[0], half[2]), add(half[1], half[3]))


def _steps(builder: Any, start: Any, stop: Any, step: int) -> Any:
    return cgutils.for_range_slice(builder, start, stop, _index(step), _INDEX)


def _whole(builder: Any, start: Any, stop: Any, step: int) -> Any:
    """Return where the last whole step from `start` ends; `step` is a power of two."""
    rest = builder.and_(builder.sub(stop, start), _index(step - 1))
    return builder.sub(stop, rest)


def _arrays(context: Any, builder: Any, signature: Any, values: Any) -> list[Any]:
    given = zip(signature.args, values, strict=True)
    return [context.make_array(kind)(context, builder, value) for kind, value in given]


def _are_contiguous(*kinds: Any) -> bool:
    return all(
        isinstance(kind, types.Array) and kind.layout == "C" and kind.dtype == types.float32
        for kind in kinds
    )


def _type_product(_context: Any, out: Any, matrix: Any, vector: Any) -> Any:
    """Add a product with one vector."""
    if not _are_contiguous(out, matrix, vector):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        target, weights, factors = _arrays(context, builder, signature, values)
        rows, columns = cgutils.unpack_tuple(builder, weights.shape)
        start = _index(0)
        for width in (16, 8, 1):
            code = _Code(builder, width)
            stop = _whole(builder, start, columns, width)
            with _steps(builder, start, stop, width) as (j, _):
                (total,) = code.sums([code.load(target.data, j)])
                with cgutils.for_range(builder, rows) as loop:
                    row = builder.add(builder.mul(loop.index, columns), j)
                    factor = code.repeated(factors.data, loop.index)
                    code.add(total, code.load(weights.data, row), factor)
                code.store(target.data, j, builder.load(total))
            start = stop
        return context.get_dummy_value()

    return types.void(out, matrix, vector), generate


def _type_lane_product(_context: Any, out: Any, matrix: Any, lanes: Any) -> Any:
    """Add products with many vectors."""
    if not _are_contiguous(out, matrix, lanes):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        target, weights, factors = _arrays(context, builder, signature, values)
        rows, columns = cgutils.unpack_tuple(builder, weights.shape)
        _, n_lanes = cgutils.unpack_tuple(builder, factors.shape)
        code = _Code(builder, LANES)
        with _steps(builder, _index(0), n_lanes, LANES) as (lane, _):
            start = _index(0)
            for tile in (_COLUMNS, 1):
                stop = _whole(builder, start, columns, tile)
                with _steps(builder, start, stop, tile) as (j, _):
                    column = [builder.add(j, _index(k)) for k in range(tile)]
                    place = [builder.add(builder.mul(c, n_lanes), lane) for c in column]
                    totals = code.sums([code.load(target.data, at) for at in place])
                    with cgutils.for_range(builder, rows) as loop:
                        at = builder.add(builder.mul(loop.index, n_lanes), lane)
                        vector = code.load(factors.data, at)
                        row = builder.mul(loop.index, columns)
                        for c, total in zip(column, totals, strict=True):
                            weight = code.repeated(weights.data, builder.add(row, c))
                            code.add(total, weight, vector)
                    for at, total in zip(place, totals, strict=True):
                        code.store(target.data, at, builder.load(total))
                start = stop
        return context.get_dummy_value()

    return types.void(out, matrix, lanes), generate


def _type_dot(_context: Any, a: Any, b: Any) -> Any:
    """Return a dot product."""
    if not _are_contiguous(a, b):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = _arrays(context, builder, signature, values)
        (size,) = cgutils.unpack_tuple(builder, left.shape)
        code, single = _Code(builder, _PARTS), _Code(builder, 1)
        stop = _whole(builder, _index(0), size, _PARTS)
        (parts,) = code.zeros(1)
        with _steps(builder, _index(0), stop, _PARTS) as (i, _):
            code.add(parts, code.load(left.data, i), code.load(right.data, i))
        vector = builder.load(parts)
        elements = [
            builder.extract_element(vector, ir.Constant(ir.IntType(32), k)) for k in range(_PARTS)
        ]
        total = cgutils.alloca_once_value(builder, single.tree(elements))
        with _steps(builder, stop, size, 1) as (i, _):
            x, y = (builder.load(builder.gep(item.data, [i])) for item in (left, right))
            builder.store(builder.fadd(builder.load(total), builder.fmul(x, y)), total)
        return builder.load(total)

    return types.float32(a, b), generate


def _type_lane_dot(_context: Any, a: Any, lanes: Any, out: Any) -> Any:
    """Write dot products with many vectors."""
    if not _are_contiguous(a, lanes, out):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        weights, factors, target = _arrays(context, builder, signature, values)
        (size,) = cgutils.unpack_tuple(builder, weights.shape)
        _, n_lanes = cgutils.unpack_tuple(builder, factors.shape)
        code = _Code(builder, LANES)
        stop = _whole(builder, _index(0), size, _PARTS)
        with _steps(builder, _index(0), n_lanes, LANES) as (lane, _):
            parts = code.zeros(_PARTS)
            with _steps(builder, _index(0), stop, _PARTS) as (i, _):
                for k, part in enumerate(parts):
                    at = builder.add(i, _index(k))
                    vector = code.load(factors.data, builder.add(builder.mul(at, n_lanes), lane))
                    code.add(part, code.repeated(weights.data, at), vector)
            (total,) = code.sums([code.tree([builder.load(part) for part in parts])])
            with _steps(builder, stop, size, 1) as (i, _):
                vector = code.load(factors.data, builder.add(builder.mul(i, n_lanes), lane))
                code.add(total, code.repeated(weights.data, i), vector)
            code.store(target.data, lane, builder.load(total))
        return context.get_dummy_value()

    return types.void(a, lanes, out), generate


_add_product: Any = intrinsic(_type_product)
_add_lane_product: Any = intrinsic(_type_lane_product)
_dot: Any = intrinsic(_type_dot)
_lane_dot: Any = intrinsic(_type_lane_dot)


@inlined_kernel
def add_product(out: Float32Array, matrix: Float32Array, vector: Float32Array) -> None:
    """out (>= m,) += matrix' vector: `matrix` (n, m), `vector` (>= n,)."""
    _add_product(out, matrix, vector)


@inlined_kernel
def add_lane_product(out: Float32Array, matrix: Float32Array, lanes: Float32Array) -> None:
    """
    Run `add_product` in each lane: `matrix` (n, m), `lanes` (>= n, l), `out` (>= m, l).

    l is a multiple of `LANES`.
    """
    _add_lane_product(out, matrix, lanes)


@inlined_kernel
def dot(a: Float32Array, b: Float32Array) -> Any:
    """Return a' b, float32: `a` (n,), `b` (>= n,)."""
    return _dot(a, b)


@inlined_kernel
def lane_dot(a: Float32Array, lanes: Float32Array, out: Float32Array) -> None:
    """Write `dot` with each lane: `a` (n,), `lanes` (>= n, l), `out` (l,); l as above."""
    _lane_dot(a, lanes, out)
