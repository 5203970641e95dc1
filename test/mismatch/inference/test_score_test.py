# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The linearised gain of an effect next to nuisance parameters within bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.numerics.arrays import FloatArray

ROWS, NUISANCES = 400, 4


class Linear(Likelihood):
    """Residuals that are linear in nuisance parameters and in the size of an effect."""

    def __init__(self, bound: float, absorbed: float) -> None:
        """`absorbed`: share of the effect that the first nuisance parameters imitate."""
        rng = np.random.default_rng(3)
        self.jacobian = 2.0 * rng.normal(size=(ROWS, NUISANCES))
        alike = self.jacobian[:, :2].sum(axis=1) / 2.0
        self.effect = absorbed * alike + (1.0 - absorbed) * 2.0 * rng.normal(size=ROWS)
        self.start = rng.normal(size=ROWS) - 0.6 * self.effect
        self.bound = bound

    def residuals(self, nuisances: FloatArray, effects: Sequence[ActiveEffect]) -> FloatArray:
        size = sum(active.theta[0] for active in effects)
        return np.asarray(self.start + self.jacobian @ nuisances + size * self.effect)

    def nuisance_deviations(self) -> FloatArray:
        return np.full(NUISANCES, 0.5)

    def nuisance_bounds(self) -> FloatArray:
        return np.full(NUISANCES, self.bound)

    def least_loss(self, *columns: FloatArray) -> tuple[FloatArray, float]:
        """The exact minimum with the columns added, by SciPy."""
        rows = np.column_stack([self.jacobian, *columns])
        prior = np.zeros((NUISANCES, rows.shape[1]))
        prior[:, :NUISANCES] = 2.0 * np.eye(NUISANCES)
        limits = np.append(np.full(NUISANCES, self.bound), np.full(len(columns), np.inf))
        right = -np.concatenate([self.start, np.zeros(NUISANCES)])
        found = lsq_linear(np.vstack([rows, prior]), right, (-limits, limits), tol=1e-14)
        return np.asarray(found.x), float(2.0 * found.cost)


def gained(bound: float, absorbed: float) -> tuple[float, float, float, float]:
    """Size and gain of the effect, by the linearised problem and exactly."""
    likelihood = Linear(bound, absorbed)
    at, before = likelihood.least_loss()
    null = Hypothesis((), at[:NUISANCES], before)
    linearised = LinearisedProblem(likelihood, null, likelihood.jacobian)
    size, gain = linearised.solve(likelihood.effect[:, None])
    exact, after = likelihood.least_loss(likelihood.effect)
    return float(size[0]), gain, float(exact[-1]), before - after


@pytest.mark.parametrize(("bound", "absorbed"), [(9.0, 0.5), (0.2, 0.5), (0.25, 0.9), (0.1, 0.97)])
def test_the_gain_is_that_of_the_bounded_problem(bound: float, absorbed: float) -> None:
    size, gain, exact_size, exact_gain = gained(bound, absorbed)
    assert size == pytest.approx(exact_size, rel=1e-4)
    assert gain == pytest.approx(exact_gain, rel=1e-4, abs=1e-6)


def test_an_effect_releases_the_tolerances_that_imitate_it() -> None:
    """Kept at their bounds, they hide much of its gain."""
    likelihood = Linear(0.25, 0.97)
    at, before = likelihood.least_loss()
    null = Hypothesis((), at, before)
    assert np.count_nonzero(np.abs(at) > 0.2499) == 2
    linearised = LinearisedProblem(likelihood, null, likelihood.jacobian)
    column = linearised.project_out(likelihood.effect)
    kept = float((column @ linearised.projected) ** 2 / (column @ column))
    _, gain = linearised.solve(likelihood.effect[:, None])
    assert gain > 1.2 * kept


def test_an_effect_without_influence_gains_nothing() -> None:
    likelihood = Linear(0.2, 0.5)
    at, before = likelihood.least_loss()
    linearised = LinearisedProblem(likelihood, Hypothesis((), at, before), likelihood.jacobian)
    size, gain = linearised.solve(np.zeros((ROWS, 1)))
    assert (size[0], gain) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_screening_starts_a_fit_from_the_size() -> None:
    likelihood = Linear(0.2, 0.3)
    at, before = likelihood.least_loss()
    linearised = LinearisedProblem(likelihood, Hypothesis((), at, before), likelihood.jacobian)
    (found,) = linearised.screen_effect(EFFECTS["aero_drag"])
    assert found.active.theta[0] == pytest.approx(likelihood.least_loss(likelihood.effect)[0][-1])
