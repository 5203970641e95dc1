# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Score test: the gain of an effect from the linearised problem, without a fit.

With e the residuals of a fitted hypothesis, K their derivatives with respect to the fitted
parameters (with their prior) and S those with respect to an effect's variables, the gain of adding
the effect is that of the linear least-squares problem in both (Rao's score test). The derivatives
are secants, one for each start value of the effect, since delays and friction are far from linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_root


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
        # A nuisance parameter at its bound cannot move, whatever the linear problem says.
        free = np.abs(hypothesis.nuisances) < likelihood.nuisance_bounds() - 1e-9
        fitted = [jacobian[:, free]]
        for i, active in enumerate(hypothesis.effects):
            for j in range(len(active.theta)):
                fitted.append(self._parameter_column(i, j)[:, None])
        columns = np.concatenate(fitted, axis=1) * self.root[:, None]
        prior = np.zeros(columns.shape[1])
        prior[: int(free.sum())] = 1.0 / likelihood.nuisance_deviations()[free]
        # Projection onto the complement of the fitted parameters; the prior counts as more rows.
        stacked = np.concatenate([columns, np.diag(prior)])
        scale = np.maximum(np.sqrt((stacked**2).sum(axis=0)), 1e-12)
        self._columns = columns / scale
        normal = (stacked / scale).T @ (stacked / scale)
        self._inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
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
        """Return the least-squares sizes (k,) of `columns` (m, k), and the gain in loss."""
        free = self.project_out(columns)
        normal = free.T @ free
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-9))
        right = -(free.T @ self.projected) / scale
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-7, hermitian=True)
        solved = inverse @ right
        return np.asarray(solved / scale), float(right @ solved)
