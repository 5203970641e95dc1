# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Screening of the features of a drive, plain ones and those with searched parameters."""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.mismatch.inference.feature_effect import active_feature, state_equations
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.inference.parametric_search import ParametricSearch
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.library.criteria import PENALTY_PER_LOCATION
from adk_ros.mismatch.library.features import FEATURES, feature_matrix
from adk_ros.mismatch.library.parametric_features import searched_parameters
from adk_ros.mismatch.library.search_limits import MAX_PARAMETRIC_SCREENED
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS, feature_signals
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class FeatureScreening:
    """The observable features along a recording: `table` (n, k) of `names`."""

    names: list[str]
    equations: list[str]
    table: FloatArray
    search: ParametricSearch | None

    @classmethod
    def of(
        cls, likelihood: Likelihood, hypothesis: Hypothesis, parametric: bool
    ) -> FeatureScreening:
        """Return the screening at a hypothesis; `parametric`: also of searched features."""
        problem = likelihood.problem
        p, terms = likelihood.simulation_inputs(hypothesis.nuisances, hypothesis.effects)
        signals = feature_signals(problem, problem.run(p, terms))
        names = [name for name in FEATURES if name not in likelihood.unobservable]
        equations = [
            name
            for name in EQUATION_PARAMETERS
            if likelihood.unobservable.isdisjoint(state_equations(name))
        ]
        search = ParametricSearch(signals, equations, names) if parametric else None
        return cls(names, equations, feature_matrix(names, signals), search)

    def candidates(self, linearised: LinearisedProblem) -> list[Candidate]:
        """
        Return features that the hypothesis does not have: every plain one, the best searched ones.

        Gains are less the penalty for searched parameters.
        """
        wanted = [
            (equation, name, self.table[:, j])
            for equation in self.equations
            for j, name in enumerate(self.names)
        ]
        if self.search is not None:
            found = self.search.best(LinearResponse.of(linearised), MAX_PARAMETRIC_SCREENED)
            wanted += [(x.equation, x.name, self.search.values(x.name)) for x in found]
        out = []
        for equation, name, values in wanted:
            active = active_feature(equation, name, values)
            if active.effect.name not in linearised.hypothesis.names:
                exact = linearised.screen_effect(active.effect, active.activation)[0]
                penalty = PENALTY_PER_LOCATION * searched_parameters(name)
                out.append(Candidate(exact.active, exact.gain - penalty))
        return out
