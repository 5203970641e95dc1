# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of the confidence: its constants with the largest likelihood of claims right or wrong.

A claim is an effect that a report names; it is right if the label has the effect, or one that no
recording distinguishes from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from adk_ros.bench.mismatch.reliability import ScoredClaim
from adk_ros.mismatch.inference.confidence import ConfidenceModel, Evidence
from adk_ros.numerics.arrays import FloatArray

_LEAST_PROBABILITY = 0.002
"""Bound of a probability: one claim that is wrong must not outweigh all others."""
_START = np.log([0.03, 2.0, 5e-3])
_BOUNDS = np.log([[1e-3, 1.0], [0.1, 6.0], [1e-4, 0.1]])
"""Of the three constants."""
_EXPONENT_SPREAD = 0.5
"""Prior standard deviation of the exponent's logarithm, around that of a variance: 2."""


class Claim(NamedTuple):
    """A named effect: the evidence for it, the largest held-out error ratio, and the truth."""

    evidence: Evidence
    error_ratio: float
    right: bool


def claims_of(label: dict[str, Any], answer: dict[str, Any]) -> list[Claim]:
    """Return the claims of an answer (the content of mismatch.json)."""
    true = {effect["name"] for effect in label["effects"]}
    ratios = [
        ratio
        for errors in answer["fit"].get("horizons", {}).values()
        for ratio in errors["ratio"].values()
        if ratio is not None
    ]
    claims = []
    for effect in answer["effects"]:
        given = effect["evidence"]
        alternatives = given["alternatives"]
        evidence = Evidence(
            tuple(x["name"] for x in alternatives),
            np.array([x["block_losses"] for x in alternatives], dtype=np.float64),
            np.array([x["log_prior"] for x in alternatives]),
            float(given["surrogate_error"]),
            np.array([x["prior_cost"] for x in alternatives]),
        )
        # What joined the alternatives for its probability is itself among those of the evidence.
        named = {effect["name"], *effect["alternatives"]} - set(evidence.names)
        claims.append(Claim(evidence, max(ratios, default=0.0), bool(named & true)))
    return claims


def fit_confidence(claims: Sequence[Claim]) -> ConfidenceModel:
    """
    Return the constants of the posterior that make the claims most probable.

    With Jeffreys' prior on the error of a claim that no fitted alternative doubts: half a right
    and half a wrong one at the median error ratio. Few wrong claims do not determine how the odds
    grow with that ratio: their exponent has a prior.
    """
    right = np.array([claim.right for claim in claims])
    usual = float(np.median([claim.error_ratio for claim in claims]))

    def cost(x: FloatArray) -> float:
        model = _model(x)
        p = np.clip(probabilities(model, claims), _LEAST_PROBABILITY, 1 - _LEAST_PROBABILITY)
        odds = model.unlisted_odds * usual**model.unlisted_exponent
        prior = np.log1p(odds) - 0.5 * np.log(odds)
        prior += 0.5 * ((x[1] - _START[1]) / _EXPONENT_SPREAD) ** 2
        return float(prior - np.log(np.where(right, p, 1.0 - p)).sum())

    found = minimize(
        cost, _START, method="Nelder-Mead", bounds=[(float(a), float(b)) for a, b in _BOUNDS]
    )
    return _model(found.x)


def probabilities(model: ConfidenceModel, claims: Sequence[Claim]) -> FloatArray:
    """Return the probability (n,) of each claim."""
    return np.array(
        [1.0 - sum(model.posterior(x.evidence, x.error_ratio).values()) for x in claims]
    )


def stated(model: ConfidenceModel, claims: Sequence[Claim]) -> list[ScoredClaim]:
    """Return the claims with the confidence that a model states."""
    found = zip(probabilities(model, claims), claims, strict=True)
    return [ScoredClaim("", float(p), claim.right) for p, claim in found]


def _model(x: FloatArray) -> ConfidenceModel:
    return ConfidenceModel(*(float(value) for value in np.exp(x)))
