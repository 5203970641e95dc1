# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decision: identified effects with confidence intervals, or unmodelled dynamics."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from adk_ros.mismatch.inference.block_scores import effect_deviations
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.fit_budget import FINAL, REPLACEMENT
from adk_ros.mismatch.inference.formula_choice import (
    best_within_bounds,
    excess_is_small,
    unmodelled_dynamics,
)
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import (
    Identifiability,
    assess_identifiability,
    canonical_effect,
)
from adk_ros.mismatch.inference.identified_effects import identified_effects
from adk_ros.mismatch.inference.left_out_support import least_supported
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    IdentifiedEffect,
    UnexplainedResidual,
)
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.inference.significance import significant_effects
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics
from adk_ros.mismatch.library.criteria import REPLACEMENT_LOSS
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
    nothing is missing. `refuted`: names of effects that held-out data refuted.
    """

    verdict: str
    effects: list[IdentifiedEffect]
    unexplained: UnexplainedResidual | None
    hypothesis: Hypothesis
    unmodelled: UnmodelledDynamics | None
    set_aside: tuple[str, ...] = ()
    formula: UnmodelledDynamics | None = None
    excess_is_small: bool = False
    refuted: tuple[str, ...] = ()


def decide(likelihood: Likelihood, path: SelectionPath) -> Decision:
    """
    Decide between no mismatch, effects, and unmodelled dynamics.

    What an effect that is dropped seemed to explain may be a formula's: it is sought again beside
    the effects that stay.
    """
    best = best_within_bounds(path)
    while True:
        decision, dropped = _decided(likelihood, path, best)
        if not dropped:
            return decision
        left = [a for a in decision.hypothesis.effects if not isinstance(a.effect, FeatureEffect)]
        best = path.levels[0][0]
        if left:
            best = _fit_final(likelihood, left, decision.hypothesis)


def _decided(
    likelihood: Likelihood, path: SelectionPath, best: Hypothesis
) -> tuple[Decision, bool]:
    """Return the decision from the selected effects, and whether any of them was dropped."""
    small = excess_is_small(best, path)
    only_formula = small and not best.effects
    unmodelled, formula = unmodelled_dynamics(likelihood, path, best, small)
    if unmodelled is not None:
        best = unmodelled.hypothesis
    elif not best.effects:
        return Decision(NONE, [], None, best, None), False
    selected = _count(best)
    starts = [best]
    if formula is not None and formula.terms and formula is not unmodelled:
        formula = _refitted(likelihood, formula)
        starts.append(formula.hypothesis)
    final = _canonicalised(likelihood, _fit_final(likelihood, best.effects, *starts))
    decision = _judged(likelihood, path, final, unmodelled, formula)
    decision = replace(decision, excess_is_small=only_formula and decision.unmodelled is not None)
    return decision, _count(decision.hypothesis) < selected


def reassessed(
    decision: Decision,
    likelihood: Likelihood,
    path: SelectionPath,
    effects: Sequence[ActiveEffect],
    refuted: Sequence[str] = (),
) -> Decision:
    """
    Return the decision with these effects of its hypothesis only, as far as they are supported.

    What may be in their place is judged anew, except effects that have been refuted, with the
    names `refuted` or before. Where none of the catalogue is left, the formula that describes the
    data without any is the answer, if there is one: a formula that was added to the effects
    described what they leave.
    """
    refuted = (*decision.refuted, *refuted)
    formula = decision.formula
    final = _fit_final(likelihood, effects, decision.hypothesis)
    judged = _judged(likelihood, path, final, decision.unmodelled, formula, refuted)
    if formula is not None and formula.terms and not _count(judged.hypothesis):
        judged = Decision(UNKNOWN, [], formula.unexplained(), formula.hypothesis, formula)
    return replace(judged, excess_is_small=decision.excess_is_small, refuted=refuted)


def _judged(
    likelihood: Likelihood,
    path: SelectionPath,
    h: Hypothesis,
    unmodelled: UnmodelledDynamics | None,
    formula: UnmodelledDynamics | None,
    refuted: Collection[str] = (),
) -> Decision:
    """Return the decision of a final fit, of its effects that are significant and supported."""
    final, identifiability = _resolve_competitors(likelihood, h, path.examined, refuted)
    while True:
        kept = significant_effects(likelihood, final, path.examined)
        if len(kept) == len(final.effects):
            weakest = least_supported(likelihood, identifiability)
            kept = [active for i, active in enumerate(final.effects) if i != weakest]
        if len(kept) == len(final.effects):
            break
        final = _fit_final(likelihood, kept, final)
        final, identifiability = _resolve_competitors(likelihood, final, path.examined, refuted)
    if not final.effects:
        if unmodelled is None or unmodelled.terms:
            return Decision(NONE, [], None, final, None)
        # Far more than noise, that no effect and no feature reduces.
        return Decision(UNKNOWN, [], unmodelled.unexplained(), final, unmodelled)
    if formula is not None and formula.terms and formula is not unmodelled:
        formula = _refitted(likelihood, formula, final)
    effects = identified_effects(likelihood, path, formula, final, identifiability)
    if unmodelled is None:
        return Decision(EXPLAINED, effects, None, final, None, formula=formula)
    return Decision(UNKNOWN, effects, unmodelled.unexplained(), final, unmodelled, formula=formula)


def _count(h: Hypothesis) -> int:
    """Return the number of effects of the catalogue."""
    return sum(not isinstance(active.effect, FeatureEffect) for active in h.effects)


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
    likelihood: Likelihood, h: Hypothesis, examined: int, refuted: Collection[str] = ()
) -> tuple[Hypothesis, dict[int, Identifiability]]:
    """
    Replace effects by competing ones that are clearly better, and no accident of a few blocks.

    Return the hypothesis, and the identifiability of its effects by index. `examined` as in
    `significant_effects`; `refuted`: names of effects that are no competitors.
    """
    identifiability = _identifiability(likelihood, h)
    refused: set[tuple[str, str]] = set()
    exchanges = 0
    while exchanges < MAX_REPLACEMENTS:
        ranked = [
            (competitor.loss_difference, i, j)
            for i, one in identifiability.items()
            for j, competitor in enumerate(one.competitors)
            if competitor.fitted.is_material()
            and competitor.name not in refuted
            and (competitor.of, competitor.name) not in refused
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
    return h, {
        i: one.without_alternatives(refused).without_competitors(refuted)
        for i, one in identifiability.items()
    }


def _identifiability(likelihood: Likelihood, h: Hypothesis) -> dict[int, Identifiability]:
    return {
        i: assess_identifiability(likelihood, h, i)
        for i, active in enumerate(h.effects)
        if not isinstance(active.effect, FeatureEffect)
    }


def _replaces(difference: float) -> bool:
    """Whether a competing effect with this difference in loss takes an effect's place."""
    return bool(decided(lambda least: difference <= -least, REPLACEMENT_LOSS=REPLACEMENT_LOSS))


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
