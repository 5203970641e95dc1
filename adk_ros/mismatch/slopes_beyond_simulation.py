# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects at places of a road whose slopes the simulation lacks.

The surrogate model's error is known from the simulation's road. On slopes that only the recording
has it is larger, at the places of these slopes: an effect there may stand for it. Such an effect
is claimed only where the simulation, on the measured road, leaves an error of a held-out state
that is not explained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.result import NONE
from adk_ros.mismatch.validation import Validation


def without_places_on_slopes(
    decision: Decision,
    null: Hypothesis,
    evidence: Sequence[Evidence],
    validated: Callable[[Decision], Validation],
) -> Decision:
    """
    Return a decision for nothing in place of effects at places that no held-out error asks for.

    :param null: the hypothesis without effects. :param validated: judges a decision.
    """
    has_place = any(active.activation.segments for active in decision.hypothesis.effects)
    if not has_place or all(item.log.road is None for item in evidence):
        return decision
    nothing = Decision(NONE, [], None, null, None)
    return nothing if validated(nothing).errors.is_explained else decision
