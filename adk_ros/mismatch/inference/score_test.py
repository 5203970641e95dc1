# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What an effect would gain, without fitting it: by the residuals' derivatives.

With e the residuals of a fit, K their derivatives with respect to the tolerances (with their
prior) and S those with respect to an effect's variables, the gain of adding the effect is that of
the linear least-squares problem in both. Derivatives are secants, one for each size that the
effect is worth starting from, since delays and friction are far from linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_root


@dataclass(frozen=True)
class Candidate:
    """An effect with the size to start its fit from, and what it would gain."""

    active: ActiveEffect
    gain: float


class LinearisedProblem:
    """The linear problem at a hypothesis; `columns` as `Likelihood.tolerance_columns`."""

    def __init__(self, likelihood: Likelihood, at: Hypothesis, columns: FloatArray) -> None:
        self.likelihood = likelihood
        self.at = at
        self.e = likelihood.residuals(at.tolerances, at.actives)
        self.root = huber_root(self.e)
        # What has stopped at its bound takes no more, however the linear problem would have it.
        free = np.abs(at.tolerances) < likelihood.nuisance_bounds() - 1e-9
        fitted = [columns[:, free]]
        for i, active in enumerate(at.actives):
            for j in range(len(active.theta)):
                fitted.append(self._parameter_column(i, j)[:, None])
        known = np.concatenate(fitted, axis=1) * self.root[:, None]
        prior = np.zeros(known.shape[1])
        prior[: int(free.sum())] = 1.0 / likelihood.nuisance_deviations()[free]
        # Orthogonal to what is fitted already, the prior counted as further rows.
        stacked = np.concatenate([known, np.diag(prior)])
        scale = np.maximum(np.sqrt((stacked**2).sum(axis=0)), 1e-12)
        self._known = known / scale
        normal = (stacked / scale).T @ (stacked / scale)
        self._inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
        self.left = self.project_out(self.e * self.root)

    def _parameter_column(self, i: int, j: int) -> FloatArray:
        active = self.at.actives[i]
        step = active.effect.parameters[j].step
        inner = list(active.theta)
        inner[j] += step
        actives = list(self.at.actives)
        actives[i] = ActiveEffect(active.effect, tuple(inner), active.activation)
        changed = self.likelihood.residuals(self.at.tolerances, actives)
        return np.asarray((changed - self.e) / step)

    def project_out(self, rows: FloatArray) -> FloatArray:
        """Return rows (m,) or (m, k) less what the fitted variables can take of them."""
        return np.asarray(rows - self._known @ (self._inverse @ (self._known.T @ rows)))

    def column(self, active: ActiveEffect) -> FloatArray:
        """Return what adding `active` changes in the residuals (m,), Huber-weighted."""
        changed = self.likelihood.residuals(self.at.tolerances, [*self.at.actives, active])
        return np.asarray((changed - self.e) * self.root)

    def screen_effect(self, effect: Effect, gate: Activation = ALWAYS_ACTIVE) -> list[Candidate]:
        """Return the effect at the sizes worth starting from, best first."""
        found = []
        neutral = [p.theta_neutral for p in effect.parameters]
        first = effect.parameters[0]
        starts = [first.theta(start) for start in first.starts]
        for start in starts or [first.theta_neutral + first.step]:
            columns, steps = [], []
            for j, parameter in enumerate(effect.parameters):
                inner = list(neutral)
                inner[j] = start if j == 0 else parameter.theta_neutral + parameter.step
                columns.append(self.column(ActiveEffect(effect, tuple(inner), gate)))
                steps.append(inner[j] - parameter.theta_neutral)
            size, gain = self.solve(np.column_stack(columns))
            inner = [
                float(np.clip(p.theta_neutral + s * d, *p.bounds()))
                for p, s, d in zip(effect.parameters, size, steps, strict=True)
            ]
            if starts and size[0] <= 0.0:
                gain = 0.0
            elif starts:
                # Where the secant was taken, not where it leads to.
                inner[0] = start
            found.append(Candidate(ActiveEffect(effect, tuple(inner), gate), gain))
        return sorted(found, key=lambda x: -x.gain)

    def solve(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return the sizes (k,) of `columns` (m, k) that explain most, and the gain."""
        free = self.project_out(columns)
        normal = free.T @ free
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-9))
        right = -(free.T @ self.left) / scale
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-7, hermitian=True)
        solved = inverse @ right
        return np.asarray(solved / scale), float(right @ solved)
