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
from adk_ros.mismatch.inference.decision import Decision, reassessed
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import NONE
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.validation import Validation


def without_places_on_slopes(
    decision: Decision,
    training: Likelihood,
    path: SelectionPath,
    evidence: Sequence[Evidence],
    validated: Callable[[Decision], Validation],
) -> Decision:
    """
    Return a decision without the effects at places that no held-out error asks for.

    :param path: of the selection, with the hypothesis without effects. :param validated: judges a
    decision.
    """
    effects = decision.hypothesis.effects
    left = [active for active in effects if not active.activation.segments]
    if len(left) == len(effects) or all(item.log.road is None for item in evidence):
        return decision
    without = Decision(NONE, [], None, path.levels[0][0], None)
    if left:
        without = reassessed(decision, training, path, left)
    return without if validated(without).errors.is_explained else decision
