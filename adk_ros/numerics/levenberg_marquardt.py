# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Robust nonlinear least squares within bounds: Levenberg-Marquardt on a Huber loss.

Minimises over the parameters x (n,)

    sum_i rho(e_i(x)) + sum_j ((x_j - mean_j) / deviation_j)^2 + x^T coupling x

where e are residuals divided by their standard deviations and rho(e) = e^2 up to the Huber
threshold, linear beyond it. Each iteration linearises e, solves the damped normal equations

    (N + damping diag(N)) step = -g,    N = J^T W J + prior,    g = J^T W e + prior gradient

within the bounds, and accepts the step only if the cost falls. W holds the Huber weights.

D. W. Marquardt, J. SIAM 11 (1963) 431; P. J. Huber, Ann. Math. Statist. 35 (1964) 73.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray

HUBER_THRESHOLD = 8.0
"""Default Huber threshold in standard deviations: high, so that only gross errors are limited."""
_MIN_DIAGONAL = 1e-12
"""Least diagonal entry used for scaling: a parameter without influence takes a finite step."""

Residuals = Callable[[FloatArray], FloatArray]
"""Maps parameters (n,) to whitened residuals of any shape."""


class Linearisation(NamedTuple):
    """
    Normal equations of the residuals at one point, without the prior.

    `jacobian` (m, n) is empty, shape (0, n), where it is never formed as one matrix.
    """

    gradient: FloatArray
    normal: FloatArray
    jacobian: FloatArray


Linearise = Callable[[FloatArray, FloatArray], Linearisation]
"""Maps parameters (n,) and their residuals to the normal equations."""


@dataclass(frozen=True)
class DampingSchedule:
    """
    Damping of the steps.

    A refused step multiplies the damping by `increase`, to at least `after_refusal`; an accepted
    step multiplies it by `decrease`, to at least `minimum`. An iteration tries at most `trials`
    steps.
    """

    initial: float = 1e-4
    increase: float = 10.0
    after_refusal: float = 1e-3
    decrease: float = 0.1
    minimum: float = 1e-6
    trials: int = 6

    def refused(self, damping: float) -> float:
        """Return the damping after a refused step."""
        return max(damping * self.increase, self.after_refusal)

    def accepted(self, damping: float) -> float:
        """Return the damping after an accepted step."""
        return max(damping * self.decrease, self.minimum)


GAUSS_NEWTON = DampingSchedule(initial=0.0, minimum=0.0)
"""Undamped steps; damped only after a step that does not lower the cost."""


@dataclass(frozen=True)
class FitOptions:
    """
    Budget and loss of a fit.

    The fit ends after `iterations`, or after an iteration that lowers the cost by less than
    `relative_tolerance` times the cost plus `absolute_tolerance`.
    """

    iterations: int = 8
    relative_tolerance: float = 1e-4
    absolute_tolerance: float = 0.02
    huber_threshold: float = HUBER_THRESHOLD
    damping: DampingSchedule = field(default_factory=DampingSchedule)


@dataclass(frozen=True)
class BoundedParameters:
    """
    Start, bounds, finite-difference steps and Gaussian prior of the parameters, all (n,).

    `deviation` is infinite for a parameter without a prior. `coupling` (n, n), symmetric, adds
    x^T coupling x to the cost: a prior on combinations of parameters, such as a curve's bend.
    """

    start: FloatArray
    low: FloatArray
    high: FloatArray
    step: FloatArray
    mean: FloatArray
    deviation: FloatArray
    coupling: FloatArray | None = None

    def prior_cost(self, x: FloatArray) -> float:
        """Return the prior's part of the cost."""
        cost = float(np.sum(((x - self.mean) / self.deviation) ** 2))
        return cost if self.coupling is None else cost + float(x @ self.coupling @ x)

    def prior_gradient(self, x: FloatArray) -> FloatArray:
        """Return half the gradient (n,) of the prior's cost."""
        gradient = (x - self.mean) * (1.0 / self.deviation**2)
        return np.asarray(gradient if self.coupling is None else gradient + self.coupling @ x)

    def prior_precision(self) -> FloatArray:
        """Return half the Hessian (n, n) of the prior's cost."""
        precision = np.diag(1.0 / self.deviation**2)
        return np.asarray(precision if self.coupling is None else precision + self.coupling)


@dataclass(frozen=True)
class FitResult:
    """
    Minimum of a fit.

    `x` (n,); `cost` includes the prior, `residuals` and `jacobian` (m, n) do not. `normal` (n, n)
    is the normal matrix with the prior: its inverse is the covariance of x where the residuals
    are white. `jacobian` and `normal` are those of the last linearisation. `low`, `high` (n,) are
    the bounds of x.
    """

    x: FloatArray
    cost: float
    residuals: FloatArray
    jacobian: FloatArray
    normal: FloatArray
    low: FloatArray
    high: FloatArray

    def deviation(self) -> FloatArray:
        """Return the standard deviations (n,) of the parameters for white residuals."""
        scale = np.sqrt(np.maximum(np.diag(self.normal), 1e-300))
        inverse = np.linalg.pinv(self.normal / np.outer(scale, scale), hermitian=True)
        return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale)


def huber_values(e: FloatArray, threshold: float = HUBER_THRESHOLD) -> FloatArray:
    """Return the Huber loss of each whitened residual, in the shape of `e`."""
    size = np.abs(e)
    return np.where(size <= threshold, e * e, 2.0 * threshold * size - threshold * threshold)


def huber_loss(e: FloatArray, threshold: float = HUBER_THRESHOLD) -> float:
    """Return the summed Huber loss of whitened residuals."""
    return float(np.sum(huber_values(e, threshold)))


def huber_root(e: FloatArray, threshold: float = HUBER_THRESHOLD) -> FloatArray:
    """Return the square roots of the residuals' Huber weights in the normal equations."""
    return np.asarray(np.sqrt(threshold / np.maximum(np.abs(e), threshold)))


def linearise_dense(
    jacobian: FloatArray, e: FloatArray, threshold: float = HUBER_THRESHOLD
) -> Linearisation:
    """Return the Huber-weighted normal equations of a Jacobian (m, n) and residuals (m,)."""
    root = huber_root(e, threshold)
    weighted = jacobian * root[:, None]
    return Linearisation(weighted.T @ (e * root), weighted.T @ weighted, jacobian)


def derivative_by_difference(
    residuals: Residuals, x: FloatArray, e: FloatArray, j: int, step: float, high: float
) -> FloatArray:
    """Return d(residuals)/dx_j (m,) by a forward, at the bound `high` by a backward difference."""
    signed_step = step if x[j] + step <= high else -step
    moved = x.copy()
    moved[j] += signed_step
    return np.asarray((residuals(moved) - e) / signed_step)


def jacobian_by_differences(
    residuals: Residuals,
    parameters: BoundedParameters,
    x: FloatArray,
    e: FloatArray,
    known_columns: FloatArray | None = None,
) -> FloatArray:
    """
    Return d(residuals)/dx (m, n) by one-sided differences that stay within the bounds.

    `known_columns` (m, k) replaces the first k columns.
    """
    out = np.empty((e.shape[0], x.shape[0]))
    first = 0
    if known_columns is not None:
        first = known_columns.shape[1]
        out[:, :first] = known_columns
    for j in range(first, x.shape[0]):
        out[:, j] = derivative_by_difference(
            residuals, x, e, j, parameters.step[j], parameters.high[j]
        )
    return out


def bounded_step(
    normal: FloatArray, gradient: FloatArray, damping: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """
    Return the damped step d (n,) that minimises g d + d N d / 2 within low <= d <= high.

    Approximately: a component that would cross a bound is set to the bound, and the others are
    solved for again. Clipping alone would leave the valley of two correlated parameters.
    """
    n = gradient.shape[0]
    scale = np.sqrt(np.maximum(np.diag(normal), _MIN_DIAGONAL))
    scaled = normal / np.outer(scale, scale)
    scaled[np.diag_indices(n)] += damping
    right, low, high = -gradient / scale, low * scale, high * scale
    change = np.zeros(n)
    free = ~(((low >= 0.0) & (right < 0.0)) | ((high <= 0.0) & (right > 0.0)))
    for _ in range(n):
        if not free.any():
            break
        from_fixed = scaled[np.ix_(free, ~free)] @ change[~free]
        change[free] = np.linalg.solve(scaled[np.ix_(free, free)], right[free] - from_fixed)
        crossing = free & ((change < low) | (change > high))
        if not crossing.any():
            break
        change[crossing] = np.clip(change[crossing], low[crossing], high[crossing])
        free &= ~crossing
    return np.asarray(np.clip(change, low, high) / scale)


def minimise(
    residuals: Residuals,
    parameters: BoundedParameters,
    options: FitOptions | None = None,
    *,
    known_columns: FloatArray | None = None,
    linearise: Linearise | None = None,
) -> FitResult:
    """
    Minimise the cost from `parameters.start`.

    `linearise` returns the normal equations; the default forms them from one-sided differences of
    one-dimensional residuals. `known_columns` (m, k), for the default only: the first k columns of
    the Jacobian, constant throughout.
    """
    options = options or FitOptions()
    threshold, schedule = options.huber_threshold, options.damping

    def by_differences(x: FloatArray, e: FloatArray) -> Linearisation:
        jacobian = jacobian_by_differences(residuals, parameters, x, e, known_columns)
        return linearise_dense(jacobian, e, threshold)

    linearise = linearise or by_differences
    x = np.clip(parameters.start, parameters.low, parameters.high)
    e = residuals(x)
    cost = huber_loss(e, threshold) + parameters.prior_cost(x)
    damping = schedule.initial
    precision = parameters.prior_precision()
    jacobian = np.empty((e.shape[0], 0))
    normal = np.eye(x.shape[0])
    for _ in range(options.iterations):
        data = linearise(x, e)
        jacobian = data.jacobian
        gradient = data.gradient + parameters.prior_gradient(x)
        normal = data.normal + precision
        for _ in range(schedule.trials):
            step = bounded_step(normal, gradient, damping, parameters.low - x, parameters.high - x)
            x_trial = np.clip(x + step, parameters.low, parameters.high)
            e_trial = residuals(x_trial)
            cost_trial = huber_loss(e_trial, threshold) + parameters.prior_cost(x_trial)
            if np.isfinite(cost_trial) and cost_trial < cost:
                break
            damping = schedule.refused(damping)
        else:
            break
        gain = cost - cost_trial
        x, e, cost = x_trial, e_trial, cost_trial
        damping = schedule.accepted(damping)
        if gain < options.relative_tolerance * cost + options.absolute_tolerance:
            break
    return FitResult(x, cost, e, jacobian, normal, parameters.low, parameters.high)
