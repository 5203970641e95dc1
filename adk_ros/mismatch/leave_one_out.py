# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Agreement of several recordings: sizes from each alone, and predictions of each by the others.

Which effects there are, their places and onsets come from the training parts of all recordings;
sizes and nuisance parameters of a prediction come from the other recordings only.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from adk_ros.mismatch.inference.agreement import (
    active_duration,
    agreements,
    best_single,
    sizes_from,
)
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.final_estimate import refitted
from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import Agreement, LeftOutErrors
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.library.criteria import MIN_ACTIVE_S
from adk_ros.mismatch.recorded_data import RecordedData
from adk_ros.mismatch.validation import correction_errors


def agreement_of(
    data: RecordedData, decision: Decision, likelihood: Likelihood, path: SelectionPath
) -> Agreement | None:
    """
    Compare recordings under a decision that is fitted to all; None for a single recording.

    An effect of different size in each recording may fit none of them and be rejected: the best
    single effect of the selection is compared, too.
    """
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
        # A prediction applies effects with an onset throughout.
        here = likelihood.restricted_to({i})
        acting = tuple(a for a in h.effects if active_duration(a, here) >= MIN_ACTIVE_S)
        h = replace(h, effects=acting)
        errors = correction_errors(data.surrogate, h, data.lap, [data.evidence(data.parts[i].log)])
        left_out.append(LeftOutErrors(*errors))
    rows = agreements(decision, alone)
    single = best_single(path, decision)
    if single is not None:
        single = refitted(single, likelihood)
        sizes = [sizes_from(single, likelihood, {i}) for i in every]
        rows += [replace(row, claimed=False) for row in agreements(single, sizes) if row.disagree]
    return Agreement(data.recordings, tuple(rows), tuple(left_out))
