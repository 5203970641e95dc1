# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Unmodelled dynamics: which equation lacks a term, and on which features of the drive it depends.

Features (see `library.features`) with a coefficient are added to the accelerations of the three
equations, one after the other, while each gains enough. Nuisance parameters and identified effects
are fitted jointly. The result is a short expression, which also corrects the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.feature_effect import (
    EQUATION_TEXTS,
    EQUATION_UNITS,
    FeatureEffect,
    feature_as_effect,
    feature_terms,
)
from adk_ros.mismatch.inference.fit_budget import FEATURE, FEATURE_REFIT
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.result import UnexplainedResidual
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.library.criteria import (
    EQUATION_GAIN_SHARE,
    FEATURE_MIN_GAIN,
    FEATURE_MIN_GAIN_PER_EXCESS,
    FEATURE_REFIT_GAIN_SHARE,
    FEATURE_RESIDUAL_SHARE,
    FEATURE_TIE_LOSS,
    FEATURE_TIE_LOSS_PER_SURROGATE_ERROR,
    MAX_FEATURE_REFITS,
    MAX_FEATURES,
    MAX_FEATURES_FITTED,
    MIN_GAIN_PER_SURROGATE_ERROR,
    MIN_SCREENED_GAIN_FEATURE,
)
from adk_ros.mismatch.library.features import FEATURES, feature, feature_matrix
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import (
    EQUATION_PARAMETERS,
    FeatureTerm,
    feature_signals,
)
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class UnmodelledDynamics:
    """An expression for the excess loss; `share` is that of the excess loss before any effect."""

    share: float
    terms: tuple[FeatureTerm, ...]
    hypothesis: Hypothesis

    @property
    def equations(self) -> list[str]:
        """Equations with a missing term, largest gain first."""
        gains: dict[str, float] = {}
        for term in self.terms:
            gains[term.equation] = gains.get(term.equation, 0.0) + term.gain
        top = max(gains.values(), default=0.0)
        order = sorted(gains, key=lambda name: -gains[name])
        return [name for name in order if gains[name] > EQUATION_GAIN_SHARE * top]

    def text(self) -> str:
        """Return which acceleration depends on which feature, in words."""
        if not self.terms:
            return "a structured residual that depends on none of the examined features"
        return "; ".join(
            f"{EQUATION_TEXTS[p.equation]} against {feature(p.feature).description}"
            for p in self.terms
        )

    def expression(self) -> str:
        """Return the expression with its units."""
        parts = []
        for equation in self.equations:
            terms = [
                f"{p.coefficient:+.4g} {feature(p.feature).expression}"
                for p in self.terms
                if p.equation == equation
            ]
            parts.append(f"d({equation})/dt += {' '.join(terms)} [{EQUATION_UNITS[equation]}]")
        return "; ".join(parts)

    def refitted(self, hypothesis: Hypothesis) -> UnmodelledDynamics:
        """Return the expression with the coefficients of a later fit of the same features."""
        fitted = feature_terms(hypothesis.effects)
        gains = {(term.equation, term.feature): term.gain for term in self.terms}
        terms = tuple(replace(x, gain=gains[x.equation, x.feature]) for x in fitted)
        return replace(self, terms=terms, hypothesis=hypothesis)

    def unexplained(self) -> UnexplainedResidual:
        """Return the part of the result that describes it."""
        return UnexplainedResidual(
            self.equations, round(self.share, 3), self.text(), self.expression(), self.terms
        )


def fit_feature_expansion(
    likelihood: Likelihood, start: Hypothesis, expected_loss: float, null_excess_loss: float
) -> UnmodelledDynamics:
    """Describe the excess loss of `start` by as few features as possible."""
    library = _FeatureLibrary.of(likelihood, start)
    jacobian = likelihood.nuisance_jacobian(start)
    current = start
    excess = max(start.loss - expected_loss, 0.0)
    least = max(
        FEATURE_MIN_GAIN + MIN_GAIN_PER_SURROGATE_ERROR * likelihood.surrogate_error_dof(),
        FEATURE_MIN_GAIN_PER_EXCESS * excess,
    )
    gains: list[float] = []
    for _ in range(MAX_FEATURES):
        linearised = LinearisedProblem(likelihood, current, jacobian)
        extended = _best_extension(linearised, library.screen(linearised), jacobian, least)
        if extended is None:
            break
        gains.append(current.loss - extended.loss)
        current = extended
        if current.loss - expected_loss < FEATURE_RESIDUAL_SHARE * excess:
            break
    terms = tuple(
        replace(term, gain=gain)
        for term, gain in zip(feature_terms(current.effects), gains, strict=True)
    )
    share = excess / null_excess_loss if null_excess_loss > 0.0 else 0.0
    return UnmodelledDynamics(share, terms, current)


@dataclass(frozen=True)
class _FeatureLibrary:
    """The observable features along a recording: `table` (n, k) of `names`, RMS `scale` (k,)."""

    names: list[str]
    equations: list[str]
    table: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, likelihood: Likelihood, hypothesis: Hypothesis) -> _FeatureLibrary:
        problem = likelihood.problem
        p, terms = likelihood.simulation_inputs(hypothesis.nuisances, hypothesis.effects)
        signals = feature_signals(problem, problem.run(p, terms))
        names = [name for name in FEATURES if name not in likelihood.unobservable]
        table = feature_matrix(names, signals)
        scale = np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-12)
        equations = [name for name in EQUATION_PARAMETERS if name not in likelihood.unobservable]
        return cls(names, equations, table, scale)

    def screen(self, linearised: LinearisedProblem) -> list[Candidate]:
        """Return every feature in every equation that the hypothesis does not have."""
        out = []
        for equation in self.equations:
            for j, name in enumerate(self.names):
                weight = np.ascontiguousarray(self.table[:, j] / self.scale[j])
                effect = feature_as_effect(equation, name, float(self.scale[j]))
                if effect.name not in linearised.hypothesis.names:
                    out.append(linearised.screen_effect(effect, Activation(weight=weight))[0])
        return out


def _best_extension(
    linearised: LinearisedProblem,
    candidates: list[Candidate],
    jacobian: FloatArray,
    least: float,
) -> Hypothesis | None:
    """
    Return the hypothesis with the best further feature, or None where none gains `least`.

    A linearised gain is inaccurate where much is unexplained: the best few are fitted, and the
    leaders once more with updated nuisance derivatives. Among those tied with the best, within
    statistical margin and surrogate error, the shortest expression wins.
    """
    likelihood, current = linearised.likelihood, linearised.hypothesis
    candidates.sort(key=lambda x: -x.gain)
    fitted = [
        likelihood.fit(
            [*current.effects, candidate.active],
            nuisances=current.nuisances,
            budget=FEATURE,
            jacobian=jacobian,
        )
        for candidate in candidates[:MAX_FEATURES_FITTED]
        if candidate.gain > max(least, MIN_SCREENED_GAIN_FEATURE * candidates[0].gain)
    ]
    top = max((current.loss - h.loss for h in fitted), default=0.0)
    if top < least:
        return None
    leaders = sorted(
        (h for h in fitted if current.loss - h.loss > FEATURE_REFIT_GAIN_SHARE * top),
        key=lambda h: h.loss,
    )
    refitted = [
        likelihood.fit(h.effects, nuisances=h.nuisances, budget=FEATURE_REFIT)
        for h in leaders[:MAX_FEATURE_REFITS]
    ]
    margin = FEATURE_TIE_LOSS_PER_SURROGATE_ERROR * likelihood.surrogate_error_dof()
    return most_parsimonious(refitted, FEATURE_TIE_LOSS + margin)


def most_parsimonious(fitted: list[Hypothesis], margin: float) -> Hypothesis:
    """Return the hypothesis with the shortest last feature within `margin` of the best."""
    best = min(h.loss for h in fitted)
    tied = [h for h in fitted if h.loss < best + margin]
    return min(tied, key=lambda h: (_complexity(h.effects[-1]), h.loss))


def _complexity(active: ActiveEffect) -> int:
    """Return the number of factors of a feature's expression."""
    assert isinstance(active.effect, FeatureEffect)
    expression = feature(active.effect.feature).expression
    return len(expression.split()) + expression.count("^")
