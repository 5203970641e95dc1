# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One effect in place of two, or none: what a forward selection cannot undo by itself.

A forward selection may take the part of an effect that another one resembles, and then the rest: a
brake that drags on one side as rolling resistance and a steering offset. Two claims at one level,
or of one car, are therefore replaced by a single candidate if that is as likely: if the logarithm
of the likelihood falls by less than the penalty of the parameter that is saved
(`criteria.PENALTY_PER_PARAMETER`) and, of a claim of all cars, by what its inexact equation may
leave (`fleet_model.inexactness`), or if it leaves no more of the loss where they act. Tolerances
are within their bounds in the loss only, so a pair may be more likely by what no car has. Claims
that save nothing next to the others are dropped for the same reason.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations

from adk_ros.fleet.inference.assessment import extended
from adk_ros.fleet.inference.fleet_candidates import Identity, identity, of_effects
from adk_ros.fleet.inference.fleet_model import (
    Candidate,
    FleetModel,
    inexactness,
    is_steady_wind,
    remaining_excess,
    rise,
)
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER

_EXAMINED = 4
"""Effects that are fitted in place of a pair, those of the largest gains. By choice."""


def simplified(selection: Selection, model: FleetModel) -> tuple[FleetModel, set[Identity]]:
    """
    Return the model with pairs of claims replaced by single ones, as long as there are any.

    Also what was replaced by a single claim that is less likely, but not by more than its equation
    is inexact: next to that claim it would be added again.
    """
    replaced: set[Identity] = set()
    while True:
        found = _with_one_less(selection, model)
        if found is None:
            return model, replaced
        model, inexactly = found
        replaced |= inexactly


def explaining(selection: Selection, model: FleetModel) -> FleetModel:
    """
    Return the model without claims that explain nothing next to the others.

    A claim saved enough of the loss when it was selected; what came later may explain the same.
    Two that cancel, such as the rolling resistance and the torque offset of a car, are more likely
    by tolerances that no car has, and save nothing.
    """
    for claim in sorted(selection.assessed(model), key=lambda one: one.evidence):
        without = selection.without(model, claim.candidate)
        if not selection.explains(without, selection.assess(without, claim.candidate)):
            return explaining(selection, selection.without_insignificant(without)[0])
    return model


def _with_one_less(
    selection: Selection, model: FleetModel
) -> tuple[FleetModel, set[Identity]] | None:
    """Return the model with one claim less, and what only an inexact equation replaces."""
    if len(model.claimed) < 2:
        return None
    excess = remaining_excess(selection.fleet, model)

    def more_loss(changed: FleetModel, a: Candidate, b: Candidate) -> float:
        acts = (a.design > 0.0) | (b.design > 0.0)
        return float((remaining_excess(selection.fleet, changed) - excess)[acts].sum())

    for a, b in combinations(model.claimed, 2):
        if not _is_of_one_place(a, b):
            continue
        rest = selection.without(model, a, b)
        for candidate in of_effects(selection.ranked(rest), _EXAMINED, partial(_is_near, a, b)):
            if is_steady_wind(selection.fleet, candidate):
                continue
            one = selection.with_fitted_onset(rest, selection.assess(rest, candidate))
            if not selection.is_claimable(one):
                continue
            changed = extended(rest, one)
            # Of two parameters one remains.
            reached = rise(selection.fleet, model, changed) + 0.5 * PENALTY_PER_PARAMETER
            more = more_loss(changed, a, b)
            if reached > 0.0 or more <= 0.0:
                return selection.refitted(changed), set()
            inexact = inexactness(selection.fleet, changed, one.candidate, (a, b))
            if reached > -0.5 * inexact and more <= inexact:
                replaced = {identity(a), identity(b)} - {identity(one.candidate)}
                return selection.refitted(changed), replaced
    return None


def _is_near(a: Candidate, b: Candidate, candidate: Candidate) -> bool:
    """Whether a candidate is at the level of one of two claims, or of their car."""
    level = candidate.level.without_onset
    of_car = bool(a.level.car) and level.car == a.level.car
    return of_car or level in {one.level.without_onset for one in (a, b)}


def _is_of_one_place(a: Candidate, b: Candidate) -> bool:
    """Whether two claims are about the same recordings: one level, or one car."""
    same_car = bool(a.level.car) and a.level.car == b.level.car
    return same_car or (a.level == b.level) or (not a.level.car and a.level.kind == b.level.kind)
