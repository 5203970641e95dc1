# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A block of a drive: its residuals under the surrogate model, linearised in everything.

The whitened residuals e of a block are linearised in the columns X of `candidate_columns`. Grade
and bank of the road, which no model knows, are random in each block, Gaussian with precision P,
and integrated out: with Z their columns, all products are those with

    M = I - Z (Z'Z + P)^-1 Z'.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import MIN_ROAD_COVERAGE
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import (
    DISTANCE_INTERVAL_S,
    ResidualProblem,
    prepare_residual_problem,
)
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.watch.candidate_columns import ColumnLayout
from adk_ros.mismatch.watch.settings import (
    BANK_SIGMA,
    GRADE_SIGMA,
    MIN_MEASURED_SHARE,
    ROAD_KNOT_S,
)
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import huber_root

_ROAD = (("grade", GRADE_SIGMA), ("bank", BANK_SIGMA))


@dataclass(frozen=True)
class Block:
    """
    A linearised block from `begin_s` to `end_s`.

    `rows` (m,) of the likelihood's residuals; `residuals` (m,); `columns` (m, c); `road` (m, z),
    scaled to unit prior variance; `base`: effects that the car has had before.
    """

    begin_s: float
    end_s: float
    likelihood: Likelihood
    rows: IntArray
    residuals: FloatArray
    columns: FloatArray
    road: FloatArray
    base: tuple[ActiveEffect, ...] = ()

    def with_effect(self, active: ActiveEffect) -> FloatArray:
        """Return the residuals (m,) with one more effect."""
        nuisances = np.zeros(self.likelihood.n_nuisances)
        return self.likelihood.residuals(nuisances, (*self.base, active))[self.rows]

    def weighed(self, weights: FloatArray, rows: FloatArray) -> FloatArray:
        """Return W M W rows, with W the diagonal of `weights` (m,) and rows (m,) or (m, k)."""
        road = self.road * weights[:, None]
        scaled = (rows.T * weights).T
        inner = road.T @ road + np.eye(road.shape[1])
        left = scaled - road @ np.linalg.solve(inner, road.T @ scaled)
        return np.asarray((left.T * weights).T)

    def gram(self, weights: FloatArray) -> FloatArray:
        """Return the products (1 + c, 1 + c) of the residuals and all columns."""
        every = np.column_stack([self.residuals, self.columns])
        return np.asarray(every.T @ self.weighed(weights, every))


class BlockLineariser:
    """
    Linearises blocks of one drive at a surrogate model.

    `sigma` (6,): noise of a sample; `base`: effects that the car has had since an earlier change.
    """

    def __init__(
        self,
        surrogate: SurrogateModel,
        sigma: FloatArray,
        layout: ColumnLayout,
        base: tuple[ActiveEffect, ...] = (),
    ) -> None:
        self._surrogate, self._sigma, self._layout = surrogate, sigma, layout
        self.base = base
        self._filters: tuple[FloatArray, FloatArray] | None = None

    def block(self, log: SensorLog, begin_s: float, end_s: float) -> Block | None:
        """Return the block of a stretch of the drive, or None if it has too little data."""
        problem = prepare_residual_problem(log, self._sigma)
        likelihood = self._likelihood(problem)
        bins = (problem.bin_s >= begin_s) & (problem.bin_s < end_s)
        counted = (likelihood.weights > 0.0) & bins
        if np.count_nonzero(counted) < MIN_MEASURED_SHARE * counted.shape[0] * bins.sum():
            return None
        nuisances = np.zeros(likelihood.n_nuisances)
        base = likelihood.residuals(nuisances, self.base)
        n_bins = counted.size
        starts = problem.start_s + DISTANCE_INTERVAL_S * np.arange(base.shape[0] - n_bins)
        within = (starts >= begin_s) & (starts + DISTANCE_INTERVAL_S <= end_s)
        rows = np.flatnonzero(np.concatenate([counted.ravel(), within]))
        residuals = base[rows]
        columns = np.empty((rows.size, self._layout.count))
        for j, step in enumerate(likelihood.nuisance_steps()):
            moved = nuisances.copy()
            moved[j] = step
            columns[:, j] = (likelihood.residuals(moved, self.base)[rows] - residuals) / step
        for j, column in enumerate(self._layout.effects, start=self._layout.n_nuisances):
            changed = likelihood.residuals(nuisances, (*self.base, column.active))[rows]
            columns[:, j] = (changed - residuals) * column.scale
        road = self._road_columns(likelihood, rows, residuals)
        return Block(begin_s, end_s, likelihood, rows, residuals, columns, road, self.base)

    def _likelihood(self, problem: ResidualProblem) -> Likelihood:
        surrogate = self._surrogate
        if surrogate.road is not None and (
            surrogate.road.covered_share(problem) < MIN_ROAD_COVERAGE
        ):
            surrogate = replace(surrogate, road=None)
        likelihood = Likelihood.of(problem, surrogate)
        if self._filters is None:
            self._filters = likelihood.filters, likelihood.surrogate_error_share
        filters, shares = self._filters
        return replace(likelihood, filters=filters, surrogate_error_share=shares)

    def _road_columns(
        self, likelihood: Likelihood, rows: IntArray, residuals: FloatArray
    ) -> FloatArray:
        """Return the change (m, z) of the residuals by each knot of grade and bank."""
        problem = likelihood.problem
        begin = problem.middle_s[0]
        count = int(np.ceil((problem.middle_s[-1] - begin) / ROAD_KNOT_S)) + 1
        nuisances = np.zeros(likelihood.n_nuisances)
        p, fixed = likelihood.simulation_inputs(nuisances, self.base)
        out = []
        for name, sigma in _ROAD:
            for knot in range(count):
                distance = (problem.middle_s - begin) / ROAD_KNOT_S - knot
                hat = np.maximum(1.0 - np.abs(distance), 0.0)
                term = ActiveTerms(
                    np.array([INDEX[name]]),
                    np.array([sigma]),
                    np.array([1]),
                    np.vstack([np.ones(problem.steps), hat]),
                )
                terms = fixed.merged_with(term)
                changed = likelihood.whiten(likelihood.channel_residuals(p, terms)).ravel()
                inside = rows < changed.size
                column = np.zeros(rows.size)
                column[inside] = changed[rows[inside]] - residuals[inside]
                out.append(column)
        return np.column_stack(out)


def robust_weights(residuals: FloatArray) -> FloatArray:
    """Return the root of Huber's weights (m,) of predicted residuals."""
    return huber_root(residuals)
