# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The linear equations of a slope along the way, as sparse rows: readings, forces, random walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags_array
from scipy.sparse.csgraph import connected_components

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.road.places import Places

_FLAT = 1e-12
"""Precision of a velocity before its reading, s²/m²: none, but the matrix stays regular."""


@dataclass(frozen=True)
class Axis:
    """
    Readings along one axis of the car, for n nodes and the n - 1 steps between them.

    `velocity` (n,), m/s; `readings` (n,): its number, zero where unknown. `gained` (n - 1,):
    integral of specific force and turn over the step, m/s. `columns` (n - 1, k): integrals of the
    disturbances for a constant of one. The constants have the standard deviations `prior` (k,)
    about `expected` (k,); those of `considered` (k,) are not estimated but widen the intervals (S.
    F. Schmidt, Advances in Control Systems 3, 1966, 293).
    """

    velocity: FloatArray
    readings: IntArray
    gained: FloatArray
    columns: FloatArray
    expected: FloatArray
    prior: FloatArray
    considered: BoolArray
    used: BoolArray
    step_s: float


@dataclass(frozen=True)
class Rows:
    """
    Rows of a linear model: `matrix` (m, size), `target` and relative `precision` (m,).

    `rank`: rows that are independent of each other.
    """

    matrix: csc_matrix
    target: FloatArray
    precision: FloatArray
    rank: int


class SlopeRows:
    """
    The equations of one axis over given places, for velocities at used nodes and slopes at knots.

    `readings`, `forces`, `walk`: their rows; `columns` (m, k): disturbances in the rows of the
    forces; `knots`: number of knots, which follow `first_knot` velocities in the unknowns.
    """

    def __init__(self, axis: Axis, places: Places, driven: FloatArray, spacing: float) -> None:
        """
        Arrange the equations.

        :param driven: distance (n,), m, around each node in the direction of the car's x axis.
        :param spacing: of the knots, m.
        """
        self._axis, self._places, self._spacing = axis, places, spacing
        self.driven = driven
        nodes = np.flatnonzero(axis.readings > 0)
        position = places.place / spacing
        self._knot = np.floor(position).astype(np.int64)
        self._share = position - self._knot
        self.first_knot = nodes.size
        self.knots = int(self._knot.max()) + 2
        self.size = nodes.size + self.knots
        column_of = np.full(axis.velocity.size, -1, dtype=np.int64)
        column_of[nodes] = np.arange(nodes.size)
        self._steps = np.flatnonzero(axis.used)
        self.readings = self._reading_rows(nodes)
        self.forces = self._force_rows(column_of)
        self.walk = self._walk_rows()
        self.columns = axis.columns[self._steps]
        self.pattern = CommonPattern([self.readings, self.forces, self.walk])

    def slope_entries(self, nodes: IntArray) -> tuple[IntArray, FloatArray]:
        """Return knots (m, 2) and weights (m, 2) of theta in the direction of the car."""
        sign, share = self._places.direction[nodes], self._share[nodes]
        knots = np.column_stack([self._knot[nodes], self._knot[nodes] + 1])
        return knots, np.column_stack([sign * (1.0 - share), sign * share])

    def _rows(self, columns: list[IntArray], values: list[FloatArray]) -> csc_matrix:
        wide, high = np.column_stack(columns), np.column_stack(values)
        at = np.repeat(np.arange(wide.shape[0]), wide.shape[1])
        shape = (wide.shape[0], self.size)
        return coo_matrix((high.ravel(), (at, wide.ravel())), shape).tocsc()

    def _reading_rows(self, nodes: IntArray) -> Rows:
        matrix = self._rows([np.arange(nodes.size)], [np.ones(nodes.size)])
        readings = self._axis.readings[nodes].astype(np.float64)
        return Rows(matrix, self._axis.velocity[nodes], readings, nodes.size)

    def _force_rows(self, column_of: IntArray) -> Rows:
        at, ones = self._steps, np.ones(self._steps.size)
        columns: list[IntArray] = [column_of[at + 1], column_of[at]]
        values: list[FloatArray] = [ones, -ones]
        for nodes in (at, at + 1):
            knots, weights = self.slope_entries(nodes)
            columns.append(self.first_knot + knots)
            values.append(0.5 * self._axis.step_s * weights)
        precision = ones / self._axis.step_s
        return Rows(self._rows(columns, values), self._axis.gained[at], precision, at.size)

    def _walk_rows(self) -> Rows:
        """Return the random walk along stretches and across their joins."""
        spacing, joins = self._spacing, self._places.joins
        inner = np.concatenate(
            [
                np.arange(int(low // spacing), int(high // spacing) + 1)
                for low, high in self._places.stretches
            ]
        )
        near = [round(x.place / spacing) for x in joins]
        far = [round(x.other / spacing) for x in joins]
        apart = [max(x.distance, spacing) for x in joins]
        first = np.concatenate([inner, np.array(near, dtype=np.int64)])
        second = np.concatenate([inner + 1, np.array(far, dtype=np.int64)])
        sign = np.concatenate([np.ones(inner.size), [x.sign for x in joins]])
        length = np.concatenate([np.full(inner.size, spacing), apart])
        distinct = first != second
        first, second, sign, length = (x[distinct] for x in (first, second, sign, length))
        matrix = self._rows(
            [self.first_knot + first, self.first_knot + second], [np.ones(first.size), -sign]
        )
        graph = coo_matrix((np.ones(first.size), (first, second)), (self.knots, self.knots))
        # Where joined stretches make a circle, its last step follows from the others.
        rank = self.knots - int(connected_components(graph, directed=False)[0])
        return Rows(matrix, np.zeros(first.size), 1.0 / length, rank)

    def travelled(self, first: int, last: int) -> FloatArray:
        """Return the row (knots + constants,) that integrates the slope over the way."""
        nodes = np.arange(first, last + 1)
        knots, weights = self.slope_entries(nodes)
        row = np.zeros(self.knots + self._axis.prior.size)
        np.add.at(row, knots.ravel(), (weights * self.driven[nodes][:, None]).ravel())
        return row


class CommonPattern:
    """Normal matrices of several parts, on one sparsity pattern, to add them fast."""

    def __init__(self, parts: list[Rows]) -> None:
        products = [(x.matrix.T @ diags_array(x.precision) @ x.matrix).tocoo() for x in parts]
        self._size = parts[0].matrix.shape[1]
        keys = [x.col.astype(np.int64) * self._size + x.row for x in products]
        diagonal = np.arange(self._size) * (self._size + 1)
        union = np.unique(np.concatenate([*keys, diagonal]))
        self._data = np.zeros((len(products), union.size))
        for row, key, product in zip(self._data, keys, products, strict=True):
            row[np.searchsorted(union, key)] = product.data
        self._flat = np.zeros(union.size)
        self._flat[np.searchsorted(union, diagonal)] = _FLAT
        self._rows = union % self._size
        self._starts = np.searchsorted(union, np.arange(self._size + 1) * self._size)

    def sum(self, factors: list[float]) -> csc_matrix:
        """Return the sum of the matrices with factors, and of a tiny diagonal."""
        data = self._flat + np.array(factors) @ self._data
        return csc_matrix((data, self._rows, self._starts), (self._size, self._size))
