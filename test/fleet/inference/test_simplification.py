# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One effect in place of two, and what an inexact equation of all cars may leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.numerical_fleets import claimed, with_same_derivatives

from adk_ros.fleet.inference.fleet_candidates import identity
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import (
    MIN_SHARED_GAIN,
    Candidate,
    FleetModel,
    explained_by,
    inexactness,
    is_steady_wind,
    likelihood,
    remaining_excess,
    share_equation,
)
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.simplification import explaining, simplified
from adk_ros.mismatch.library.criteria import MIN_GAIN_PER_NULL_EXCESS, PENALTY_PER_PARAMETER

DRAG, ROLLING, WIND = "aero_drag.cda", "rolling_resistance.crr", "crosswind.wind_y"


def test_a_claim_that_saves_nothing_next_to_the_others_is_dropped() -> None:
    drag = Injection("aero_drag.cda", Level(SHARED), 30.0)
    fleet = draw_fleet(3, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=(drag,)))
    selection = Selection(fleet)
    needless = Level(CAR, car="car02")
    model = FleetModel(
        (
            Candidate(0, Level(SHARED), np.ones(len(fleet.names))),
            Candidate(5, needless, needless.design(fleet)),
        ),
        {},
    )
    kept = explaining(selection, selection.refitted(model))
    assert claimed(fleet, kept) == {("aero_drag.cda", "all cars")}


def two_of_all_cars(
    second: str, size: float
) -> tuple[FleetEvidence, Selection, FleetModel, tuple[Candidate, Candidate]]:
    """Return a fleet with a large drag and a second effect in all cars, both claimed."""
    injections = tuple(
        Injection(key, Level(SHARED), x) for key, x in ((DRAG, 12.0), (second, size))
    )
    fleet = draw_fleet(3, FleetPlan(effects=6, bias=0.0, deviation=0.05, injections=injections))
    everywhere = np.ones(len(fleet.names))
    a, b = (
        Candidate(fleet.columns.effects.index(one.key), Level(SHARED), everywhere)
        for one in injections
    )
    selection = Selection(fleet)
    return fleet, selection, selection.refitted(FleetModel((a, b), {})), (a, b)


@pytest.mark.parametrize(("size", "stays"), [(0.5, False), (3.0, True)])
def test_what_an_inexact_equation_may_leave_is_no_second_effect(size: float, stays: bool) -> None:
    """However likely: an equation of all cars leaves the same in all recordings."""
    fleet, selection, both, (drag, rolling) = two_of_all_cars(ROLLING, size)
    alone = selection.without(both, rolling)
    allowed = inexactness(fleet, alone, drag, [rolling])
    more = float((remaining_excess(fleet, alone) - remaining_excess(fleet, both)).sum())
    assert (more > allowed) is stays
    gain = likelihood(fleet, both) - likelihood(fleet, alone)
    assert gain > PENALTY_PER_PARAMETER
    found, replaced = simplified(selection, both)
    names = {(DRAG, "all cars"), *([(ROLLING, "all cars")] if stays else [])}
    assert claimed(fleet, found) == names
    assert replaced == (set() if stays else {identity(rolling)})
    assert claimed(fleet, selection.select(found, replaced)) == names


def test_an_effect_in_other_equations_is_no_inexactness_of_a_claim() -> None:
    """A drag leaves nothing to the side, however large it is."""
    fleet, selection, both, (drag, wind) = two_of_all_cars(WIND, 0.5)
    assert not share_equation(fleet, drag, wind)
    assert inexactness(fleet, both, drag) > 0.0
    assert inexactness(fleet, both, drag, [wind]) == 0.0
    found, replaced = simplified(selection, both)
    assert (found, replaced) == (both, set())


def test_what_was_claimed_next_to_another_is_no_inexactness_of_it() -> None:
    """It saved more than `MIN_SHARED_GAIN` when it was added: so much is asked again."""
    fleet, _, both, (drag, rolling) = two_of_all_cars(ROLLING, 3.0)
    of_third = inexactness(fleet, both, drag)
    assert of_third == MIN_GAIN_PER_NULL_EXCESS * explained_by(fleet, both, [drag]).sum()
    of_itself = inexactness(fleet, both, drag, [drag, rolling])
    assert of_itself == pytest.approx(of_third * MIN_SHARED_GAIN / MIN_GAIN_PER_NULL_EXCESS)


def test_a_steady_wind_stands_for_nothing_else() -> None:
    """No wind blows from ahead in all recordings: drag and rolling resistance may look like it."""
    fleet, selection, both, _ = two_of_all_cars(ROLLING, 3.0)
    wind = Candidate(fleet.columns.effects.index("headwind.wind_x"), Level(SHARED), np.ones(30))
    assert is_steady_wind(fleet, wind)
    assert not is_steady_wind(fleet, replace(wind, level=Level(CAR, car="car02")))
    # The pair looks like the wind: a fleet in which the wind has the derivatives of the drag.
    first = fleet.columns.first_effect
    drag = fleet.columns.effects.index(DRAG)
    like = with_same_derivatives(fleet, first + wind.effect, first + drag)
    found, _ = simplified(Selection(like), both)
    assert claimed(like, found) == {(DRAG, "all cars"), (ROLLING, "all cars")}
    model = selection.refitted(FleetModel((wind,), {}))
    assert inexactness(fleet, model, wind) == 0.0


def test_a_fault_of_one_car_has_no_inexactness_of_all() -> None:
    fleet, _, both, (drag, _) = two_of_all_cars(ROLLING, 3.0)
    level = Level(CAR, car="car02")
    of_one = replace(drag, level=level, design=level.design(fleet))
    assert inexactness(fleet, both, of_one) == 0.0
