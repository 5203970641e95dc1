# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bounded robust least squares: Levenberg-Marquardt on a Huber loss, derivatives by differences.

Minimised is sum rho(e_i) + sum ((x - mean) / deviation)^2 with e the residuals over their noise,
rho(e) = e^2 within `HUBER`, linear beyond: a few moments of sliding must not decide everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray

HUBER_THRESHOLD = 8.0
"""Residuals beyond this many standard deviations count linearly."""

Residuals = Callable[[FloatArray], FloatArray]


def huber_loss(e: FloatArray) -> float:
    """Return the Huber loss of whitened residuals."""
    size = np.abs(e)
    return float(
        np.sum(
            np.where(
                size <= HUBER_THRESHOLD,
                e * e,
                2.0 * HUBER_THRESHOLD * size - HUBER_THRESHOLD * HUBER_THRESHOLD,
            )
        )
    )


def huber_root(e: FloatArray) -> FloatArray:
    """Return the square roots of the weights with which the residuals enter a normal equation."""
    return np.asarray(np.sqrt(HUBER_THRESHOLD / np.maximum(np.abs(e), HUBER_THRESHOLD)))


@dataclass(frozen=True)
class BoundedParameters:
    """
    What is fitted: `start`, bounds, the steps of the differences, and a pull towards `mean`.

    All (n,); `deviation` is infinite where nothing pulls.
    """

    start: FloatArray
    low: FloatArray
    high: FloatArray
    step: FloatArray
    mean: FloatArray
    deviation: FloatArray

    def prior(self, x: FloatArray) -> FloatArray:
        """Return the prior's residuals (n,)."""
        return np.asarray((x - self.mean) / self.deviation)


@dataclass(frozen=True)
class FitResult:
    """
    A minimum: `x` (n,), `cost` with the prior, `residuals` without, `jacobian` (m, n) of them.

    `normal` (n, n) is the normal matrix with the prior; its inverse is the covariance as far as
    the residuals are white.
    """

    x: FloatArray
    cost: float
    residuals: FloatArray
    jacobian: FloatArray
    normal: FloatArray
    at_bound: BoolArray

    def deviation(self) -> FloatArray:
        """Return the standard deviations (n,) of white residuals."""
        scale = np.sqrt(np.maximum(np.diag(self.normal), 1e-300))
        inverse = np.linalg.pinv(self.normal / np.outer(scale, scale), hermitian=True)
        return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale)


def jacobian_by_differences(
    residuals: Residuals,
    x: FloatArray,
    e: FloatArray,
    u: BoundedParameters,
    known: FloatArray | None,
) -> FloatArray:
    """Return d(residuals)/dx (m, n) by one-sided differences that stay within the bounds."""
    out = np.empty((e.shape[0], x.shape[0]))
    first = 0
    if known is not None:
        first = known.shape[1]
        out[:, :first] = known
    for j in range(first, x.shape[0]):
        moved = x.copy()
        step = u.step[j] if x[j] + u.step[j] <= u.high[j] else -u.step[j]
        moved[j] += step
        out[:, j] = (residuals(moved) - e) / step
    return out


def _bounded_step(
    normal: FloatArray, gradient: FloatArray, damping: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """
    Return the step (n,) that minimises g d + d N d / 2 within the bounds, nearly.

    What a step would carry over a bound goes to the bound, and the rest is solved anew: cutting
    it off alone would leave a narrow valley's floor.
    """
    n = gradient.shape[0]
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / np.outer(scale, scale)
    scaled[np.diag_indices(n)] += damping
    right, low, high = -gradient / scale, low * scale, high * scale
    change = np.zeros(n)
    free = ~(((low >= 0.0) & (right < 0.0)) | ((high <= 0.0) & (right > 0.0)))
    for _ in range(n):
        if not free.any():
            break
        known = scaled[np.ix_(free, ~free)] @ change[~free]
        change[free] = np.linalg.solve(scaled[np.ix_(free, free)], right[free] - known)
        over = free & ((change < low) | (change > high))
        if not over.any():
            break
        change[over] = np.clip(change[over], low[over], high[over])
        free &= ~over
    return np.asarray(np.clip(change, low, high) / scale)


def minimise(
    residuals: Residuals,
    u: BoundedParameters,
    iterations: int = 8,
    settled: float = 1e-4,
    known: FloatArray | None = None,
) -> FitResult:
    """
    Minimise; `settled` is the relative gain of an iteration that is the last one.

    `known` (m, k): the first k columns of the Jacobian, taken as they are throughout.
    """
    x = np.clip(u.start, u.low, u.high)
    e = residuals(x)
    cost = huber_loss(e) + float(np.sum(u.prior(x) ** 2))
    damping = 1e-4
    jacobian = np.empty((e.shape[0], 0))
    precision = 1.0 / u.deviation**2
    normal = np.eye(x.shape[0])
    for _ in range(iterations):
        jacobian = jacobian_by_differences(residuals, x, e, u, known)
        root = huber_root(e)
        weighted = jacobian * root[:, None]
        gradient = weighted.T @ (e * root) + (x - u.mean) * precision
        normal = weighted.T @ weighted + np.diag(precision)
        gained = False
        for _ in range(6):
            change = _bounded_step(normal, gradient, damping, u.low - x, u.high - x)
            trial = np.clip(x + change, u.low, u.high)
            e_trial = residuals(trial)
            cost_trial = huber_loss(e_trial) + float(np.sum(u.prior(trial) ** 2))
            if np.isfinite(cost_trial) and cost_trial < cost:
                gained = True
                break
            damping = max(damping * 10.0, 1e-3)
        if not gained:
            break
        gain = cost - cost_trial
        x, e, cost = trial, e_trial, cost_trial
        damping = max(damping * 0.1, 1e-6)
        if gain < settled * cost + 0.02:
            break
    at_bound = (x <= u.low + 1e-12) | (x >= u.high - 1e-12)
    return FitResult(x, cost, e, jacobian, normal, np.asarray(at_bound))
