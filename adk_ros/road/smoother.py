# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Slope of the road along one axis of the car: a random walk over places, as a sparse Gaussian model.

Along an axis with velocity v and specific force a, gravity adds g sin(slope) to the accelerometer:

    v[i+1] - v[i] = integral of (a + turn) - h (theta[i] + theta[i+1]) / 2 - columns @ c + w
    z[i] = v[i] + e[i]
    theta[k+1] - theta[k] = u[k],    theta = g sin(slope) at knots along the road

with w, e, u white: variances `force` h, `reading` / readings, `walk` times the distance. c are
constants of the sensors with their prior: offset, share of the force (pitch and roll of the body
with load transfer, scale), other axis, lever arm, delay. Knots are places, so that a road driven
again, in either direction, has one slope, which a constant offset does not share. The posterior is
exact; the three variances maximise the marginal likelihood (J. Durbin, S. J. Koopman, Time Series
Analysis by State Space Methods, 2012, section 7; H. Rue, L. Held, Gaussian Markov Random Fields,
2005, section 2.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_matrix, csc_matrix, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.places import Places

MAX_KNOTS = 3000
"""Knots at most: the time of the intervals grows with their square."""
_FLAT = 1e-12
"""Precision of a velocity before its reading, s²/m²: none, but the matrix stays regular."""
_CHUNK = 256
"""Columns of the covariance that are solved for at once."""
_RANGE = 12.0
"""Largest |ln| of a variance over its start: five decades."""
_SEARCH = 160
"""Evaluations of the likelihood at most; it is flat after about 80."""


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
class Variances:
    """White noise: of a reading, (m/s)²; of the force, (m/s²)² s; of the walk, (m/s²)²/m."""

    reading: float
    force: float
    walk: float


@dataclass(frozen=True)
class Slopes:
    """
    Posterior at the n nodes in the direction of the car: `theta`, `sigma` (n,), m/s².

    `level_sigma`: of the mean of theta over the distance; `relative_sigma` (n,): of the difference
    from it. `constants`, `constant_sigma` (k,).
    """

    theta: FloatArray
    sigma: FloatArray
    level_sigma: float
    relative_sigma: FloatArray
    constants: FloatArray
    constant_sigma: FloatArray
    variances: Variances


@dataclass(frozen=True)
class _Rows:
    """
    Rows of a linear model: `matrix` (m, size), `target` and relative `precision` (m,).

    `rank`: rows that are independent of each other.
    """

    matrix: csc_matrix
    target: FloatArray
    precision: FloatArray
    rank: int


@dataclass(frozen=True)
class _Posterior:
    """
    Velocities and slopes s, factorised, bordered by the constants c, which touch every step.

    `border`: Q_ss^-1 Q_sc (s, k); `information` (k, k) of the data on c; `inner` (k, k): their
    covariance. `cost`: -2 log likelihood up to a constant.
    """

    factors: SuperLU
    border: FloatArray
    information: FloatArray
    inner: FloatArray
    mean: FloatArray
    constants: FloatArray
    cost: float


class SlopeModel:
    """The sparse model of one axis over given places."""

    def __init__(self, axis: Axis, places: Places, driven: FloatArray, spacing: float) -> None:
        """
        Arrange the model.

        :param driven: distance (n,), m, around each node in the direction of the car's x axis.
        :param spacing: of the knots, m.
        """
        self._axis, self._places, self._driven = axis, places, driven
        self._spacing = spacing
        nodes = np.flatnonzero(axis.readings > 0)
        position = places.place / spacing
        self._knot = np.floor(position).astype(np.int64)
        self._share = position - self._knot
        self._first_knot = nodes.size
        self._knots = int(self._knot.max()) + 2
        self._size = nodes.size + self._knots
        column_of = np.full(axis.velocity.size, -1, dtype=np.int64)
        column_of[nodes] = np.arange(nodes.size)
        self._steps = np.flatnonzero(axis.used)
        self._parts = [
            self._reading_rows(nodes),
            self._force_rows(column_of),
            self._walk_rows(),
        ]
        self._columns = axis.columns[self._steps]
        self._pattern = _CommonPattern([x.matrix for x in self._parts], self._parts)

    def _slope_entries(self, nodes: IntArray) -> tuple[IntArray, FloatArray]:
        """Return knots (m, 2) and weights (m, 2) of theta in the direction of the car."""
        sign, share = self._places.direction[nodes], self._share[nodes]
        knots = np.column_stack([self._knot[nodes], self._knot[nodes] + 1])
        return knots, np.column_stack([sign * (1.0 - share), sign * share])

    def _rows(self, columns: list[IntArray], values: list[FloatArray]) -> csc_matrix:
        wide, high = np.column_stack(columns), np.column_stack(values)
        at = np.repeat(np.arange(wide.shape[0]), wide.shape[1])
        shape = (wide.shape[0], self._size)
        return coo_matrix((high.ravel(), (at, wide.ravel())), shape).tocsc()

    def _reading_rows(self, nodes: IntArray) -> _Rows:
        matrix = self._rows([np.arange(nodes.size)], [np.ones(nodes.size)])
        readings = self._axis.readings[nodes].astype(np.float64)
        return _Rows(matrix, self._axis.velocity[nodes], readings, nodes.size)

    def _force_rows(self, column_of: IntArray) -> _Rows:
        at, ones = self._steps, np.ones(self._steps.size)
        columns: list[IntArray] = [column_of[at + 1], column_of[at]]
        values: list[FloatArray] = [ones, -ones]
        for nodes in (at, at + 1):
            knots, weights = self._slope_entries(nodes)
            columns.append(self._first_knot + knots)
            values.append(0.5 * self._axis.step_s * weights)
        precision = ones / self._axis.step_s
        return _Rows(self._rows(columns, values), self._axis.gained[at], precision, at.size)

    def _walk_rows(self) -> _Rows:
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
            [self._first_knot + first, self._first_knot + second], [np.ones(first.size), -sign]
        )
        graph = coo_matrix((np.ones(first.size), (first, second)), (self._knots, self._knots))
        # Where joined stretches make a circle, its last step follows from the others.
        rank = self._knots - int(connected_components(graph, directed=False)[0])
        return _Rows(matrix, np.zeros(first.size), 1.0 / length, rank)

    def _posterior(self, variances: Variances) -> _Posterior:
        scales = (variances.reading, variances.force, variances.walk)
        weights = [x.precision / scale for x, scale in zip(self._parts, scales, strict=True)]
        factors = splu(
            self._pattern.sum([1.0 / scale for scale in scales]),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
        )
        right = np.sum(
            [x.matrix.T @ (w * x.target) for x, w in zip(self._parts, weights, strict=True)],
            axis=0,
        )
        force, weight = self._parts[1], weights[1]
        cross = force.matrix.T @ (weight[:, None] * self._columns)
        solved = factors.solve(np.column_stack([right, cross]))
        border = solved[:, 1:]
        own = self._columns.T @ (weight[:, None] * self._columns)
        free, axis = ~self._axis.considered, self._axis
        information = own - cross.T @ border
        precision = (information + np.diag(axis.prior**-2.0))[np.ix_(free, free)]
        known = self._columns.T @ (weight * force.target) - border.T @ right
        known += axis.expected / axis.prior**2 - information[:, ~free] @ axis.expected[~free]
        constants = np.array(axis.expected)
        constants[free] = np.linalg.solve(precision, known[free])
        inner = np.zeros_like(own)
        inner[np.ix_(free, free)] = np.linalg.inv(precision)
        # What the others, and by the border the slopes, change with a considered constant.
        change = np.eye(free.size)[:, ~free]
        change[free] = -np.linalg.solve(precision, information[np.ix_(free, ~free)])
        inner += (change * axis.prior[~free] ** 2) @ change.T
        mean = solved[:, 0] - border @ constants
        surprise = ((constants - axis.expected) / axis.prior)[free]
        cost = float(np.log(np.abs(factors.U.diagonal())).sum()) + float(surprise @ surprise)
        cost += float(np.linalg.slogdet(precision)[1])
        for number, (part, each) in enumerate(zip(self._parts, weights, strict=True)):
            error = part.target - part.matrix @ mean
            if number == 1:
                error = error - self._columns @ constants
            cost += float(each @ error**2) + part.rank * float(np.log(scales[number]))
        return _Posterior(factors, border, information, inner, mean, constants, cost)

    def fitted(self, start: Variances) -> Variances:
        """Return the variances of greatest marginal likelihood, that of the walk not zero."""
        first = np.log([start.reading, start.force, start.walk])

        def at(logs: FloatArray) -> Variances:
            return Variances(*np.exp(np.clip(logs, first - _RANGE, first + _RANGE)).tolist())

        options = {
            "maxfev": _SEARCH,
            "xatol": 0.1,
            "fatol": 0.5,
            "initial_simplex": first + np.vstack([np.zeros(3), 2.0 * np.eye(3)]),
        }
        found = minimize(
            # A walk of zero would claim a slope without any uncertainty where none is detected:
            # ln(sigma) is added to the log likelihood (Y. Chung et al., Psychometrika 78, 2013,
            # 685).
            lambda logs: self._posterior(at(logs)).cost - float(logs[2]),
            first,
            method="Nelder-Mead",
            options=options,
        )
        return at(found.x)

    def information(self, variances: Variances) -> FloatArray:
        """Return the information (k,) of the data on each constant, the others known."""
        return np.asarray(np.diag(self._posterior(variances).information))

    def slopes(self, variances: Variances, height_sigma: float | None) -> Slopes:
        """
        Return the posterior of the slopes.

        :param height_sigma: standard deviation, m, with which the heights of a place agree when
            the car returns to it; None where the slope is no height (bank).
        """
        posterior = self._posterior(variances)
        value = np.concatenate([posterior.mean[self._first_knot :], posterior.constants])
        spread = self._covariance(posterior)
        if height_sigma is not None and self._places.returns:
            value, spread = self._closed(value, spread, height_sigma)
        every = np.arange(self._knot.size)
        knots, weights = self._slope_entries(every)
        a, b = knots.T
        variance = (
            weights[:, 0] ** 2 * spread[a, a]
            + weights[:, 1] ** 2 * spread[b, b]
            + 2.0 * weights[:, 0] * weights[:, 1] * spread[a, b]
        )
        level = self._travelled(0, every.size - 1) / max(float(np.abs(self._driven).sum()), 1e-9)
        with_level = spread @ level
        level_variance = max(float(level @ with_level), 0.0)
        relative = variance + level_variance - 2.0 * (weights * with_level[knots]).sum(axis=1)
        return Slopes(
            (weights * value[knots]).sum(axis=1),
            np.sqrt(np.maximum(variance, 0.0)),
            float(np.sqrt(level_variance)),
            np.sqrt(np.maximum(relative, 0.0)),
            value[self._knots :],
            np.sqrt(np.maximum(np.diag(spread)[self._knots :], 0.0)),
            variances,
        )

    def _covariance(self, posterior: _Posterior) -> FloatArray:
        """Return the covariance of knots and constants."""
        k = self._knots
        out = np.empty((k + posterior.inner.shape[0],) * 2)
        for begin in range(0, k, _CHUNK):
            end = min(begin + _CHUNK, k)
            units = np.zeros((self._size, end - begin))
            units[self._first_knot + np.arange(begin, end), np.arange(end - begin)] = 1.0
            out[:k, begin:end] = posterior.factors.solve(units)[self._first_knot :]
        border = posterior.border[self._first_knot :]
        out[:k, :k] += border @ posterior.inner @ border.T
        out[:k, k:] = -border @ posterior.inner
        out[k:, :k] = out[:k, k:].T
        out[k:, k:] = posterior.inner
        return out

    def _travelled(self, first: int, last: int) -> FloatArray:
        """Return the row (knots + constants,) that integrates the slope over the way."""
        nodes = np.arange(first, last + 1)
        knots, weights = self._slope_entries(nodes)
        row = np.zeros(self._knots + self._axis.prior.size)
        np.add.at(row, knots.ravel(), (weights * self._driven[nodes][:, None]).ravel())
        return row

    def _closed(
        self, value: FloatArray, spread: FloatArray, height_sigma: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance given that heights agree where the car returns."""
        rows = np.vstack([self._travelled(*each) for each in self._places.returns])
        cross = spread @ rows.T
        noise = np.eye(rows.shape[0]) * (GRAVITY * height_sigma) ** 2
        gain = np.linalg.solve(rows @ cross + noise, cross.T).T
        return value - gain @ (rows @ value), spread - gain @ cross.T


class _CommonPattern:
    """Normal matrices of several parts, on one sparsity pattern, to add them fast."""

    def __init__(self, matrices: list[csc_matrix], parts: list[_Rows]) -> None:
        products = [
            (m.T @ diags_array(x.precision) @ m).tocoo()
            for m, x in zip(matrices, parts, strict=True)
        ]
        self._size = matrices[0].shape[1]
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
