# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decision: identified effects with confidence intervals, or unmodelled dynamics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.block_scores import effect_deviations
from adk_ros.mismatch.inference.confidence import UNLISTED, Evidence, formula_log_prior
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.fit_budget import FINAL, REPLACEMENT
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import (
    Identifiability,
    LeftOutScores,
    assess_identifiability,
    canonical_effect,
)
from adk_ros.mismatch.inference.left_out_support import is_formula_supported, least_supported
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    IdentifiedEffect,
    UnexplainedResidual,
)
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    min_required_gain,
    penalised_loss,
)
from adk_ros.mismatch.inference.significance import significant_effects
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics, fit_feature_expansion
from adk_ros.mismatch.library.criteria import (
    FEATURE_PREFERENCE_RATIO,
    INDISTINGUISHABLE_LOSS,
    INDISTINGUISHABLE_LOSS_SHARE,
    MAX_EXCESS_PER_NOISE,
    MAX_EXCESS_PER_NULL_EXCESS,
    MAX_UNSTRUCTURED_EXCESS,
    MIN_GAIN,
    MIN_GAIN_PER_SURROGATE_ERROR,
    MIN_UNSTRUCTURED_EXCESS,
    REPLACEMENT_LOSS,
)
from adk_ros.mismatch.library.search_limits import MAX_REPLACEMENTS
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.numerics.constants import GRAVITY


@dataclass(frozen=True)
class Decision:
    """
    The verdict with its effects and unmodelled dynamics, and the hypothesis behind them.

    `set_aside`: names of effects of the hypothesis that are less probable than not; `formula`: the
    one that describes the data without any effect, as far as it was sought. `excess_is_small`:
    all channels together leave no more than noise may; what is claimed is a formula, without which
    nothing is missing.
    """

    verdict: str
    effects: list[IdentifiedEffect]
    unexplained: UnexplainedResidual | None
    hypothesis: Hypothesis
    unmodelled: UnmodelledDynamics | None
    set_aside: tuple[str, ...] = ()
    formula: UnmodelledDynamics | None = None
    excess_is_small: bool = False


def decide(likelihood: Likelihood, path: SelectionPath) -> Decision:
    """Decide between no mismatch, effects, and unmodelled dynamics."""
    best = best_within_bounds(path)
    small = _excess_is_small(best, path)
    only_formula = small and not best.effects
    unmodelled, formula = _unmodelled_dynamics(likelihood, path, best, small)
    if unmodelled is not None:
        best = unmodelled.hypothesis
    elif not best.effects:
        return Decision(NONE, [], None, best, None)
    starts = [best]
    if formula is not None and formula.terms and formula is not unmodelled:
        formula = _refitted(likelihood, formula)
        starts.append(formula.hypothesis)
    final = _fit_final(likelihood, best.effects, *starts)
    final, identifiability = _resolve_competitors(
        likelihood, _canonicalised(likelihood, final), path.examined
    )
    significant = significant_effects(likelihood, final, path.examined)
    if len(significant) < len(final.effects):
        final = _fit_final(likelihood, significant, final)
        final, identifiability = _resolve_competitors(likelihood, final, path.examined)
    while (weakest := least_supported(likelihood, identifiability)) is not None:
        supported = [active for i, active in enumerate(final.effects) if i != weakest]
        final = _fit_final(likelihood, supported, final)
        final, identifiability = _resolve_competitors(likelihood, final, path.examined)
    if not final.effects:
        return Decision(NONE, [], None, final, None)
    deviations = effect_deviations(likelihood, final)
    if formula is not None and len(starts) > 1:
        formula = _refitted(likelihood, formula, final)
    evidence_of = _evidence(likelihood, formula, final, path.levels[0][0].loss - final.loss)
    effects = [
        _identified(
            likelihood,
            active,
            deviations[i],
            identifiability[i],
            evidence_of(identifiability[i]),
        )
        for i, active in enumerate(final.effects)
        if i in identifiability
    ]
    if unmodelled is None:
        return Decision(EXPLAINED, effects, None, final, None, formula=formula)
    return Decision(
        UNKNOWN, effects, unmodelled.unexplained(), final, unmodelled, excess_is_small=only_formula
    )


def best_within_bounds(path: SelectionPath) -> Hypothesis:
    """
    Return the largest accepted hypothesis without a variable at its bound, or a single effect.

    A fit at a bound is no claim, and speaks against the larger hypothesis, not against its parts.
    """
    best = path.best()
    while len(best.effects) > 1 and _is_at_bound(best):
        best = path.best(len(best.effects) - 1)
    return best


def _evidence(
    likelihood: Likelihood, formula: UnmodelledDynamics | None, h: Hypothesis, gain: float
) -> Callable[[Identifiability], Evidence]:
    """
    Return what makes the evidence of an effect; `formula` describes the data without any.

    The effects of `h` save `gain` together. A formula with more coefficients than they have
    contains them, and what is not exact in their equations: that alone is no evidence for it.
    """
    alternatives = []
    log_prior = inexact = 0.0
    surrogate_error = likelihood.surrogate_error_dof()
    if formula is not None and formula.terms:
        log_prior = formula_log_prior(len(formula.terms))
        if _contains(formula, h):
            inexact = INDISTINGUISHABLE_LOSS_SHARE * max(gain, 0.0)
        alternatives.append((UNLISTED, LeftOutScores.of(likelihood, formula.hypothesis)))

    def of_effect(identifiability: Identifiability) -> Evidence:
        every = [*identifiability.alternatives_to, *alternatives]
        own = identifiability.scores
        return Evidence(
            tuple(name for name, _ in every),
            np.array([scores.losses - own.losses for _, scores in every]),
            np.append(np.zeros(len(every) - 1), log_prior),
            surrogate_error,
            np.array([scores.prior_cost - own.prior_cost for _, scores in every])
            + np.append(np.zeros(len(every) - 1), inexact),
        )

    return of_effect


def _contains(formula: UnmodelledDynamics, h: Hypothesis) -> bool:
    """Whether a formula has more coefficients than the effects of `h`, all of the catalogue."""
    if any(isinstance(active.effect, FeatureEffect) for active in h.effects):
        return False
    return len(formula.terms) > sum(len(active.theta) for active in h.effects)


def _fit_final(
    likelihood: Likelihood, effects: Sequence[ActiveEffect], *starts: Hypothesis
) -> Hypothesis:
    """
    Return the best final fit of `effects` from the nuisance parameters of each start.

    Along weak directions the loss has several minima. Effects and a formula are compared where
    both were fitted from the values of either.
    """
    fits = [
        likelihood.fit(effects, nuisances=start.nuisances, budget=FINAL, fit_activation=True)
        for start in starts
    ]
    return min(fits, key=lambda h: h.loss)


def _refitted(
    likelihood: Likelihood, formula: UnmodelledDynamics, *starts: Hypothesis
) -> UnmodelledDynamics:
    """Return a formula finally fitted, from its values and from each start."""
    h = formula.hypothesis
    return formula.refitted(_fit_final(likelihood, h.effects, h, *starts))


def _resolve_competitors(
    likelihood: Likelihood, h: Hypothesis, examined: int
) -> tuple[Hypothesis, dict[int, Identifiability]]:
    """
    Replace effects by competing ones that are clearly better, and no accident of a few blocks.

    Return the hypothesis, and the identifiability of its effects by index. `examined` as in
    `significant_effects`.
    """
    identifiability = _identifiability(likelihood, h)
    refused: set[tuple[str, str]] = set()
    exchanges = 0
    while exchanges < MAX_REPLACEMENTS:
        ranked = [
            (competitor.loss_difference, i, j)
            for i, one in identifiability.items()
            for j, competitor in enumerate(one.competitors)
            if competitor.fitted.is_material() and (competitor.of, competitor.name) not in refused
        ]
        difference, which, best = min(ranked, default=(0.0, 0, 0))
        if not _replaces(difference):
            break
        effects = list(h.effects)
        competitor = identifiability[which].competitors[best]
        effects[which] = competitor.fitted
        replaced = likelihood.fit(
            effects, nuisances=h.nuisances, budget=REPLACEMENT, fit_activation=True
        )
        if replaced.effects[which] in significant_effects(likelihood, replaced, examined):
            h = replaced
            exchanges += 1
            identifiability = _identifiability(likelihood, h)
        else:
            refused.add((competitor.of, competitor.name))
    return h, {i: one.without_alternatives(refused) for i, one in identifiability.items()}


def _identifiability(likelihood: Likelihood, h: Hypothesis) -> dict[int, Identifiability]:
    return {
        i: assess_identifiability(likelihood, h, i)
        for i, active in enumerate(h.effects)
        if not isinstance(active.effect, FeatureEffect)
    }


def _replaces(difference: float) -> bool:
    """Whether a competing effect with this difference in loss takes an effect's place."""
    return bool(decided(lambda least: difference <= -least, REPLACEMENT_LOSS=REPLACEMENT_LOSS))


def _excess_is_small(h: Hypothesis, path: SelectionPath) -> bool:
    """Whether a hypothesis leaves no more, in all channels together, than noise may."""
    excess = h.loss - path.expected_loss
    return bool(
        decided(
            lambda per_noise, per_null: (
                excess < per_noise * path.expected_loss
                or excess < per_null * path.null_excess_loss
            ),
            MAX_EXCESS_PER_NOISE=MAX_EXCESS_PER_NOISE,
            MAX_EXCESS_PER_NULL_EXCESS=MAX_EXCESS_PER_NULL_EXCESS,
        )
    )


def _unmodelled_dynamics(
    likelihood: Likelihood, path: SelectionPath, best: Hypothesis, small: bool
) -> tuple[UnmodelledDynamics | None, UnmodelledDynamics | None]:
    """
    Return the unmodelled dynamics if there are any, and the expression without effects.

    `small`: whether the excess of `best` is (`_excess_is_small`).

    Candidates are an expression alone, and an expression in addition to the effects of `best`.
    """
    excess = best.loss - path.expected_loss
    if small and not best.effects:
        # What all channels together do not show, a formula may show in one of them.
        found = _supported_formula(likelihood, path.levels[0][0], path, True)
        is_claim = found.terms and not _is_immaterial(found, path)
        return (found, found) if is_claim else (None, None)
    at_bound = _is_at_bound(best)
    # No expression fits better than one effect that leaves only noise: do not search for it. What
    # a large effect leaves may be small next to it, and far above noise.
    suffices = (
        len(best.effects) == 1
        and not at_bound
        and decided(
            lambda share: excess < share * path.expected_loss,
            MAX_EXCESS_PER_NOISE=MAX_EXCESS_PER_NOISE,
        )
    )
    searched = not suffices
    alone = _supported_formula(likelihood, path.levels[0][0], path, searched)
    if not best.effects:
        # An excess that no effect and no feature reduces is the surrogate's error on this route.
        structured = alone.terms or decided(
            lambda share: excess > share * path.expected_loss,
            MIN_UNSTRUCTURED_EXCESS=MIN_UNSTRUCTURED_EXCESS,
        )
        return (alone if structured else None), alone
    if prefers_feature_model(alone, best, path):
        return alone, alone
    if small and not at_bound:
        return None, alone
    if at_bound:
        return (alone if alone.terms else None), alone
    explains_most = decided(
        lambda share: excess < share * path.null_excess_loss,
        MAX_UNSTRUCTURED_EXCESS=MAX_UNSTRUCTURED_EXCESS,
    )
    # What an inexact equation leaves, a searched parameter can always reduce a little.
    combined = _supported_formula(likelihood, best, path, not explains_most)
    excess_alone = alone.hypothesis.loss - path.expected_loss
    excess_combined = combined.hypothesis.loss - path.expected_loss
    # Effects that a short expression does without only mimic it; one with searched parameters must
    # also fit better than they do.
    least = max(excess_combined, MAX_EXCESS_PER_NOISE * path.expected_loss)
    as_good = decided(
        lambda ratio: excess_alone < ratio * least,
        FEATURE_PREFERENCE_RATIO=FEATURE_PREFERENCE_RATIO,
    )
    if as_good and (not alone.is_searched or alone.penalised_loss() < penalised_loss(best)):
        return alone, alone
    # Effects explain most, and the residual depends on no feature: their equations are inexact.
    if not combined.terms and explains_most:
        return None, alone
    return combined, alone


def _is_immaterial(formula: UnmodelledDynamics, path: SelectionPath) -> bool:
    """Whether an effect below its materiality threshold fits as well as a formula."""
    margin = formula.penalised_loss() + INDISTINGUISHABLE_LOSS
    return any(penalised_loss(h) < margin for h in path.immaterial)


def _supported_formula(
    likelihood: Likelihood, start: Hypothesis, path: SelectionPath, parametric: bool
) -> UnmodelledDynamics:
    """Return the formula for what `start` leaves; without terms if left-out blocks refute it."""
    found = fit_feature_expansion(
        likelihood, start, path.expected_loss, path.null_excess_loss, parametric
    )
    terms = len(found.terms)
    if not terms or is_formula_supported(likelihood, start, found.hypothesis, terms):
        return found
    return replace(found, terms=(), hypothesis=start)


def _is_at_bound(h: Hypothesis) -> bool:
    """Whether a fitted variable of an effect has stopped at its bound."""
    return any(
        x <= p.bounds()[0] + 1e-9 or x >= p.bounds()[1] - 1e-9
        for a in h.effects
        for p, x in zip(a.effect.parameters, a.theta, strict=True)
        if not p.inverse and x != p.theta_neutral
    )


def prefers_feature_model(
    features: UnmodelledDynamics, effects: Hypothesis, path: SelectionPath
) -> bool:
    """
    Whether an expression with no more terms than there are effects fits better than these.

    A catalogue effect that is present fits to the noise, and no expression can do better; several
    wrong effects only mimic a missing term. An expression with fewer terms needs to fit only as
    well, less what each effect more would have to gain, beyond the surrogate's own error.
    """
    # One feature in two equations is one cause.
    fewer = len(effects.effects) - len({term.feature for term in features.terms})
    if not features.terms or fewer < 0:
        return False
    if fewer > 0:
        margin = fewer * MIN_GAIN - MIN_GAIN_PER_SURROGATE_ERROR * path.surrogate_error_dof
        return features.penalised_loss() < penalised_loss(effects) + margin
    return features.penalised_loss() + min_required_gain(effects, path) < effects.loss


def _canonicalised(likelihood: Likelihood, h: Hypothesis) -> Hypothesis:
    """Replace effects by their canonical equivalents."""
    deviations = effect_deviations(likelihood, h)
    effects = list(h.effects)
    changed = False
    for i, active in enumerate(effects):
        effect = canonical_effect(active, deviations[i])
        if effect is not active.effect:
            # Roll from the bias of a_y, pitch from that of a_x.
            theta = (active.theta[1] / GRAVITY, -active.theta[0] / GRAVITY)
            effects[i] = ActiveEffect(effect, theta, active.activation)
            changed = True
    return _fit_final(likelihood, effects, h) if changed else h


def _identified(
    likelihood: Likelihood,
    active: ActiveEffect,
    deviation: Sequence[float],
    identifiability: Identifiability,
    evidence: Evidence,
) -> IdentifiedEffect:
    activation = active.activation
    return IdentifiedEffect(
        active.effect,
        confidence_intervals(active, deviation, likelihood.surrogate_variance_share()),
        np.nan,
        identifiability.alternatives,
        activation.kind,
        activation.intervals(likelihood.problem),
        identifiability.gain,
        identifiability.competitors,
        activation.segments,
        activation.onset_s,
        evidence=evidence,
    )
