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
from scipy.sparse.linalg import SuperLU, splu

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.places import Places
from adk_ros.road.slope_rows import Axis, SlopeRows

MAX_KNOTS = 3000
"""Knots at most: the time of the intervals grows with their square."""
_CHUNK = 256
"""Columns of the covariance that are solved for at once."""
_RANGE = 12.0
"""Largest |ln| of a variance over its start: five decades."""
_SEARCH = 160
"""Evaluations of the likelihood at most; it is flat after about 80."""


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
    """The posterior of the slopes of one axis over given places."""

    def __init__(self, axis: Axis, places: Places, driven: FloatArray, spacing: float) -> None:
        """Arrange the model; the arguments are those of `SlopeRows`."""
        self._axis, self._places = axis, places
        self._rows = SlopeRows(axis, places, driven, spacing)
        self._parts = [self._rows.readings, self._rows.forces, self._rows.walk]

    def _posterior(self, variances: Variances) -> _Posterior:
        scales = (variances.reading, variances.force, variances.walk)
        weights = [x.precision / scale for x, scale in zip(self._parts, scales, strict=True)]
        factors = splu(
            self._rows.pattern.sum([1.0 / scale for scale in scales]),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
        )
        right = np.sum(
            [x.matrix.T @ (w * x.target) for x, w in zip(self._parts, weights, strict=True)],
            axis=0,
        )
        force, weight = self._parts[1], weights[1]
        cross = force.matrix.T @ (weight[:, None] * self._rows.columns)
        solved = factors.solve(np.column_stack([right, cross]))
        border = solved[:, 1:]
        own = self._rows.columns.T @ (weight[:, None] * self._rows.columns)
        free, axis = ~self._axis.considered, self._axis
        information = own - cross.T @ border
        precision = (information + np.diag(axis.prior**-2.0))[np.ix_(free, free)]
        known = self._rows.columns.T @ (weight * force.target) - border.T @ right
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
                error = error - self._rows.columns @ constants
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
        value = np.concatenate([posterior.mean[self._rows.first_knot :], posterior.constants])
        spread = self._covariance(posterior)
        if height_sigma is not None and self._places.returns:
            value, spread = self._closed(value, spread, height_sigma)
        every = np.arange(self._places.place.size)
        knots, weights = self._rows.slope_entries(every)
        a, b = knots.T
        variance = (
            weights[:, 0] ** 2 * spread[a, a]
            + weights[:, 1] ** 2 * spread[b, b]
            + 2.0 * weights[:, 0] * weights[:, 1] * spread[a, b]
        )
        level = self._rows.travelled(0, every.size - 1) / max(
            float(np.abs(self._rows.driven).sum()), 1e-9
        )
        with_level = spread @ level
        level_variance = max(float(level @ with_level), 0.0)
        relative = variance + level_variance - 2.0 * (weights * with_level[knots]).sum(axis=1)
        return Slopes(
            (weights * value[knots]).sum(axis=1),
            np.sqrt(np.maximum(variance, 0.0)),
            float(np.sqrt(level_variance)),
            np.sqrt(np.maximum(relative, 0.0)),
            value[self._rows.knots :],
            np.sqrt(np.maximum(np.diag(spread)[self._rows.knots :], 0.0)),
            variances,
        )

    def _covariance(self, posterior: _Posterior) -> FloatArray:
        """Return the covariance of knots and constants."""
        k = self._rows.knots
        out = np.empty((k + posterior.inner.shape[0],) * 2)
        for begin in range(0, k, _CHUNK):
            end = min(begin + _CHUNK, k)
            units = np.zeros((self._rows.size, end - begin))
            units[self._rows.first_knot + np.arange(begin, end), np.arange(end - begin)] = 1.0
            out[:k, begin:end] = posterior.factors.solve(units)[self._rows.first_knot :]
        border = posterior.border[self._rows.first_knot :]
        out[:k, :k] += border @ posterior.inner @ border.T
        out[:k, k:] = -border @ posterior.inner
        out[k:, :k] = out[:k, k:].T
        out[k:, k:] = posterior.inner
        return out

    def _closed(
        self, value: FloatArray, spread: FloatArray, height_sigma: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance given that heights agree where the car returns."""
        rows = np.vstack([self._rows.travelled(*each) for each in self._places.returns])
        cross = spread @ rows.T
        noise = np.eye(rows.shape[0]) * (GRAVITY * height_sigma) ** 2
        gain = np.linalg.solve(rows @ cross + noise, cross.T).T
        return value - gain @ (rows @ value), spread - gain @ cross.T
