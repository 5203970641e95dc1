# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The choice between effects of the catalogue and a formula of features.

Every set of effects is compared with a formula of plain features. Features with searched
parameters are tried as well, except next to a single effect, not at its bound, that leaves no more
than noise may. What effects leave beyond that is described by a formula alone or next to them.
"""

from __future__ import annotations

from dataclasses import replace

from adk_ros.mismatch.inference.fit_budget import FEATURE_REFIT
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.identifiability import LeftOutScores
from adk_ros.mismatch.inference.left_out_support import is_formula_supported
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    min_required_gain,
    penalised_loss,
)
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics, fit_feature_expansion
from adk_ros.mismatch.library.criteria import (
    FEATURE_PREFERENCE_RATIO,
    INDISTINGUISHABLE_LOSS,
    MAX_EXCESS_PER_NOISE,
    MAX_EXCESS_PER_NULL_EXCESS,
    MAX_UNSTRUCTURED_EXCESS,
    MIN_GAIN,
    MIN_GAIN_PER_SURROGATE_ERROR,
    MIN_UNSTRUCTURED_EXCESS,
)
from adk_ros.mismatch.library.sensitivity import decided


def best_within_bounds(path: SelectionPath) -> Hypothesis:
    """
    Return the largest accepted hypothesis without a variable at its bound, or a single effect.

    A fit at a bound is no claim, and speaks against the larger hypothesis, not against its parts.
    """
    best = path.best()
    while len(best.effects) > 1 and _is_at_bound(best):
        best = path.best(len(best.effects) - 1)
    return best


def excess_is_small(h: Hypothesis, path: SelectionPath) -> bool:
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


def unmodelled_dynamics(
    likelihood: Likelihood, path: SelectionPath, best: Hypothesis, small: bool
) -> tuple[UnmodelledDynamics | None, UnmodelledDynamics | None]:
    """
    Return the unmodelled dynamics if there are any, and the expression without effects.

    `small`: whether the excess of `best` is (`excess_is_small`).

    Candidates are an expression alone, and an expression in addition to the effects of `best`.
    """
    excess = best.loss - path.expected_loss
    if small and not best.effects:
        # What all channels together do not show, a formula may show in one of them.
        found = supported_formula(likelihood, path.levels[0][0], path, True)
        is_claim = found.terms and not _is_immaterial(found, path)
        return (found, found) if is_claim else (None, None)
    at_bound = _is_at_bound(best)
    # No expression fits better than one effect that leaves only noise: search for no parameters of
    # features. What a large effect leaves may be small next to it, and far above noise.
    suffices = (
        len(best.effects) == 1
        and not at_bound
        and decided(
            lambda share: excess < share * path.expected_loss,
            MAX_EXCESS_PER_NOISE=MAX_EXCESS_PER_NOISE,
        )
    )
    searched = not suffices
    alone = supported_formula(likelihood, path.levels[0][0], path, searched)
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
    combined = supported_formula(likelihood, best, path, not explains_most)
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


def _is_immaterial(formula: UnmodelledDynamics, path: SelectionPath) -> bool:
    """Whether an effect below its materiality threshold fits as well as a formula."""
    margin = formula.penalised_loss() + INDISTINGUISHABLE_LOSS
    return any(penalised_loss(h) < margin for h in path.immaterial)


def supported_formula(
    likelihood: Likelihood, start: Hypothesis, path: SelectionPath, parametric: bool
) -> UnmodelledDynamics:
    """
    Return the formula for what `start` leaves, of the terms that left-out blocks support.

    Where they do not support all of them together, that one is dropped without which the others
    explain these blocks best.
    """
    found = fit_feature_expansion(
        likelihood, start, path.expected_loss, path.null_excess_loss, parametric
    )
    tried = 1
    while found.terms and not is_formula_supported(
        likelihood, start, found.hypothesis, len(found.terms), tried
    ):
        tried += len(found.terms)
        found = _with_a_term_less(likelihood, start, found)
    return found


def _with_a_term_less(
    likelihood: Likelihood, start: Hypothesis, formula: UnmodelledDynamics
) -> UnmodelledDynamics:
    """Return a formula for what `start` leaves, without the term that is supported least."""
    if len(formula.terms) < 2:
        return replace(formula, terms=(), hypothesis=start)
    h, first = formula.hypothesis, len(start.effects)
    fits = []
    for dropped in range(len(formula.terms)):
        effects = [active for i, active in enumerate(h.effects) if i != first + dropped]
        terms = tuple(term for i, term in enumerate(formula.terms) if i != dropped)
        fit = likelihood.fit(effects, nuisances=h.nuisances, budget=FEATURE_REFIT)
        fits.append(replace(formula, terms=terms).refitted(fit))
    return min(fits, key=lambda fit: LeftOutScores.of(likelihood, fit.hypothesis).total)


def _is_at_bound(h: Hypothesis) -> bool:
    """Whether a fitted variable of an effect has stopped at its bound."""
    return any(
        x <= p.bounds()[0] + 1e-9 or x >= p.bounds()[1] - 1e-9
        for a in h.effects
        for p, x in zip(a.effect.parameters, a.theta, strict=True)
        if not p.inverse and x != p.theta_neutral
    )
