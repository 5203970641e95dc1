# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Ties of a claim: what else explains a fleet as well, and candidates that are not claimed.

A candidate takes the place of a claim and is fitted with its variance components. With E the
evidence (t^2 with the variance of the model), half its difference is a logarithm of odds. The
surrogate's error, the same in all recordings, moves that difference: with V the variance and F the
response of a size to a score b ~ N(0, B) of the simulation, by (size / V F - size' / V' F') b. The
candidate is a tie if its odds are below `criteria.SIGNIFICANT_ODDS` plus what that error exceeds
in one of twenty cases, if it leaves little of the claim next to it, and if there are recordings in
which both act.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from adk_ros.fleet.inference.assessment import Assessment, extended
from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.exchange import likelier_pairs
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, SHARED, same_recordings
from adk_ros.mismatch.library.catalogue import INSEPARABLE
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE, SIGNIFICANT_ODDS
from adk_ros.numerics.arrays import FloatArray

_EXAMINED = 6
"""Candidates that are fitted in place of a claim, those of the largest gains. By choice."""
_LEAST_SHARE = 0.7
"""Of a claim's evidence: the least gain of such a candidate. By choice."""
MAX_LISTED = 8
"""Most candidates that are listed as not claimed. By choice."""


@dataclass(frozen=True)
class Unclaimed:
    """A candidate that is not claimed, and why."""

    assessment: Assessment
    reason: str


def ties_of(selection: Selection, model: FleetModel, claim: Assessment) -> list[Candidate]:
    """Return the candidates that explain a fleet as well as a claim, best first."""
    fleet = selection.fleet
    candidate = claim.candidate
    same = [
        Candidate(candidate.effect, level, candidate.design)
        for level in same_recordings(fleet, candidate.level, selection.every_level)
    ]
    rest = replace(model, claimed=tuple(c for c in model.claimed if c is not candidate))
    effects = {c.effect for c in rest.claimed}
    if candidate.effect not in effects:
        rest = replace(rest, components={k: v for k, v in rest.components.items() if k in effects})
    found: list[tuple[float, Candidate]] = []
    least = _LEAST_SHARE * claim.evidence
    for gain, other in selection.ranked(rest):
        if gain < least or len(found) == _EXAMINED:
            break
        if (other.effect, other.level) == (candidate.effect, candidate.level):
            continue
        # An effect of other recordings explains this claim only by how much cars may differ.
        if not (other.design * candidate.design).any():
            continue
        one = selection.assess(rest, other)
        if not selection.is_possible(one):
            continue
        difference = 0.5 * (claim.evidence - one.evidence)
        direction = _direction(claim) - _direction(one)
        systematic = float(np.sqrt(np.maximum(direction @ fleet.bias @ direction, 0.0)))
        margin = float(np.log(SIGNIFICANT_ODDS)) - float(ndtri(FAMILYWISE_ERROR_RATE)) * systematic
        is_near = difference < margin or _are_inseparable(fleet, candidate, other)
        if is_near and _excludes(selection, rest, one, claim):
            found.append((difference, other))
    return [*same, *(other for _, other in sorted(found, key=lambda pair: pair[0]))]


def tied_pairs(
    selection: Selection, model: FleetModel, claim: Assessment
) -> list[tuple[Candidate, Candidate]]:
    """
    Return pairs of effects of all cars that are likelier than a claim; none if no pair is.

    Such a pair is not claimed where the inexact equation of the claim may leave the difference
    (`fleet_model.inexactness`): a payload, or larger wheels and a rotating inertia.
    """
    if claim.candidate.level.kind != SHARED:
        return []
    rest = selection.without(model, claim.candidate)
    return [
        (both.claimed[-2], both.claimed[-1])
        for both in likelier_pairs(selection, model, rest, claim, 0.0)
    ]


def _are_inseparable(fleet: FleetEvidence, a: Candidate, b: Candidate) -> bool:
    """Whether no drive separates two effects, at one level: their equations differ by chance."""
    names = {column_of(fleet.columns.effects[c.effect]).effect.name for c in (a, b)}
    return a.level == b.level and any(names <= group for group in INSEPARABLE)


def _excludes(
    selection: Selection, rest: FleetModel, other: Assessment, claim: Assessment
) -> bool:
    """Whether one of two candidates leaves little of the other: else they explain other data."""
    beside = selection.assess(extended(rest, other), claim.candidate)
    return beside.evidence < _LEAST_SHARE * claim.evidence


def _direction(one: Assessment) -> FloatArray:
    """Return how a score of the simulation changes half of the evidence, to first order."""
    return np.asarray(one.evidence / (one.size or 1.0) * one.response)


def unclaimed(selection: Selection, model: FleetModel) -> list[Unclaimed]:
    """Return the candidates of the largest gains that are not claimed, one per parameter."""
    out: list[Unclaimed] = []
    seen: set[int] = set()
    for gain, candidate in selection.ranked(model):
        if candidate.effect in seen:
            continue
        seen.add(candidate.effect)
        found = selection.assess(model, candidate)
        out.append(Unclaimed(found, _reason(selection, model, found, gain)))
        if len(out) == MAX_LISTED:
            break
    return out


def _reason(selection: Selection, model: FleetModel, found: Assessment, gain: float) -> str:
    if not selection.is_possible(found):
        return "the parameter would leave its range: another effect that the catalogue lacks"
    if not selection.is_material(found):
        of = "the mean of all cars" if found.candidate.level.kind == SHARED else "a car"
        return f"within the build tolerance of {of}"
    if selection.is_significant(found):
        if not selection.explains(model, found):
            return "significant, but it explains too little of what differs"
        return "significant, but no longer next to the claimed effects"
    if found.evidence < 0.5 * gain:
        level = "recordings" if found.candidate.level.kind == CAR else "recordings or cars"
        return f"the size differs between {level} as much as its mean"
    fleet = selection.fleet
    tests = selection.rates.tests_of(found.candidate.level)
    further = ""
    if (
        found.candidate.level.kind == SHARED
        and fleet.error is None
        and fleet.systematic_deviation(found.candidate.effect) > 0.5 * found.deviation
    ):
        further = "; --further-simulation lowers that error"
    return (
        f"{abs(found.size) / found.deviation:.1f} standard deviations: chance and the surrogate's "
        f"error reach that somewhere among {tests} tests at this kind of level{further}"
    )
