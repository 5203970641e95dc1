# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Claims that held-out data take back.

What is claimed of an unknown cause is withdrawn where it leaves most of the error. Effects of the
vehicle, and a formula where noise may explain the recording without it, are withdrawn where every
error was explained without them and their correction raises one and does not lower them on the
whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.feature_effect import FeatureEffect
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.result import (
    EXPLAINED,
    NONE,
    UNKNOWN,
    UnexplainedResidual,
)
from adk_ros.mismatch.library.criteria import MAX_EXPLAINED_RATIO, MIN_REMOVED_SHARE
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.validation import Validation, error_text


def is_refuted(decision: Decision, validation: Validation) -> bool:
    """
    Whether held-out errors refute what a verdict of an unknown cause claims.

    They do where no state's error falls by `MIN_REMOVED_SHARE` of what could be removed, with the
    correction that is exported, or with one that is rejected and explains a state in full. Faults
    of sensors and terms with a phase of their own recording are not corrected, and not refuted.
    """
    effects = decision.hypothesis.effects
    corrected = all(
        is_transferable(a.effect.feature)
        if isinstance(a.effect, FeatureEffect)
        else not a.effect.sensor
        for a in effects
    )
    if decision.verdict != UNKNOWN or not effects or not corrected:
        return False
    errors = validation.errors
    before, after, expected = (
        x**2 for x in (errors.before, validation.described, errors.expected)
    )
    with np.errstate(invalid="ignore"):
        removable = before > MAX_EXPLAINED_RATIO**2 * expected
    removable &= np.isfinite(after)
    if not removable.any():
        return False
    shares = (before - after)[removable] / (before - expected)[removable]
    return decided(lambda least: bool(shares.max() < least), MIN_REMOVED_SHARE=MIN_REMOVED_SHARE)


def is_contradicted(decision: Decision, validation: Validation) -> bool:
    """
    Whether held-out errors speak against effects that explain a recording, or a weak formula.

    They do where noise, build tolerance and the surrogate's own error explained every error before
    the correction, and this raises one beyond chance and does not lower the errors on the whole,
    so that nothing is exported.
    """
    errors, effects = validation.errors, decision.hypothesis.effects
    claims = decision.verdict == EXPLAINED or decision.excess_is_small
    if not claims or not validation.contradicted:
        return False
    if any(active.effect.sensor for active in effects):
        return False
    return decided(
        lambda most: not bool((errors.before > most * errors.expected).any()),
        MAX_EXPLAINED_RATIO=MAX_EXPLAINED_RATIO,
    )


def nothing_missing(null: Hypothesis) -> Decision:
    """Return the decision that nothing is missing, for `null`, the hypothesis of no effect."""
    return Decision(NONE, [], None, null, None)


def withdrawn(decision: Decision, null: Hypothesis) -> Decision:
    """
    Return the decision that something is unexplained, without effects and formula.

    That nothing is missing, where all channels together leave no more than noise may.
    """
    if decision.excess_is_small:
        return nothing_missing(null)
    equations = [] if decision.unexplained is None else decision.unexplained.equations
    left = UnexplainedResidual(equations, 1.0, "", "")
    return Decision(UNKNOWN, [], left, null, None)


def nothing_named(decision: Decision) -> bool:
    """Whether something is unexplained, with neither an effect nor a formula for it."""
    left = decision.unexplained
    return left is not None and not left.terms and not decision.effects


def described_by_errors(decision: Decision, validation: Validation, reason: str) -> Decision:
    """Return a decision whose unexplained residual is described by the held-out errors."""
    assert decision.unexplained is not None
    states = validation.errors.unexplained_states()
    text = f"{error_text(validation.errors, states[0])}; {reason}" if states else reason
    equations = states or decision.unexplained.equations
    left = replace(decision.unexplained, equations=equations, text=text)
    return replace(decision, unexplained=left)
