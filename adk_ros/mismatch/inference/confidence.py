# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Confidence: the posterior probability that an identified effect is present.

The alternatives to an effect are: no effect in its place, each competing effect that the data
distinguish from it, a formula of features in place of all effects, and physics that neither
describes. All but the last were fitted; their losses on blocks left out (`block_scores`) exceed
that of the hypothesis by d_ab in block b, and the prior's cost of the nuisance parameters that
they need by c_a: an alternative that fits as well only with unusual tolerances is less probable.
With weights w_b of a Bayesian bootstrap over the blocks
(D. B. Rubin, Ann. Statist. 9 (1981) 130) the odds of alternative a against the effect are

    prior_a exp(-(sum_b w_b d_ab + c_a) / (2 tau)),
    tau = 1 + CONFIDENCE_PER_SURROGATE_ERROR S,

with prior_a = 1 except for a formula, which was chosen among many, and S the loss of the
surrogate's own error. It repeats on every lap and favours one of two similar effects, so that tau
tempers the likelihood. A further term in proportion to the loss that the hypothesis saves, for
equations that are not exact, has a most likely share below 1e-6, the least examined (`--calibrate`
at bf901ba), and is left out between effects. A formula with more coefficients than the effects
contains them and what is inexact in them: its c_a has INDISTINGUISHABLE_LOSS_SHARE of that loss in
addition. The odds of undescribed physics rise with the largest held-out error r, over what a
correct model explains: UNLISTED_ODDS r^UNLISTED_EXPONENT. The probability is the mean over the
bootstrap of 1 / (1 + all odds): pseudo-Bayesian model averaging (Y. Yao, A. Vehtari, D. Simpson,
A. Gelman, "Using stacking to average Bayesian predictive distributions", Bayesian Analysis 13
(2018) 917).

`library.criteria` names the source of the constants; `adk bench concealed --calibrate` prints
their most likely values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.criteria import (
    CONFIDENCE_PER_SURROGATE_ERROR,
    UNLISTED_EXPONENT,
    UNLISTED_ODDS,
)
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS
from adk_ros.numerics.arrays import FloatArray

ABSENT, UNLISTED = "none", "unlisted"
"""Names of two alternatives: no effect, and physics that the catalogue does not list."""
_DRAWS = 400
"""Draws of the bootstrap: their mean is exact to a few per cent of a small probability."""
_MAX_LOG_ODDS = 50.0


def formula_log_prior(terms: int) -> float:
    """
    Return the logarithm of the prior odds of a formula of so many terms against an effect.

    The formula was chosen among all features in four equations, term by term.
    """
    return -terms * float(np.log(len(EQUATION_PARAMETERS) * len(FEATURES)))


@dataclass(frozen=True)
class Evidence:
    """
    What speaks for an effect.

    `names` (a) of the alternatives, `differences` (a, b) of their losses on blocks left out,
    `log_priors` (a) of their prior odds, `surrogate_error`: the loss of the surrogate's own error,
    `prior_costs` (a): by how much their nuisance parameters cost more than the effect's, and of a
    formula what inexact equations leave of the effects' gain; 0: none.
    """

    names: tuple[str, ...]
    differences: FloatArray
    log_priors: FloatArray
    surrogate_error: float = 0.0
    prior_costs: FloatArray | float = 0.0

    def margins(self) -> dict[str, float]:
        """Return the loss by which each alternative is worse."""
        sums = self.differences.sum(axis=1) + self.prior_costs
        return {name: float(x) for name, x in zip(self.names, sums, strict=True)}


@dataclass(frozen=True)
class ConfidenceModel:
    """The constants of the posterior."""

    unlisted_odds: float = UNLISTED_ODDS
    unlisted_exponent: float = UNLISTED_EXPONENT
    per_surrogate_error: float = CONFIDENCE_PER_SURROGATE_ERROR

    def tempering(self, surrogate_error: float) -> float:
        """Return tau: by how much a difference of losses overstates the evidence."""
        return 1.0 + self.per_surrogate_error * surrogate_error

    def posterior(self, evidence: Evidence, error_ratio: float) -> dict[str, float]:
        """
        Return the probability of each alternative; the rest is that of the effect.

        `error_ratio`: largest held-out error over what a correct model explains.
        """
        count = evidence.differences.shape[1]
        weights = np.random.default_rng(0).dirichlet(np.ones(count), _DRAWS) * count
        tau = self.tempering(evidence.surrogate_error)
        losses = weights @ evidence.differences.T + evidence.prior_costs
        log_odds = evidence.log_priors - losses / (2.0 * tau)
        odds = np.exp(np.clip(log_odds, -_MAX_LOG_ODDS, _MAX_LOG_ODDS))
        unlisted = self.unlisted_odds * max(error_ratio, 1e-3) ** self.unlisted_exponent
        every = np.column_stack([odds, np.full(_DRAWS, unlisted)])
        shares = (every / (1.0 + every.sum(axis=1, keepdims=True))).mean(axis=0)
        out = dict.fromkeys((*evidence.names, UNLISTED), 0.0)
        for name, share in zip((*evidence.names, UNLISTED), shares, strict=True):
            out[name] += float(share)
        return out
