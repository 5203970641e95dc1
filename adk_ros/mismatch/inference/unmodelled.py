# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Unmodelled dynamics: which equation lacks a term, and on which features of the drive it depends.

Features (see `library.features`) with a coefficient are added to the accelerations of the three
equations, one after the other, while each gains enough; after a feature with searched parameters,
earlier ones that no longer gain enough are dropped. Nuisance parameters and identified effects are
fitted jointly. The result is a short expression, which also corrects the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from adk_ros.mismatch.inference.feature_effect import (
    EQUATION_TEXTS,
    FeatureEffect,
    added_to,
    feature_terms,
    state_equations,
)
from adk_ros.mismatch.inference.feature_screening import FeatureScreening
from adk_ros.mismatch.inference.fit_budget import FEATURE, FEATURE_REFIT
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.parametric_refinement import refined, with_siblings
from adk_ros.mismatch.inference.result import UnexplainedResidual
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.inference.term_elimination import without_superfluous
from adk_ros.mismatch.inference.term_meaning import Body, meaning
from adk_ros.mismatch.library.criteria import (
    EQUATION_GAIN_SHARE,
    FEATURE_MAJORITY_SHARE,
    FEATURE_MIN_GAIN,
    FEATURE_MIN_GAIN_PER_EXCESS,
    FEATURE_RESIDUAL_SHARE,
    FEATURE_TIE_LOSS,
    FEATURE_TIE_LOSS_PER_SURROGATE_ERROR,
    MIN_GAIN_PER_SURROGATE_ERROR,
    PENALTY_PER_LOCATION,
    PENALTY_PER_PARAMETER,
)
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.parametric_features import searched_parameters
from adk_ros.mismatch.library.search_limits import (
    FEATURE_REFIT_GAIN_SHARE,
    MAX_FEATURE_REFITS,
    MAX_FEATURES,
    MAX_FEATURES_FITTED,
    MIN_SCREENED_GAIN_FEATURE,
)
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.feature_terms import (
    FeatureTerm,
)
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class UnmodelledDynamics:
    """An expression for the excess loss; `share` is that of the excess loss before any effect."""

    share: float
    terms: tuple[FeatureTerm, ...]
    hypothesis: Hypothesis
    body: Body

    @property
    def equations(self) -> list[str]:
        """State equations with a missing term, largest gain first."""
        names = [name for term in self._entered() for name in state_equations(term)]
        return list(dict.fromkeys(names))

    def _entered(self) -> list[str]:
        """Return the equations of the terms, largest gain first."""
        gains: dict[str, float] = {}
        for term in self.terms:
            gains[term.equation] = gains.get(term.equation, 0.0) + term.gain
        top = max(gains.values(), default=0.0)
        order = sorted(gains, key=lambda name: -gains[name])
        return decided(
            lambda share: [name for name in order if gains[name] > share * top],
            EQUATION_GAIN_SHARE=EQUATION_GAIN_SHARE,
        )

    def text(self) -> str:
        """Return which acceleration depends on which feature, in words."""
        if not self.terms:
            return "a structured residual that depends on none of the examined features"
        return "; ".join(
            f"{EQUATION_TEXTS[equation]} against {feature(p.feature).description}"
            for p in self.terms
            for equation in dict.fromkeys((*state_equations(p.equation), p.equation))
        )

    def expression(self) -> str:
        """Return the expression with its units."""
        parts = []
        for equation in self._entered():
            terms = [
                f"{p.coefficient:+.4g} {feature(p.feature).expression}"
                for p in self.terms
                if p.equation == equation
            ]
            parts.append(added_to(equation, " ".join(terms)))
        return "; ".join(parts)

    @property
    def is_searched(self) -> bool:
        """Whether a term has searched parameters."""
        return any(searched_parameters(term.feature) for term in self.terms)

    def penalised_loss(self) -> float:
        """Return the loss with the penalties for coefficients and searched parameters."""
        # A feature in two equations has its parameters in common.
        searched = sum(searched_parameters(name) for name in {x.feature for x in self.terms})
        penalty = PENALTY_PER_PARAMETER * len(self.terms) + PENALTY_PER_LOCATION * searched
        return self.hypothesis.loss + penalty

    def refitted(self, hypothesis: Hypothesis) -> UnmodelledDynamics:
        """Return the expression with the coefficients of a later fit of the same features."""
        fitted = feature_terms(hypothesis.effects)
        gains = {(term.equation, term.feature): term.gain for term in self.terms}
        terms = tuple(replace(x, gain=gains[x.equation, x.feature]) for x in fitted)
        return replace(self, terms=terms, hypothesis=hypothesis)

    def unexplained(self) -> UnexplainedResidual:
        """Return the part of the result that describes it."""
        return UnexplainedResidual(
            self.equations,
            round(self.share, 3),
            self.text(),
            self.expression(),
            self.terms,
            meaning(self.terms, self.body),
        )


def fit_feature_expansion(
    likelihood: Likelihood,
    start: Hypothesis,
    expected_loss: float,
    null_excess_loss: float,
    parametric: bool = True,
) -> UnmodelledDynamics:
    """
    Describe the excess loss of `start` by as few features as possible.

    `parametric`: also by features with a memory, a threshold, wear or an oscillation.
    """
    screening = FeatureScreening.of(likelihood, start, parametric)
    jacobian = likelihood.nuisance_jacobian(start)
    current = start
    excess = max(start.loss - expected_loss, 0.0)
    surrogate_error = MIN_GAIN_PER_SURROGATE_ERROR * likelihood.surrogate_error_dof()
    least_sibling = FEATURE_MIN_GAIN + surrogate_error
    gains: list[float] = []
    for _ in range(MAX_FEATURES):
        linearised = LinearisedProblem(likelihood, current, jacobian)
        required = _RequiredGain(surrogate_error, excess, current.loss - expected_loss)
        least = required.least()
        extensions = _best_extensions(
            linearised, screening.candidates(linearised), jacobian, required
        )
        if not extensions:
            break
        fitted = [_polished(likelihood, x, jacobian, screening, least_sibling) for x in extensions]
        further = required.after(fitted[0].loss - expected_loss)
        polished = first_unless_far_behind(fitted, further.least())
        n_more = len(polished.effects) - len(current.effects)
        kept = polished
        if _is_searched(polished.effects[-1]):
            first = len(start.effects)
            kept, dropped = without_superfluous(
                likelihood, polished, range(first, len(current.effects)), jacobian, least
            )
            gains = [x for i, x in enumerate(gains) if i + first not in dropped]
        # The new terms also take over the gain of those that they replace.
        gains += [(start.loss - sum(gains) - _cost(kept)) / n_more] * n_more
        current = kept
        little_left = decided(
            partial(_is_below_share, current.loss - expected_loss, excess),
            FEATURE_RESIDUAL_SHARE=FEATURE_RESIDUAL_SHARE,
        )
        if little_left or len(feature_terms(current.effects)) >= MAX_FEATURES:
            break
    terms = tuple(
        replace(term, gain=gain)
        for term, gain in zip(feature_terms(current.effects), gains, strict=True)
    )
    share = excess / null_excess_loss if null_excess_loss > 0.0 else 1.0
    names = ("mass", "yaw_inertia", "wheel_radius")
    body = Body(*(float(likelihood.parameters[INDEX[name]]) for name in names))
    return UnmodelledDynamics(share, terms, current, body)


def _is_below_share(value: float, of: float, share: float) -> bool:
    return value < share * of


@dataclass(frozen=True)
class _RequiredGain:
    """
    What a further feature must gain, from the excess loss before all features and that left.

    `surrogate_error`: the share of the surrogate error that counts.
    """

    surrogate_error: float
    excess: float
    left: float

    def after(self, left: float) -> _RequiredGain:
        """Return what one more feature must gain, where those before leave so much."""
        return replace(self, left=max(left, 0.0))

    def least(self) -> float:
        """Return the least gain."""
        return self._least(FEATURE_MIN_GAIN, FEATURE_MIN_GAIN_PER_EXCESS, FEATURE_MAJORITY_SHARE)

    def exceeded_by(self, gains: Sequence[float]) -> list[bool]:
        """Return which gains are sufficient."""
        return decided(
            lambda *constants: [gain >= self._least(*constants) for gain in gains],
            FEATURE_MIN_GAIN=FEATURE_MIN_GAIN,
            FEATURE_MIN_GAIN_PER_EXCESS=FEATURE_MIN_GAIN_PER_EXCESS,
            FEATURE_MAJORITY_SHARE=FEATURE_MAJORITY_SHARE,
        )

    def _least(self, minimum: float, per_excess: float, majority: float) -> float:
        shared = min(per_excess * self.excess, majority * self.left)
        return max(minimum + self.surrogate_error, shared)


def _cost(h: Hypothesis) -> float:
    """Return the loss, with the penalty for the searched parameters of the last feature."""
    effect = h.effects[-1].effect
    name = effect.feature if isinstance(effect, FeatureEffect) else ""
    return h.loss + PENALTY_PER_LOCATION * searched_parameters(name)


def _polished(
    likelihood: Likelihood,
    extended: Hypothesis,
    jacobian: FloatArray,
    screening: FeatureScreening,
    least_sibling: float,
) -> Hypothesis:
    """Return a hypothesis with the parameters of its last feature refined, and its sibling."""
    polished = refined(likelihood, extended, jacobian)
    polished = with_siblings(likelihood, polished, jacobian, screening.equations, least_sibling)
    if polished is extended:
        return extended
    return likelihood.fit(polished.effects, nuisances=polished.nuisances, budget=FEATURE_REFIT)


def _best_extensions(
    linearised: LinearisedProblem,
    candidates: list[Candidate],
    jacobian: FloatArray,
    required: _RequiredGain,
) -> list[Hypothesis]:
    """
    Return the hypotheses with the best further feature, none where no feature gains enough.

    A linearised gain is inaccurate where much is unexplained: the best few are fitted, and the
    leaders once more with updated nuisance derivatives. A feature without searched parameters is
    preferred if it is among the leaders; the best of those with them then comes second, since
    refinement may find much more in it. Among those tied with the best, within statistical margin
    and surrogate error, the shortest expression wins.
    """
    likelihood, current = linearised.likelihood, linearised.hypothesis
    candidates.sort(key=lambda x: -x.gain)
    leading = candidates[:MAX_FEATURES_FITTED]
    if all(_is_searched(x.active) for x in leading):
        leading += [x for x in candidates if not _is_searched(x.active)][:1]
    enough = required.exceeded_by([x.gain for x in leading])
    fitted = [
        likelihood.fit(
            [*current.effects, candidate.active],
            nuisances=current.nuisances,
            budget=FEATURE,
            jacobian=jacobian,
        )
        for candidate, sufficient in zip(leading, enough, strict=True)
        if sufficient and candidate.gain > MIN_SCREENED_GAIN_FEATURE * candidates[0].gain
    ]
    top = max((current.loss - _cost(h) for h in fitted), default=0.0)
    if not required.exceeded_by([top])[0]:
        return []
    leaders = sorted(
        (h for h in fitted if current.loss - _cost(h) > FEATURE_REFIT_GAIN_SHARE * top),
        key=_cost,
    )
    surrogate_error = likelihood.surrogate_error_dof()

    def best(hypotheses: list[Hypothesis]) -> Hypothesis:
        refitted = [
            likelihood.fit(h.effects, nuisances=h.nuisances, budget=FEATURE_REFIT)
            for h in hypotheses[:MAX_FEATURE_REFITS]
        ]
        chosen = decided(
            lambda loss, share: most_parsimonious(refitted, loss + share * surrogate_error),
            FEATURE_TIE_LOSS=FEATURE_TIE_LOSS,
            FEATURE_TIE_LOSS_PER_SURROGATE_ERROR=FEATURE_TIE_LOSS_PER_SURROGATE_ERROR,
        )
        return refitted[chosen]

    return [best(group) for group in leading_groups(leaders)]


def leading_groups(leaders: list[Hypothesis]) -> list[list[Hypothesis]]:
    """
    Return the hypotheses, best first, from each of which one is taken, the preferred ones first.

    Among hundreds of thresholds and frequencies one nearly always beats a plain feature; and a
    plain one may beat them until their parameters are refined: a cube resembles a threshold.
    """
    plain = [h for h in leaders if not _is_searched(h.effects[-1])]
    searched = [h for h in leaders if _is_searched(h.effects[-1])]
    return [group for group in (plain, searched[:1] if plain else searched) if group]


def first_unless_far_behind(fitted: list[Hypothesis], least: float) -> Hypothesis:
    """Return the first hypothesis, or a later one whose lead would be worth a further feature."""
    best = min(fitted, key=_cost)
    return best if _cost(best) + least < _cost(fitted[0]) else fitted[0]


def most_parsimonious(fitted: list[Hypothesis], margin: float) -> int:
    """Return the index of that with the shortest last feature within `margin` of the best."""
    best = min(_cost(h) for h in fitted)
    tied = [i for i, h in enumerate(fitted) if _cost(h) < best + margin]
    return min(tied, key=lambda i: (_complexity(fitted[i].effects[-1]), fitted[i].loss))


def _is_searched(active: ActiveEffect) -> bool:
    """Whether a feature has searched parameters."""
    effect = active.effect
    return isinstance(effect, FeatureEffect) and searched_parameters(effect.feature) > 0


def _complexity(active: ActiveEffect) -> int:
    """Return the number of factors of a feature's expression."""
    assert isinstance(active.effect, FeatureEffect)
    expression = feature(active.effect.feature).expression
    return len(expression.split()) + expression.count("^")
