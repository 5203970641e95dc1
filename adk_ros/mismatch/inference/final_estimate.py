# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Final estimate: sizes from the whole recording, and the posterior probability of effects."""

from __future__ import annotations

from dataclasses import replace

from adk_ros.mismatch.inference.block_scores import effect_deviations
from adk_ros.mismatch.inference.confidence import ConfidenceModel
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.fit_budget import FINAL
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, UNKNOWN, IdentifiedEffect

CREDIBLE = 0.9
"""Probability of the set of effects that is reported, one of which is present. Convention."""
SMALLEST_SHARE = 0.05
"""
Least probability of an effect in that set, and of one that is claimed next to a formula: the usual
size of a significance test.
"""
_LARGEST_EXPLAINED = 1.0
"""Largest held-out error, over what a correct model explains, of an explained recording."""

PROBABLE = 0.5
"""
Probability from which an effect is claimed next to what nothing explains, and without a word of
doubt: more than not.
"""


def without_improbable(decision: Decision, error_ratio: float) -> Decision:
    """
    Return a decision without effects that physics that nothing describes makes improbable.

    Where the held-out errors stay unexplained, such physics may be all that there is. What was
    fitted stays in the hypothesis. `error_ratio` as for `with_confidence`.
    """
    if decision.verdict != UNKNOWN:
        return decision
    probable, set_aside = [], []
    for effect in decision.effects:
        if with_posterior(effect, error_ratio).confidence < PROBABLE:
            set_aside.append(effect.effect.name)
        else:
            probable.append(effect)
    return replace(decision, effects=probable, set_aside=tuple(set_aside))


def formula_instead(decision: Decision) -> Decision:
    """
    Return a decision with the formula that makes the effects of an explained one improbable.

    Below `SMALLEST_SHARE` an effect is refuted at the usual level; the formula describes the data
    without any effect. The decision itself where there is none.
    """
    formula = decision.formula
    if decision.verdict != EXPLAINED or formula is None or not formula.terms:
        return decision
    if all(
        with_posterior(effect, _LARGEST_EXPLAINED).confidence >= SMALLEST_SHARE
        for effect in decision.effects
    ):
        return decision
    return Decision(UNKNOWN, [], formula.unexplained(), formula.hypothesis, formula)


def refitted(decision: Decision, likelihood: Likelihood) -> Decision:
    """
    Return a decision with sizes, places and onsets fitted to all data of `likelihood`.

    Which effects there are stays as decided on the training part.
    """
    h = decision.hypothesis
    final = likelihood.fit(h.effects, nuisances=h.nuisances, budget=FINAL, fit_activation=True)
    deviations = effect_deviations(likelihood, final)
    fitted = {
        (active.effect.name, active.activation.kind): (active, deviation)
        for active, deviation in zip(final.effects, deviations, strict=True)
    }
    effects, share = [], likelihood.surrogate_variance_share()
    for identified in decision.effects:
        active, deviation = fitted[identified.effect.name, identified.kind]
        activation = active.activation
        effects.append(
            replace(
                identified,
                parameters=confidence_intervals(active, deviation, share),
                time_intervals_s=activation.intervals(likelihood.problem),
                segments=activation.segments,
                onset_s=activation.onset_s,
            )
        )
    unmodelled, unexplained = decision.unmodelled, decision.unexplained
    if unmodelled is not None and unexplained is not None:
        unmodelled = unmodelled.refitted(final)
        unexplained = unmodelled.unexplained()
    return replace(
        decision,
        effects=effects,
        hypothesis=final,
        unmodelled=unmodelled,
        unexplained=unexplained,
    )


def with_confidence(decision: Decision, error_ratio: float) -> Decision:
    """
    Return a decision with the posterior probability of each effect.

    `error_ratio`: largest held-out error over what a correct model explains.
    """
    return replace(
        decision, effects=[with_posterior(effect, error_ratio) for effect in decision.effects]
    )


def with_posterior(identified: IdentifiedEffect, error_ratio: float) -> IdentifiedEffect:
    """
    Return an effect with its posterior probability and that of its alternatives.

    While it is below `CREDIBLE`, the most probable competing effect joins the alternatives.
    `error_ratio` as for `with_confidence`.
    """
    assert identified.evidence is not None
    posterior = ConfidenceModel().posterior(identified.evidence, error_ratio)
    confidence = max(1.0 - sum(posterior.values()), 0.0)
    joined: list[str] = []
    for competitor in sorted(identified.competitors, key=lambda c: -posterior.get(c.name, 0.0)):
        share = posterior.get(competitor.name, 0.0)
        if confidence >= CREDIBLE or share < SMALLEST_SHARE:
            break
        joined.append(competitor.name)
        confidence += share
    return replace(
        identified,
        confidence=round(confidence, 3),
        posterior=posterior,
        alternatives=[*identified.alternatives, *joined],
        competitors=tuple(
            replace(c, alternative=c.alternative or c.name in joined)
            for c in identified.competitors
        ),
    )
