# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The identified effects of a fit: sizes with intervals, competitors, and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from adk_ros.mismatch.inference.block_scores import effect_deviations
from adk_ros.mismatch.inference.confidence import UNLISTED, Evidence, formula_log_prior
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import Identifiability, LeftOutScores
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import IdentifiedEffect
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics
from adk_ros.mismatch.library.criteria import INDISTINGUISHABLE_LOSS_SHARE


def identified_effects(
    likelihood: Likelihood,
    path: SelectionPath,
    formula: UnmodelledDynamics | None,
    h: Hypothesis,
    identifiability: Mapping[int, Identifiability],
) -> list[IdentifiedEffect]:
    """Return the effects of a final fit that have an identifiability, with their evidence."""
    deviations = effect_deviations(likelihood, h)
    evidence_of = _evidence(likelihood, formula, h, path.levels[0][0].loss - h.loss)
    return [
        _identified(likelihood, active, deviations[i], identifiability[i], evidence_of)
        for i, active in enumerate(h.effects)
        if i in identifiability
    ]


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


def _identified(
    likelihood: Likelihood,
    active: ActiveEffect,
    deviation: Sequence[float],
    identifiability: Identifiability,
    evidence_of: Callable[[Identifiability], Evidence],
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
        evidence=evidence_of(identifiability),
    )
