# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Cross-validation by blocks: whether data that a fit leaves out support an explanation.

An effect or a formula must explain blocks of time that its own size was not fitted to
(`block_scores`): with the tempered likelihood of `confidence`, it is `SIGNIFICANT_ODDS` times as
probable on them as its absence,

    (sum_b d_b + c) / (2 tau) + log(prior) >= log(SIGNIFICANT_ODDS),

with d_b the loss by which its absence is worse on block b, and c the prior's cost of the unusual
tolerances by which its absence makes up for it. Blocks, not rows, are left out: rows of one block
are correlated. Onsets, places and parameters of features stay as they were searched for;
`PENALTY_PER_LOCATION` and the test of significance account for these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from adk_ros.mismatch.inference.confidence import ABSENT, ConfidenceModel, formula_log_prior
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.identifiability import Identifiability, LeftOutScores
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.library.criteria import SIGNIFICANT_ODDS
from adk_ros.mismatch.library.sensitivity import decided


def least_supported(
    likelihood: Likelihood, identifiability: Mapping[int, Identifiability]
) -> int | None:
    """
    Return which effect of a hypothesis the left-out blocks support least, if too little.

    None where they support each of them.
    """
    gains = {
        i: dict(one.alternatives_to)[ABSENT].total - one.scores.total
        for i, one in identifiability.items()
    }
    if not gains:
        return None
    weakest = min(gains, key=lambda i: gains[i])
    supported = _is_supported(gains[weakest], 0.0, likelihood.surrogate_error_dof())
    return None if supported else weakest


def is_formula_supported(
    likelihood: Likelihood, without: Hypothesis, formula: Hypothesis, terms: int, tried: int = 1
) -> bool:
    """
    Whether left-out blocks support a formula of so many terms against its absence.

    `tried`: formulas among which it was chosen by these blocks, each as probable.
    """
    losses = [LeftOutScores.of(likelihood, h).total for h in (without, formula)]
    log_prior = formula_log_prior(terms) - math.log(tried)
    return _is_supported(losses[0] - losses[1], log_prior, likelihood.surrogate_error_dof())


def _is_supported(gain: float, log_prior: float, surrogate_error: float) -> bool:
    tempering = ConfidenceModel().tempering(surrogate_error)
    return bool(
        decided(
            lambda odds: gain / (2.0 * tempering) + log_prior >= math.log(odds),
            SIGNIFICANT_ODDS=SIGNIFICANT_ODDS,
        )
    )
