# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the search's hypotheses to what is said: effects with intervals, or what is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.forward_selection import SelectionPath, min_required_gain
from adk_ros.mismatch.inference.identifiability import (
    Identifiability,
    assess_identifiability,
    canonical_effect,
)
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    IdentifiedEffect,
    Interval,
    UnexplainedResidual,
)
from adk_ros.mismatch.inference.unmodelled import (
    UnmodelledDynamics,
    catalogue_effects,
    fit_feature_expansion,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import PLACE, TIME
from adk_ros.mismatch.surrogate.activation import TRANSITION_LENGTH_M
from adk_ros.numerics.constants import GRAVITY, QUANTILE_90

SYSTEMATIC_ERROR_SHARE = 0.012
"""Share of an effect's size by which it may be off however long the drive: no form is exact."""
COLOURED_NOISE_INFLATION = 1.4
"""Factor on statistical deviations for what the whitening misses."""

_MAX_EXCESS_PER_NOISE, _MAX_EXCESS_PER_NULL_EXCESS = 0.04, 0.06
"""Shares of the noise and of all that there was; where less is left, nothing is unexplained."""
_MAX_UNSTRUCTURED_EXCESS = 0.35
"""Share of all that effects may leave if what is left depends on nothing."""
_MIN_UNSTRUCTURED_EXCESS = 0.25
"""Share of the noise that must be left to be said where no effect and no feature lessens it."""
_MAX_REPLACEMENTS = 2
_REPLACEMENT_LOSS = 8.0
"""A rival that is better by this much takes the place of what was found."""


@dataclass(frozen=True)
class Decision:
    """What is said: the effects, the remainder, and the hypothesis that the figures are of."""

    verdict: str
    effects: list[IdentifiedEffect]
    unexplained: UnexplainedResidual | None
    hypothesis: Hypothesis
    unmodelled: UnmodelledDynamics | None


def decide(likelihood: Likelihood, found: SelectionPath) -> Decision:
    """Judge the search's best hypothesis."""
    best = found.best()
    remainder = _unmodelled_dynamics(likelihood, found, best)
    if remainder is not None:
        kept = catalogue_effects(remainder.hypothesis)
        best = remainder.hypothesis
    else:
        kept = best.actives
    if not kept and remainder is None:
        return Decision(NONE, [], None, best, None)
    edges = any(a.activation.kind in {PLACE, TIME} for a in kept)
    final = likelihood.fit(best.actives, best.tolerances, 6, None, 1e-6, edges=edges)
    final, standings = _resolve_competitors(
        likelihood, _canonicalised(likelihood, final, edges), edges
    )
    worthy = _significant(likelihood, final, edges)
    if len(worthy) < len(final.actives):
        final = likelihood.fit(worthy, final.tolerances, 6, None, 1e-6, edges=edges)
        final, standings = _resolve_competitors(likelihood, final, edges)
    if not final.actives:
        return Decision(NONE, [], None, final, None)
    deviation = _deviations(likelihood, final, edges)
    effects = [
        _effect(likelihood, active, deviation[i], standings[i])
        for i, active in enumerate(final.actives)
        if i in standings
    ]
    if remainder is None:
        return Decision(EXPLAINED, effects, None, final, None)
    said = UnexplainedResidual(
        remainder.equations,
        round(remainder.share, 3),
        remainder.text(),
        remainder.expression(),
        remainder.terms,
    )
    return Decision(UNKNOWN, effects, said, final, remainder)


def _significant(likelihood: Likelihood, h: Hypothesis, edges: bool) -> list[ActiveEffect]:
    """
    Return what is worth a name: more than build tolerance, surely not nothing, and somewhere.

    Next to a large effect a small one may lessen the loss only because the large one's form is
    inexact: it is then of no sure size, or its place has shrunk to less than its own edges.
    """
    kept = []
    for active, deviation in zip(h.actives, _deviations(likelihood, h, edges), strict=True):
        sure = active.is_material() and any(
            abs(inner - parameter.theta_neutral) > QUANTILE_90 * COLOURED_NOISE_INFLATION * one
            for parameter, inner, one in zip(
                active.effect.parameters, active.theta, deviation, strict=True
            )
        )
        stretches = active.activation.segments
        somewhere = not stretches or any(b - a > 2.0 * TRANSITION_LENGTH_M for a, b in stretches)
        if active.effect.name not in EFFECTS or (sure and somewhere):
            kept.append(active)
    return kept


def _resolve_competitors(
    likelihood: Likelihood, h: Hypothesis, edges: bool
) -> tuple[Hypothesis, dict[int, Identifiability]]:
    """Return the hypothesis in which no rival does better than what it has, and how all stand."""
    for _ in range(_MAX_REPLACEMENTS + 1):
        standings = {
            i: assess_identifiability(likelihood, h, i)
            for i, active in enumerate(h.actives)
            if active.effect.name in EFFECTS
        }
        ahead = [
            (r.loss_difference, i, j)
            for i, s in standings.items()
            for j, r in enumerate(s.competitors)
            if r.fitted.is_material()
        ]
        behind, which, rival = min(ahead, default=(0.0, 0, 0))
        if behind > -_REPLACEMENT_LOSS:
            break
        actives = list(h.actives)
        actives[which] = standings[which].competitors[rival].fitted
        h = likelihood.fit(actives, h.tolerances, 8, None, 1e-6, edges=edges)
    return h, standings


def _unmodelled_dynamics(
    likelihood: Likelihood, found: SelectionPath, best: Hypothesis
) -> UnmodelledDynamics | None:
    """Return what is left where that is material, described from nothing or from `best`."""
    left = best.cost - found.expected_loss
    bound = any(
        x <= p.bounds()[0] + 1e-9 or x >= p.bounds()[1] - 1e-9
        for a in best.actives
        for p, x in zip(a.effect.parameters, a.theta, strict=True)
        if not p.inverse and x != p.theta_neutral
    )
    small = (
        left < _MAX_EXCESS_PER_NOISE * found.expected_loss
        or left < _MAX_EXCESS_PER_NULL_EXCESS * found.null_excess_loss
    )
    if small and not best.actives:
        return None
    nothing = found.levels[0][0]
    plain = fit_feature_expansion(likelihood, nothing, found.expected_loss, found.null_excess_loss)
    if not best.actives:
        # What no effect and no feature lessens is the stand-in's own error on another route.
        return (
            plain if plain.terms or left > _MIN_UNSTRUCTURED_EXCESS * found.expected_loss else None
        )
    if prefers_feature_model(plain, best, found):
        return plain
    if small and not bound:
        return None
    if bound:
        return plain if plain.terms else None
    more = fit_feature_expansion(likelihood, best, found.expected_loss, found.null_excess_loss)
    # Effects that a short expression does without were its disguise.
    rest_plain = plain.hypothesis.cost - found.expected_loss
    rest_more = more.hypothesis.cost - found.expected_loss
    if rest_plain < 1.5 * max(rest_more, _MAX_EXCESS_PER_NOISE * found.expected_loss):
        return plain
    # Effects that explain most, and what they leave depends on nothing: their form is inexact.
    if not more.terms and left < _MAX_UNSTRUCTURED_EXCESS * found.null_excess_loss:
        return None
    return more


def prefers_feature_model(
    plain: UnmodelledDynamics, best: Hypothesis, found: SelectionPath
) -> bool:
    """
    Whether an expression of no more terms than there are effects does better than these.

    A listed effect that is there meets the noise, and no expression can do more; of one that is
    not, several effects together are the disguise.
    """
    if not plain.terms or len(plain.terms) > len(best.actives):
        return False
    return plain.hypothesis.cost + min_required_gain(best, found) < best.cost


def _canonicalised(likelihood: Likelihood, h: Hypothesis, edges: bool) -> Hypothesis:
    """Return the hypothesis with what is rather called by another name called so."""
    deviation = _deviations(likelihood, h, edges)
    actives = list(h.actives)
    changed = False
    for i, active in enumerate(actives):
        effect = canonical_effect(active, tuple(deviation[i]))
        if effect is not active.effect:
            # Tilt by the biases: roll from a_y, pitch from a_x.
            inner = (active.theta[1] / GRAVITY, -active.theta[0] / GRAVITY)
            actives[i] = ActiveEffect(effect, inner, active.activation)
            changed = True
    if not changed:
        return h
    return likelihood.fit(actives, h.tolerances, 6, None, 1e-6, edges=edges)


def _deviations(likelihood: Likelihood, h: Hypothesis, edges: bool) -> list[list[float]]:
    """Return the standard deviations of each effect's fitted variables."""
    assert h.fit is not None
    every = h.fit.deviation()
    at = likelihood.n_nuisances
    out = []
    for active in h.actives:
        count = len(active.theta)
        out.append([float(x) for x in every[at : at + count]])
        at += count + (len(active.activation.variables()) if edges else 0)
    return out


def _effect(
    likelihood: Likelihood, active: ActiveEffect, deviation: list[float], stands: Identifiability
) -> IdentifiedEffect:
    parameters = {}
    for parameter, inner, one in zip(
        active.effect.parameters, active.theta, deviation, strict=True
    ):
        systematic = SYSTEMATIC_ERROR_SHARE * abs(inner - parameter.theta_neutral)
        if not parameter.inverse:
            systematic = float(np.hypot(systematic, 0.1 * parameter.materiality_threshold))
        half = QUANTILE_90 * float(np.hypot(COLOURED_NOISE_INFLATION * one, systematic))
        ends = sorted(
            parameter.value(max(x, 1e-12) if parameter.inverse else x)
            for x in (inner - half, inner + half)
        )
        parameters[parameter.name] = Interval(
            parameter.value(inner), ends[0], ends[1], parameter.unit
        )
    gate = active.activation
    return IdentifiedEffect(
        active.effect,
        parameters,
        round(stands.confidence(), 3),
        stands.alternatives,
        gate.kind,
        gate.intervals(likelihood.problem),
        stands.gain,
        stands.competitors,
        gate.segments,
        gate.onset_s,
    )
