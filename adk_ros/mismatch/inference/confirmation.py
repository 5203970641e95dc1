# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Confirmation of each of several effects, and of a weak formula, on held-out data.

Next to a large effect whose equation is inexact, a small one may fit what is left of the training
part without being present. Present effects gain on held-out data in proportion to their share of
it; those that gain less than a quarter of that are dropped. The same is asked of a formula where
noise may explain the recording without it, in proportion to the squares of what it changes.
"""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.decision import Decision, reassessed
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.fit_budget import ABLATION
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import STRUCTURALLY_EQUIVALENT
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.library.criteria import (
    MIN_ACTIVE_S,
    MIN_CONFIRMED_SHARE,
    PENALTY_PER_PARAMETER,
)
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_loss


def confirmed(
    decision: Decision, training: Likelihood, whole: Likelihood, path: SelectionPath
) -> Decision:
    """
    Return a decision without the effects that held-out data do not confirm.

    `training`: likelihood of the part before the held-out one; `whole`: of all data. A single
    effect is left to the check of the held-out errors. What may be in the place of the effects
    that stay is judged anew: an effect that was dropped may have taken its part.
    """
    held_out = training.held_out_bins()
    while len(effects := decision.hypothesis.effects) > 1:
        refuted = _refuted(decision.hypothesis, training, whole, held_out)
        if refuted is None:
            break
        name = effects[refuted].effect.name
        left = [active for i, active in enumerate(effects) if i != refuted]
        equivalent = STRUCTURALLY_EQUIVALENT.get(name, ())
        decision = reassessed(decision, training, path, left, (name, *equivalent))
    return decision


def is_formula_confirmed(
    h: Hypothesis, null: Hypothesis, training: Likelihood, whole: Likelihood
) -> bool:
    """
    Whether a formula gains on held-out data in proportion to what it changes there.

    For one that is claimed where `null`, without it, leaves no more than noise may: the errors of
    the predictions are explained without it, so `withdrawal.is_refuted` does not apply; they can
    still contradict it. False with nothing held out. Where chance may gain as much as the formula
    would (`PENALTY_PER_PARAMETER`), a loss of more than that contradicts it.
    """
    held_out = training.held_out_bins()
    if not (whole.weights[:, held_out] > 0.0).any():
        return False
    before, after = (_whitened(whole, x) for x in (null, h))
    change = (before - after) ** 2
    share = float(change[:, held_out].sum()) / max(float(change[:, ~held_out].sum()), 1e-9)
    earlier, gain = (
        huber_loss(before[:, bins]) - huber_loss(after[:, bins]) for bins in (~held_out, held_out)
    )
    expected = share * max(earlier, 0.0)
    if expected < PENALTY_PER_PARAMETER:
        return gain > -PENALTY_PER_PARAMETER
    return bool(
        decided(lambda least: gain >= least * expected, MIN_CONFIRMED_SHARE=MIN_CONFIRMED_SHARE)
    )


def _refuted(
    h: Hypothesis, training: Likelihood, whole: Likelihood, held_out: BoolArray
) -> int | None:
    """Return the index of the effect that held-out data confirm least, if not enough."""
    shares: dict[int, float] = {}
    later, earlier = _losses(whole, h, held_out)
    for i, active in enumerate(h.effects):
        ratio = _activity_ratio(active, whole, held_out)
        if isinstance(active.effect, FeatureEffect) or ratio is None:
            continue
        others = [other for j, other in enumerate(h.effects) if j != i]
        without = training.fit(others, nuisances=h.nuisances, budget=ABLATION)
        later_without, earlier_without = _losses(whole, without, held_out)
        expected, gain = ratio * (earlier_without - earlier), later_without - later
        if expected < PENALTY_PER_PARAMETER and gain > -PENALTY_PER_PARAMETER:
            # Chance may gain as much as the effect would.
            continue
        shares[i] = gain / max(expected, PENALTY_PER_PARAMETER)
    if not shares:
        return None
    worst = min(shares, key=lambda i: shares[i])
    refuted = decided(lambda least: shares[worst] < least, MIN_CONFIRMED_SHARE=MIN_CONFIRMED_SHARE)
    return worst if refuted else None


def _activity_ratio(active: ActiveEffect, whole: Likelihood, held_out: BoolArray) -> float | None:
    """Return the time that an effect acts in the held-out over that in the training data."""
    problem = whole.problem
    weight = np.abs(active.activation.series(problem))
    counted = (whole.weights > 0.0).any(axis=0)
    acting = np.interp(problem.bin_s, problem.middle_s, weight) * counted
    bin_s = float(problem.bin_s[1] - problem.bin_s[0])
    later, earlier = float(acting[held_out].sum()), float(acting[~held_out].sum())
    if decided(lambda least_s: min(later, earlier) * bin_s < least_s, MIN_ACTIVE_S=MIN_ACTIVE_S):
        return None
    return later / earlier


def _losses(likelihood: Likelihood, h: Hypothesis, bins: BoolArray) -> tuple[float, float]:
    """Return the loss of a hypothesis, without the prior's, in some bins and in the others."""
    whitened = _whitened(likelihood, h)
    return huber_loss(whitened[:, bins]), huber_loss(whitened[:, ~bins])


def _whitened(likelihood: Likelihood, h: Hypothesis) -> FloatArray:
    """Return the whitened residuals (6, b) of a hypothesis."""
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    return likelihood.whiten(likelihood.channel_residuals(p, terms))
