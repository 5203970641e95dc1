# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Detectable sizes: the smallest effect that the analysis would accept after so much driving.

The likelihood is linearised at the null hypothesis on a drive. With c the change of the whitened
residuals by an effect, K their derivatives with respect to the nuisance parameters t, P the prior
variances and t_max the bounds of these, and n repetitions of the drive, the gain of the effect
follows a non-central chi-square distribution with non-centrality

    lambda = min n |c + K t|^2 + t' P^-1 t  over  |t| <= t_max,

the loss that the effect leaves if it is not in the model. Noise alone lets it grow with n. Build
tolerance absorbs an effect that resembles it, up to its bounds. The surrogate's own error repeats:
it counts as noise in the whitening, and the gain that it demands grows with n as lambda does. An
effect counts as detectable if it is accepted with a probability of `POWER`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, lsq_linear
from scipy.special import ndtri
from scipy.stats import ncx2

from adk_ros.mismatch.inference.block_scores import BLOCK_S
from adk_ros.mismatch.inference.forward_selection import examined_count
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    min_required_gain,
    penalised_loss,
)
from adk_ros.mismatch.inference.significance import critical_value
from adk_ros.mismatch.library.criteria import HELD_OUT_SHARE
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import FloatArray

POWER = 0.8
"""Probability of acceptance at the detectable size. Convention of power analysis (J. Cohen)."""
NOISE, TOLERANCE, SURROGATE = "sensor noise", "build tolerance", "surrogate error"
MATERIALITY = "materiality threshold"


@dataclass(frozen=True)
class NoiseModel:
    """A likelihood with a choice of nuisance parameters: what limits a size besides noise."""

    likelihood: Likelihood
    jacobian: FloatArray
    """(m, k) whitened derivatives with respect to the nuisance parameters that are free."""
    prior: FloatArray
    """(k,) prior standard deviations."""
    bounds: FloatArray
    """(k,) hard bounds: beyond them a nuisance parameter absorbs no more of an effect."""

    @cached_property
    def gram(self) -> FloatArray:
        """Products (k, k) of the derivatives."""
        return np.asarray(self.jacobian.T @ self.jacobian)

    def whitened(self, change: FloatArray, distances: FloatArray) -> FloatArray:
        """Return a change of the residuals (6, bins), and of the distances, as one vector (m,)."""
        return np.concatenate([self.likelihood.whiten(change).ravel(), distances])

    def non_centrality(self, column: FloatArray, repetitions: float) -> float:
        """Return the loss that an effect with this change (m,) of the residuals leaves."""
        loss = repetitions * float(column @ column)
        if not self.prior.size:
            return loss
        cross = repetitions * (self.jacobian.T @ column)
        normal = repetitions * self.gram + np.diag(self.prior**-2.0)
        fitted = -np.linalg.solve(normal, cross)
        if np.any(np.abs(fitted) > self.bounds):
            root = np.linalg.cholesky(normal).T
            right = -np.linalg.solve(root.T, cross)
            fitted = lsq_linear(root, right, (-self.bounds, self.bounds)).x
        return loss + float(2.0 * cross @ fitted + fitted @ normal @ fitted)


@dataclass(frozen=True)
class Drive:
    """
    A drive with noise models: with all contributions, and with noise and one other or none.

    `duration_s` of the drive that counts; `lap` of its route, if there is one.
    """

    full: NoiseModel
    partial: Mapping[str, NoiseModel]
    base: FloatArray
    """(6, bins) residuals of the null hypothesis."""
    base_distances: FloatArray
    duration_s: float
    lap: Lap | None = None

    @classmethod
    def of(cls, likelihood: Likelihood, lap: Lap | None = None) -> Drive:
        """Return a drive from the likelihood of its recording."""
        count = likelihood.n_nuisances
        zero = np.zeros(count)
        base, base_distances = _raw_residuals(likelihood, zero, ())
        steps = likelihood.nuisance_steps()
        changes = []
        for j in range(count):
            moved = zero.copy()
            moved[j] = steps[j]
            residuals, distances = _raw_residuals(likelihood, moved, ())
            changes.append(
                ((residuals - base) / steps[j], (distances - base_distances) / steps[j])
            )
        white = np.zeros_like(likelihood.filters)
        white[:, 0] = 1.0
        noise_only = replace(
            likelihood,
            filters=white,
            surrogate_error_share=np.zeros_like(likelihood.surrogate_error_share),
        )
        deviations, bounds = likelihood.nuisance_deviations(), likelihood.nuisance_bounds()

        def model(of: Likelihood, free: slice) -> NoiseModel:
            empty = NoiseModel(of, np.empty((0, 0)), np.empty(0), np.empty(0))
            columns = [empty.whitened(*change) for change in changes[free]]
            if not columns:
                return empty
            return NoiseModel(of, np.column_stack(columns), deviations[free], bounds[free])

        partial = {
            NOISE: model(noise_only, slice(0, 0)),
            TOLERANCE: model(noise_only, slice(0, N_FIXED_NUISANCES)),
            SURROGATE: model(likelihood, slice(N_FIXED_NUISANCES, count)),
        }
        problem = likelihood.problem
        duration = float(problem.bin_s[-1] - problem.start_s)
        full = model(likelihood, slice(0, count))
        return cls(full, partial, base, base_distances, duration, lap)

    def columns(self, models: list[NoiseModel], active: ActiveEffect) -> list[FloatArray]:
        """Return the change (m,) of the whitened residuals by an effect, for each noise model."""
        likelihood = self.full.likelihood
        zero = np.zeros(likelihood.n_nuisances)
        residuals, distances = _raw_residuals(likelihood, zero, (active,))
        change = (residuals - self.base, distances - self.base_distances)
        return [model.whitened(*change) for model in models]

    def repetitions(self, minutes: float) -> float:
        """Return how often a recording of `minutes` repeats the drive before the held-out part."""
        return 60.0 * minutes * (1.0 - HELD_OUT_SHARE) / self.duration_s

    def required_non_centrality(
        self, model: NoiseModel, active: ActiveEffect, minutes: float
    ) -> float:
        """
        Return the non-centrality with which an effect is accepted with probability `POWER`.

        It must gain the penalised gain of the selection, and exceed the familywise critical value
        of Student's t over the blocks of the recording.
        """
        repetitions = self.repetitions(minutes)
        null = Hypothesis((), np.zeros(0), 0.0)
        path = SelectionPath()
        path.surrogate_error_dof = repetitions * model.likelihood.surrogate_error_dof()
        penalty = penalised_loss(Hypothesis((active,), np.zeros(0), 0.0))
        count = len(active.theta)
        gain = _required(min_required_gain(null, path) + penalty, count)
        blocks = max(int(60.0 * minutes * (1.0 - HELD_OUT_SHARE) / BLOCK_S), 2)
        tests = examined_count(model.likelihood, self.lap) * max(repetitions, 1.0) * count
        critical = critical_value(blocks, int(tests)) + float(ndtri(POWER))
        return max(gain, critical**2)

    def is_detectable(self, active: ActiveEffect, minutes: float) -> bool:
        """Whether an effect of this size is accepted after `minutes` of such driving."""
        column = self.columns([self.full], active)[0]
        reached = self.full.non_centrality(column, self.repetitions(minutes))
        required = self.required_non_centrality(self.full, active, minutes)
        return reached >= required and active.is_material()


def _required(gain: float, parameters: int) -> float:
    """Return the non-centrality with which a chi-square variate exceeds `gain` by `POWER`."""

    def excess(root: float) -> float:
        return float(ncx2.sf(gain, parameters, root**2)) - POWER

    # The root of a non-central chi-square variate is about normal with unit variance.
    return float(brentq(excess, 1e-3, np.sqrt(gain) + 5.0)) ** 2


def _raw_residuals(
    likelihood: Likelihood, nuisances: FloatArray, effects: tuple[ActiveEffect, ...]
) -> tuple[FloatArray, FloatArray]:
    p, terms = likelihood.simulation_inputs(nuisances, effects)
    problem = likelihood.problem
    return problem.residuals(p, terms), problem.distance_residuals(p)
