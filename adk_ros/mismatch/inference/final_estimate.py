# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Final estimate: the sizes of decided effects from the whole recording."""

from __future__ import annotations

from dataclasses import replace

from adk_ros.mismatch.inference.decision import Decision, confidence_intervals
from adk_ros.mismatch.inference.fit_budget import FINAL
from adk_ros.mismatch.inference.likelihood import Likelihood


def refitted(decision: Decision, likelihood: Likelihood) -> Decision:
    """
    Return a decision with sizes, places and onsets fitted to all data of `likelihood`.

    Which effects there are stays as decided on the training part.
    """
    h = decision.hypothesis
    final = likelihood.fit(h.effects, nuisances=h.nuisances, budget=FINAL, fit_activation=True)
    deviations = final.standard_deviations()
    fitted = {
        (active.effect.name, active.activation.kind): (active, deviation)
        for active, deviation in zip(final.effects, deviations, strict=True)
    }
    effects = []
    for identified in decision.effects:
        active, deviation = fitted[identified.effect.name, identified.kind]
        activation = active.activation
        effects.append(
            replace(
                identified,
                parameters=confidence_intervals(active, deviation),
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
