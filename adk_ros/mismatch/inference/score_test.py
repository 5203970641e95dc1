# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Score test: the gain of an effect from the linearised problem, without a fit.

With e the residuals of a fitted hypothesis, K their derivatives with respect to the fitted
parameters (with their prior) and S those with respect to an effect's variables, the gain of adding
the effect is that of the linear least-squares problem in both (Rao's score test). The derivatives
are secants, one for each start value of the effect, since delays and friction are far from linear.

Nuisance parameters stay within their bounds. Where build tolerance absorbs part of an effect, the
fit without it ends with some of them at their bounds, and the effect releases these: its gain is
that of the bounded problem. Onsets, segments and features are found among many by the quicker
projection, in which a parameter at its bound stays there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.bounded_quadratic import bounded_maxima
from adk_ros.numerics.levenberg_marquardt import huber_root

_RIDGE = 1e-9
"""Relative precision added to each column of the bounded problem: equal columns share a size."""
_UNBOUNDED = 1e9
"""Bound, in columns of unit length, of what has none."""


@dataclass(frozen=True)
class Candidate:
    """An effect at the values to start its fit from, and its linearised gain in loss."""

    active: ActiveEffect
    gain: float


class LinearisedProblem:
    """
    The least-squares problem linearised at a hypothesis.

    `jacobian` (m, nuisances) as `Likelihood.nuisance_jacobian` returns it.
    """

    def __init__(
        self, likelihood: Likelihood, hypothesis: Hypothesis, jacobian: FloatArray
    ) -> None:
        self.likelihood = likelihood
        self.hypothesis = hypothesis
        self.e = likelihood.residuals(hypothesis.nuisances, hypothesis.effects)
        self.root = huber_root(self.e)
        at = np.concatenate(
            [hypothesis.nuisances, np.zeros(sum(len(x.theta) for x in hypothesis.effects))]
        )
        nuisances = hypothesis.nuisances.shape[0]
        fitted = [jacobian]
        for i, active in enumerate(hypothesis.effects):
            for j in range(len(active.theta)):
                fitted.append(self._parameter_column(i, j)[:, None])
        columns = np.concatenate(fitted, axis=1) * self.root[:, None]
        prior = np.zeros(columns.shape[1])
        prior[:nuisances] = 1.0 / likelihood.nuisance_deviations()
        limits = np.full(columns.shape[1], np.inf)
        limits[:nuisances] = likelihood.nuisance_bounds()
        # The prior counts as more rows.
        stacked = np.concatenate([columns, np.diag(prior)])
        scale = np.maximum(np.sqrt((stacked**2).sum(axis=0)), 1e-12)
        self._all_columns = columns / scale
        self._normal = (stacked / scale).T @ (stacked / scale)
        self._limits = np.minimum(limits * scale, _UNBOUNDED)
        # What the residuals are at nuisance parameters of zero, to first order.
        self._unfitted = self.e * self.root - self._all_columns @ (at * scale)
        self._least_gain = self._bounded(np.empty((columns.shape[0], 0)))[1]
        free = np.abs(at) < limits - 1e-9
        self._columns = self._all_columns[:, free]
        self._inverse = np.linalg.pinv(
            self._normal[np.ix_(free, free)], rcond=1e-9, hermitian=True
        )
        self.projected = self.project_out(self.e * self.root)

    def _parameter_column(self, i: int, j: int) -> FloatArray:
        active = self.hypothesis.effects[i]
        step = active.effect.parameters[j].step
        theta = list(active.theta)
        theta[j] += step
        effects = list(self.hypothesis.effects)
        effects[i] = ActiveEffect(active.effect, tuple(theta), active.activation)
        changed = self.likelihood.residuals(self.hypothesis.nuisances, effects)
        return np.asarray((changed - self.e) / step)

    def project_out(self, rows: FloatArray) -> FloatArray:
        """Return rows (m,) or (m, k) less their part that the fitted parameters can explain."""
        return np.asarray(rows - self._columns @ (self._inverse @ (self._columns.T @ rows)))

    def column(self, active: ActiveEffect) -> FloatArray:
        """Return the change (m,) of the Huber-weighted residuals by one more effect."""
        effects = [*self.hypothesis.effects, active]
        changed = self.likelihood.residuals(self.hypothesis.nuisances, effects)
        return np.asarray((changed - self.e) * self.root)

    def screen_effect(
        self, effect: Effect, activation: Activation = ALWAYS_ACTIVE
    ) -> list[Candidate]:
        """Return the effect at each of its start values, largest gain first."""
        candidates = []
        neutral = [p.theta_neutral for p in effect.parameters]
        first = effect.parameters[0]
        starts = [first.theta(start) for start in first.starts]
        for start in starts or [first.theta_neutral + first.step]:
            columns, steps = [], []
            for j, parameter in enumerate(effect.parameters):
                theta = list(neutral)
                theta[j] = start if j == 0 else parameter.theta_neutral + parameter.step
                columns.append(self.column(ActiveEffect(effect, tuple(theta), activation)))
                steps.append(theta[j] - parameter.theta_neutral)
            size, gain = self.solve(np.column_stack(columns))
            theta = [
                float(np.clip(p.theta_neutral + s * d, *p.bounds()))
                for p, s, d in zip(effect.parameters, size, steps, strict=True)
            ]
            if starts and size[0] <= 0.0:
                gain = 0.0
            elif starts:
                # The value at which the secant was taken; far from linear, the solution is not.
                theta[0] = start
            candidates.append(Candidate(ActiveEffect(effect, tuple(theta), activation), gain))
        return sorted(candidates, key=lambda x: -x.gain)

    def solve(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """
        Return the least-squares sizes (k,) of `columns` (m, k), and the gain in loss.

        The nuisance parameters are fitted again, within their bounds.
        """
        sizes, gain = self._bounded(columns)
        return sizes, max(gain - self._least_gain, 0.0)

    def _bounded(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return the sizes (k,) of more columns (m, k), and the loss that all removes."""
        scale = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-9))
        more = columns / scale
        cross = self._all_columns.T @ more
        information = np.block([[self._normal, cross], [cross.T, more.T @ more]])
        information[np.diag_indices_from(information)] += _RIDGE
        score = -np.concatenate([self._all_columns.T @ self._unfitted, more.T @ self._unfitted])
        bounds = np.concatenate([self._limits, np.full(scale.shape[0], _UNBOUNDED)])
        x = bounded_maxima(information[None], score[None], bounds)[0]
        gain = float(2.0 * score @ x - x @ information @ x)
        return np.asarray(x[self._limits.shape[0] :] / scale), gain
