# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Significance of effects among all that were examined."""

from __future__ import annotations

from scipy.special import stdtrit

from adk_ros.mismatch.inference.block_scores import BlockScores, effect_variables
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE, MIN_SEGMENT_TRANSITIONS
from adk_ros.mismatch.surrogate.activation import TRANSITION_LENGTH_M


def significant_effects(
    likelihood: Likelihood, h: Hypothesis, examined: int
) -> list[ActiveEffect]:
    """
    Return the effects that are material, significantly non-zero, and in segments of some length.

    Next to a large effect whose equation is inexact, a small one may reduce the loss without being
    present; its size is then uncertain from block to block, or its segments shrink to less than
    their transitions. Significant is a size of more than `least_significant` deviations, among the
    `examined` effects, places and onsets.
    """
    scores = BlockScores.of(likelihood, h)
    sigma, blocks = scores.deviations(), scores.losses.size

    def is_significant(active: ActiveEffect, part: slice) -> bool:
        variables = range(part.start, part.stop)
        return any(
            abs(theta - parameter.theta_neutral)
            > least_significant(scores.active_blocks(j), blocks, examined * len(variables))
            * sigma[j]
            for parameter, theta, j in zip(
                active.effect.parameters, active.theta, variables, strict=True
            )
        )

    return [
        active
        for active, part in zip(h.effects, effect_variables(h), strict=True)
        if isinstance(active.effect, FeatureEffect)
        or (active.is_material() and _is_extended(active) and is_significant(active, part))
    ]


def least_significant(active: int, blocks: int, tests: int) -> float:
    """
    Return the deviations that a significant size exceeds: Student's t, two-sided.

    Noise, which all `blocks` of the recording show, must exceed it in none of `tests`. An effect
    that acts in few blocks must also be alike in those, in a single test over `active` blocks.
    """
    return max(critical_value(blocks, tests), critical_value(active, 1))


def critical_value(blocks: int, tests: int) -> float:
    """Return what Student's t over `blocks` exceeds by chance in any of `tests`, two-sided."""
    tail = FAMILYWISE_ERROR_RATE / (2.0 * max(tests, 1))
    return float(-stdtrit(max(blocks - 1, 1), tail))


def _is_extended(active: ActiveEffect) -> bool:
    """Whether an effect has no segments, or one that is longer than its transitions."""
    shortest = MIN_SEGMENT_TRANSITIONS * TRANSITION_LENGTH_M
    segments = active.activation.segments
    return not segments or any(b - a > shortest for a, b in segments)
