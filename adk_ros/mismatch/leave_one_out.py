# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Agreement of several recordings: sizes from each alone, and predictions of each by the others.

Which effects there are, their places and onsets come from the training parts of all recordings;
sizes and nuisance parameters of a prediction come from the other recordings only.
"""

from __future__ import annotations

from functools import cache

from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.inference.agreement import agreements, sizes_from
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import Agreement, LeftOutErrors
from adk_ros.mismatch.recorded_data import RecordedData
from adk_ros.mismatch.validation import correction_errors


def agreement_of(
    data: RecordedData, decision: Decision, likelihood: Likelihood
) -> Agreement | None:
    """Compare recordings under a decision that is fitted to all; None for a single recording."""
    if not isinstance(likelihood, JointLikelihood):
        return None
    every = range(len(data.parts))

    @cache
    def fitted_to(kept: frozenset[int]) -> Decision:
        return sizes_from(decision, likelihood, kept)

    alone = [fitted_to(frozenset({i})) for i in every] if decision.effects else []
    left_out = []
    for i in every if decision.hypothesis.effects else ():
        h = fitted_to(frozenset(every) - {i}).hypothesis
        errors = correction_errors(data.surrogate, h, data.lap, [Evidence(data.parts[i].log)])
        left_out.append(LeftOutErrors(*errors))
    return Agreement(data.recordings, tuple(agreements(decision, alone)), tuple(left_out))
