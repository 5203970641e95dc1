# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Claims and similar ones, compared by the loss of recordings that are linearised at each.

A delay and a lag have the same derivative at zero, so the linear problem cannot separate them;
linearised at the one, the other looks worse than it is, and keeps the place of what was claimed
first. So a few recordings in which a claim acts are linearised again with each confusable effect
of the same unit in its place, and the one that leaves less of their loss stays.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.evidence import RECORDING, Evidence, Row, column_of
from adk_ros.fleet.inference.fleet_candidates import (
    MIN_GAIN_PER_NULL_EXCESS,
    Identity,
    identity,
)
from adk_ros.fleet.inference.fleet_estimate import EvidenceAt, FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import nuisance_prior, remaining_excess
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import INDISTINGUISHABLE_LOSS
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.bounded_quadratic import bounded_maxima

SAMPLE = 6
"""Recordings that are linearised at each effect, those that say most about it. By choice."""
_LINEARISATIONS = 2
"""Of each effect in place of a claim: the first is at the size of the claim."""
_FREE_PRIOR = 1e-6
"""Information on a size in a recording, so that one which it does not show has a solution."""


def exchanged_for_competing(
    estimate: FleetEstimate,
    rows: Mapping[str, Sequence[Row]],
    evidence_at: EvidenceAt,
    kept: Collection[Identity] = (),
) -> tuple[FleetEstimate, dict[Identity, Identity]]:
    """
    Return the estimate with claims exchanged for similar effects that leave less of the loss.

    And what was compared and leaves more of it -> what is claimed in its place. `rows`: of each
    recording that is linearised at `estimate`. `kept`: what claims are about that stay. Only the
    claims are changed, at which recordings are linearised.
    """
    given = estimate
    worse: dict[Identity, Identity] = {}
    for i, claim in enumerate(estimate.claims):
        key = parameter_of(estimate, claim)
        known = identity(claim.candidate)
        if not is_compared(estimate, claim, kept):
            continue
        usable = _unclaimed_parameters(estimate, claim)
        sample = Sample.of(estimate, claim, rows)
        if not sample.names:
            continue
        at_claim = rows if estimate is given else sample.rows_at(estimate, evidence_at)
        if at_claim is None:
            continue
        left = {known: sample.excess(estimate, at_claim)}
        best, least = claim, left[known] - sample.margin
        # What is similar to a better one is compared as well: clock offset, delay, lag.
        while competing := [k for k in competing_keys(key) if k in usable]:
            for other in competing:
                found, excess = fitted_in_place(estimate, i, other, sample, evidence_at)
                if found is None:
                    continue
                left[identity(found.candidate)] = excess
                if excess < least:
                    best, least, key = found, excess, other
            usable.difference_update(competing)
        winner = identity(best.candidate)
        worse |= {one: winner for one, x in left.items() if x > left[winner] + sample.margin}
        estimate = estimate if best is claim else with_claim(estimate, i, best)
    return estimate, worse


def is_compared(
    estimate: FleetEstimate, claim: Assessment, kept: Collection[Identity] = ()
) -> bool:
    """Whether there are similar effects to compare a claim with, and it is none that stays."""
    if identity(claim.candidate) in kept:
        return False
    similar = competing_keys(parameter_of(estimate, claim))
    return not _unclaimed_parameters(estimate, claim).isdisjoint(similar)


def _unclaimed_parameters(estimate: FleetEstimate, claim: Assessment) -> set[str]:
    """Return the parameters that are not claimed at the level of a claim."""
    level = identity(claim.candidate)[1]
    claimed = {
        parameter_of(estimate, c) for c in estimate.claims if identity(c.candidate)[1] == level
    }
    return set(estimate.fleet.columns.effects) - claimed


def parameter_of(estimate: FleetEstimate, claim: Assessment) -> str:
    """Return the parameter of a claim."""
    return estimate.fleet.columns.effects[claim.candidate.effect]


def competing_keys(key: str) -> list[str]:
    """
    Return the parameters of the same unit that the catalogue calls confusable with one.

    Only where one of both is not linear, that is, has start values (`EffectParameter.starts`).
    """
    own = column_of(key)
    name = own.effect.name
    return [
        f"{other.name}.{p.name}"
        for other in EFFECTS.values()
        if other.name in own.effect.confusables or name in other.confusables
        for p in other.parameters
        if p.unit == own.parameter.unit and (p.starts or own.parameter.starts)
    ]


@dataclass(frozen=True)
class Sample:
    """Recordings in which a claim acts, with the share of its size and their dispersion."""

    names: tuple[str, ...]
    shares: FloatArray
    dispersions: FloatArray
    margin: float
    """Loss by which one effect must be better than the other."""

    @classmethod
    def of(
        cls,
        estimate: FleetEstimate,
        claim: Assessment,
        rows: Mapping[str, Sequence[Row]],
        weights: FloatArray | None = None,
    ) -> Sample:
        """
        Return a sample of the recordings that are in `rows`.

        Of those with the largest `weights` (r,), by default their information on the claim over
        what each adds to the margin: a large other effect leaves more by its inexact equation than
        a delay that is a lag.
        """
        fleet, design = estimate.fleet, claim.candidate.design
        column = fleet.columns.first_effect + claim.candidate.effect
        inexact = MIN_GAIN_PER_NULL_EXCESS * estimate.selection.null_excess
        if weights is None:
            information = fleet.informations[:, column, column] * design**2
            weights = information / (INDISTINGUISHABLE_LOSS / SAMPLE + inexact)
        usable = np.array([name in rows for name in fleet.names]) & (design > 0.0)
        order = [int(i) for i in np.argsort(-weights) if usable[i]][:SAMPLE]
        names = tuple(fleet.names[i] for i in order)
        return cls(
            names,
            design[order],
            np.array([_evidence(fleet, rows[name]).dispersion for name in names]),
            INDISTINGUISHABLE_LOSS + float(inexact[order].sum()),
        )

    def required(self, estimate: FleetEstimate) -> float:
        """Return the loss that a further claim must save in these recordings."""
        excess = remaining_excess(estimate.fleet, estimate.model)
        return self.sum_of(estimate, estimate.selection.required(excess))

    def sum_of(self, estimate: FleetEstimate, values: FloatArray) -> float:
        """Return the sum of values (r,) over these recordings."""
        return float(sum(values[estimate.fleet.names.index(name)] for name in self.names))

    def rows_at(
        self, estimate: FleetEstimate, evidence_at: EvidenceAt
    ) -> dict[str, list[Row]] | None:
        """Return the rows of each recording at an estimate; None if one has no evidence there."""
        every, failed = evidence_at(estimate, self.names)
        if failed:
            return None
        return {name: [row for row in every if row["recording"] == name] for name in self.names}

    def excess(self, estimate: FleetEstimate, rows: Mapping[str, Sequence[Row]]) -> float:
        """
        Return the least loss of all recordings, above that of a perfect model.

        By the dispersion of the sample: at a worse effect residuals are more correlated, and a
        loss over their own dispersion would look smaller.
        """
        dispersions = dict(zip(self.names, self.dispersions.tolist(), strict=True))
        return remaining_loss(estimate, {name: rows[name] for name in self.names}, dispersions)


def remaining_loss(
    estimate: FleetEstimate,
    rows: Mapping[str, Sequence[Row]],
    dispersions: Mapping[str, float] | None = None,
) -> float:
    """
    Return the least loss of recordings, above that of a perfect model, with the claims there.

    `rows`: of each recording, linearised at `estimate`. `dispersions`: by default those of `rows`.
    """
    found = {name: _evidence(estimate.fleet, of_one) for name, of_one in rows.items()}
    return sum(
        local_fit(one, estimate.values_of(name)).excess
        / (one.dispersion if dispersions is None else dispersions[name])
        for name, one in found.items()
    )


@dataclass(frozen=True)
class LocalFit:
    """
    Least excess loss of a recording near where it was linearised.

    `sizes`: parameter -> difference of the fitted variable from neutral, in thresholds.
    """

    excess: float
    sizes: Mapping[str, float]


def local_fit(evidence: Evidence, values: Mapping[str, float]) -> LocalFit:
    """
    Return the fit of one recording with the parameters of `values` free, within their bounds.

    Build tolerances, sensor offsets and weak directions are free within theirs.
    """
    columns = evidence.columns
    k = columns.first_effect
    keys = [key for key in columns.effects if key in values]
    which = [*range(k), *(k + columns.effects.index(key) for key in keys)]
    bounds = np.array([columns.column(key).bounds for key in keys]).reshape(-1, 2)
    middle = np.concatenate([np.zeros(k), bounds.mean(axis=1)])
    width = np.concatenate([columns.nuisance_bounds, 0.5 * (bounds[:, 1] - bounds[:, 0])])
    information = evidence.information[np.ix_(which, which)]
    score = evidence.score[which]
    prior = np.concatenate([nuisance_prior(columns), np.full(len(keys), _FREE_PRIOR)])
    right = score - information @ middle
    left = information + np.diag(prior)
    x = middle + bounded_maxima(left[None], right[None], width)[0]
    gain = 2.0 * score @ x - x @ information @ x
    return LocalFit(float(evidence.excess - gain), dict(zip(keys, x[k:], strict=True)))


def fitted_in_place(
    estimate: FleetEstimate, i: int, key: str, sample: Sample, evidence_at: EvidenceAt
) -> tuple[Assessment | None, float]:
    """Return a claim with another parameter, fitted to a sample, and the loss that it leaves."""
    claim, columns = estimate.claims[i], estimate.fleet.columns
    before, column = columns.column(columns.effects[claim.candidate.effect]), columns.column(key)
    candidate = replace(claim.candidate, effect=columns.effects.index(key))
    size = claim.size * before.materiality / column.materiality
    low, high = column.bounds
    excess = np.inf
    for _ in range(_LINEARISATIONS):
        if not low < size < high:
            return None, np.inf
        found = replace(claim, candidate=candidate, size=size)
        at = with_claim(estimate, i, found)
        rows = sample.rows_at(at, evidence_at)
        if rows is None:
            return None, np.inf
        excess = sample.excess(at, rows)
        others = with_claim(estimate, i, replace(found, size=0.0))
        sizes = []
        for name, share in zip(sample.names, sample.shares, strict=True):
            fit = local_fit(_evidence(at.fleet, rows[name]), at.values_of(name))
            other = others.values_of(name).get(key, 0.0) / column.materiality
            sizes.append((fit.sizes.get(key, 0.0) - other) / share)
        size = float(np.median(sizes))
    return replace(found, size=float(np.clip(size, low, high))), excess


def with_claim(estimate: FleetEstimate, i: int, claim: Assessment) -> FleetEstimate:
    return replace(estimate, claims=(*estimate.claims[:i], claim, *estimate.claims[i + 1 :]))


def _evidence(fleet: FleetEvidence, rows: Sequence[Row]) -> Evidence:
    one = next(Evidence.from_row(row) for row in rows if row["kind"] == RECORDING)
    return one.from_origin(fleet.origin)
