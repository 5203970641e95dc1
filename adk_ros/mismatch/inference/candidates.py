# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rejected candidates: effects that were fitted alone, their sizes, and why they are rejected."""

from __future__ import annotations

from adk_ros.mismatch.inference.block_scores import effect_deviations
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import NONE, NOT_SUPPORTED, RejectedCandidate
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    is_improvement,
    min_required_gain,
    penalised_loss,
)
from adk_ros.mismatch.inference.significance import significant_effects
from adk_ros.mismatch.library.criteria import MAX_CANDIDATES_LISTED


def rejected_candidates(
    likelihood: Likelihood, path: SelectionPath, decision: Decision
) -> list[RejectedCandidate]:
    """
    Return the single effects that gain most and are not part of the decision.

    Each was fitted alone, to the training part, whose `likelihood` is given; `share` is that of
    the excess loss it removes, or of the required gain if that is larger.
    """
    null = path.levels[0][0]
    # Where no model could save as much as an effect must, shares are of what is required.
    least = max(path.null_excess_loss, min_required_gain(null, path))
    claimed = {effect.effect.name for effect in decision.effects}
    claimed |= {name for effect in decision.effects for name in effect.alternatives}
    out: list[RejectedCandidate] = []
    for h in sorted(path.singles(), key=penalised_loss):
        active = h.effects[0]
        if active.effect.name in claimed | {c.name for c in out} or h.loss >= null.loss:
            continue
        deviation = effect_deviations(likelihood, h)[0]
        out.append(
            RejectedCandidate(
                active.effect.name,
                confidence_intervals(active, deviation, likelihood.surrogate_variance_share()),
                round((null.loss - h.loss) / max(least, null.loss - h.loss), 3),
                active.activation.kind,
                _reason(likelihood, h, path, decision),
            )
        )
        if len(out) == MAX_CANDIDATES_LISTED:
            break
    return out


def _reason(likelihood: Likelihood, h: Hypothesis, path: SelectionPath, decision: Decision) -> str:
    null = path.levels[0][0]
    if not is_improvement(h, null, path):
        gain = max(penalised_loss(null) - penalised_loss(h), 0.0)
        return (
            f"it reduces the loss by {gain:.0f}; at least {min_required_gain(null, path):.0f} is "
            "required"
        )
    if h.names and h.names[0] in decision.set_aside:
        return "physics that no known effect describes is more probable"
    if decision.effects:
        names = " and ".join(effect.effect.name for effect in decision.effects)
        verb = "fits" if len(decision.effects) == 1 else "fit"
        return f"{names} {verb} better; no significant residual remains for this effect"
    if decision.unmodelled is not None and decision.unmodelled.terms:
        return "the fitted formula explains more"
    if not significant_effects(likelihood, h, path.examined):
        return "chance reaches this size somewhere among all effects, places and onsets examined"
    if decision.verdict == NONE:
        return NOT_SUPPORTED
    return "it does not explain the errors on held-out data"
