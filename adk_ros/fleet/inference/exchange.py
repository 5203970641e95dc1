# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One or two effects in place of one: what a forward selection cannot undo by itself.

A forward selection may take what resembles two effects together, such as less downforce for softer
tyres of both axles, or of two similar effects the one that was nearer before others were claimed.
So each claim is left out in turn. What is then selected takes its place, or the most likely of a
few other effects of its level or car, and the more likely model stays: a further parameter must
raise the logarithm of the likelihood by the penalty of one (`criteria.PENALTY_PER_PARAMETER`), and
by what the inexact equation of a claim of all cars may leave (`fleet_model.inexactness`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.fleet_candidates import identity, of_effects
from adk_ros.fleet.inference.fleet_model import (
    Candidate,
    FleetModel,
    inexactness,
    remaining_excess,
    rise,
)
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, CONDITION, SHARED, Level, is_trend
from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER

_LEAST_SHARE = 0.5
"""Share of a claim's evidence below which nothing is tried in its place. By choice."""
_EXAMINED = 4
"""Other effects of its level or car that are fitted in place of a claim. By choice."""
_MOST_EXCHANGES = 6
"""Exchanges after which the model stays as it is; bounds the time. By choice."""


def exchanged(selection: Selection, model: FleetModel) -> FleetModel:
    """Return the model with claims exchanged for what is more likely."""
    for _ in range(_MOST_EXCHANGES):
        model = plainer_levels(selection, model)
        found = next(
            (
                better
                for claim in selection.assessed(model)
                if (better := _without(selection, model, claim)) is not None
            ),
            None,
        )
        if found is None:
            return model
        model = found
    return plainer_levels(selection, model)


def plainer_levels(selection: Selection, model: FleetModel) -> FleetModel:
    """
    Return the model with claims at plainer levels that say the same.

    Of two values of a tag, next to a claim of all cars, the one with the smaller sizes: a delay of
    25 ms and 43 ms more with one software, not 68 ms and 43 ms less with the other, nor 25 ms with
    the one and 68 ms with the other. And instead of a trend what is always so, where that is as
    likely but for the change point.
    """
    for i, claim in enumerate(model.claimed):
        for level in _plainer(selection, model, claim):
            swapped = Candidate(claim.effect, level, level.design(selection.fleet))
            taken = {identity(c) for c in model.claimed}
            changed = replace(
                model, claimed=(*model.claimed[:i], swapped, *model.claimed[i + 1 :])
            )
            is_usable = selection.is_allowed(changed, identity(swapped))
            if identity(swapped) in taken or not is_usable or selection.dependents(model, claim):
                continue
            other = selection.refitted(changed)
            if rise(selection.fleet, other, model) > 0.5 * PENALTY_PER_PARAMETER:
                continue
            if is_trend(claim.level) or _extent(selection, other) < _extent(selection, model):
                return plainer_levels(selection, other)
    return model


def _plainer(selection: Selection, model: FleetModel, claim: Candidate) -> list[Level]:
    level = claim.level
    if is_trend(level):
        return [Level(CAR, car=level.car) if level.car else Level(SHARED)]
    if level.kind != CONDITION:
        return []
    of_effect = [c.level for c in model.claimed if c.effect == claim.effect]
    if Level(SHARED) not in of_effect:
        is_other = any(x.tag == level.tag and x.value != level.value for x in of_effect)
        return [Level(SHARED)] if is_other else []
    return [x for x in selection.levels if x.tag == level.tag and x != level]


def _extent(selection: Selection, model: FleetModel) -> float:
    """Return the sum of the squared sizes, in materiality thresholds."""
    return sum(one.size**2 for one in selection.assessed(model))


def _without(selection: Selection, model: FleetModel, claim: Assessment) -> FleetModel | None:
    """Return a more likely model without a claim, if there is one."""
    rest = selection.without(model, claim.candidate)
    refused = {identity(claim.candidate)}
    # What takes the place of a claim has about as much evidence as it has.
    floor = _LEAST_SHARE * claim.evidence
    single = selection.best(rest, refused, floor)
    if single is not None:
        other, _ = selection.with_claim(rest, single)
        if _gain(selection, model, other, claim.candidate, single.candidate) > 0.0:
            return other
    swapped = _with_a_likelier_one(selection, model, rest, claim.candidate)
    if swapped is not None:
        return swapped
    level = claim.candidate.level
    if level.car:
        # Two effects imitate one of a car more often than a car has two that one imitates.
        return None
    inexact = inexactness(selection.fleet, model, claim.candidate)
    return next(likelier_pairs(selection, model, rest, claim, 0.5 * inexact), None)


def _gain(
    selection: Selection, model: FleetModel, other: FleetModel, claim: Candidate, new: Candidate
) -> float:
    """Return what another claim raises the likelihood by, less the penalty of a change point."""
    has_onset = is_trend(new.level) and not is_trend(claim.level)
    return rise(selection.fleet, model, other) - 0.5 * PENALTY_PER_PARAMETER * has_onset


def likelier_pairs(
    selection: Selection, model: FleetModel, rest: FleetModel, claim: Assessment, margin: float
) -> Iterator[FleetModel]:
    """
    Yield models with two effects of its level in place of a claim that are likelier.

    `rest`: `model` without the claim. `margin`: what the logarithm of the likelihood must rise by,
    besides half a parameter's penalty. The last two claims are the pair.
    """
    level, refused = claim.candidate.level.without_onset, {identity(claim.candidate)}
    floor = 0.5 * _LEAST_SHARE * claim.evidence
    margin += 0.5 * PENALTY_PER_PARAMETER
    pairs = selection.pairs(
        rest, refused, lambda other: other.without_onset == level, floor, (model, margin)
    )
    yield from (both for both in pairs if rise(selection.fleet, model, both) > margin)


def _with_a_likelier_one(
    selection: Selection, model: FleetModel, rest: FleetModel, claim: Candidate
) -> FleetModel | None:
    """
    Return the model with the likeliest of a few other effects in place of a claim, if any is.

    `rest`: the model without the claim. Where a change point is added, the logarithm of the
    likelihood must rise by half a parameter's penalty.
    Evidence is of the size of an effect alone. An effect that all cars have as well may have much
    in one car, since the cars then seem to differ less, though another one leaves less of the
    loss: a torque offset for a brake that drags on one side.
    """
    excess = remaining_excess(selection.fleet, rest)
    best: FleetModel | None = None
    most = 0.0
    ranked = selection.ranked(rest, excess)
    for candidate in of_effects(ranked, _EXAMINED, lambda one: _competes(one, claim)):
        found = selection.with_fitted_onset(rest, selection.assess(rest, candidate))
        if not selection.is_claimable(found) or not selection.explains(rest, found, excess):
            continue
        # Both models are fitted in the same way, with the strangers that each leaves.
        other, dropped = selection.with_claim(rest, found)
        gain = _gain(selection, model, other, claim, candidate)
        if gain > most and not any(identity(one) == identity(candidate) for one in dropped):
            best, most = other, gain
    return best


def _competes(candidate: Candidate, claim: Candidate) -> bool:
    """Whether a candidate is another effect at the level of a claim, or of its car."""
    a, b = candidate.level, claim.level
    of_same = a.without_onset == b.without_onset or (a.car != "" and a.car == b.car)
    return of_same and candidate.effect != claim.effect
