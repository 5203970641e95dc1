# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Selection over numerical fleets: the right effects at the right level, and none else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.numerical_fleets import claimed, with_same_derivatives, with_unlisted_fault

from adk_ros.fleet.inference.assessment import Assessment, extended
from adk_ros.fleet.inference.evidence import SimulationError
from adk_ros.fleet.inference.fleet_candidates import identity
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel, remaining_excess
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import (
    CAR,
    CONDITION,
    MIN_RECORDINGS,
    RAMP,
    SHARED,
    STEP,
    Level,
    usable_levels,
)
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

SHARED_DRAG = Injection("aero_drag.cda", Level(SHARED), 5.0)
CAR_TYRE = Injection("front_tyre_stiffness.scale", Level(CAR, car="car02"), 8.0)
NEW_SOFTWARE = Level(CONDITION, tag="software", value="2.1")


def claims(plan: FleetPlan, seed: int = 1) -> dict[tuple[str, str], Assessment]:
    fleet = draw_fleet(seed, plan)
    selection = Selection(fleet)
    found = selection.assessed(selection.select())
    return {(fleet.columns.effects[c.candidate.effect], c.candidate.level.text): c for c in found}


@pytest.mark.parametrize(("tau", "kappa"), [(0.0, 0.0), (1.0, 0.5)])
def test_nothing_is_claimed_of_a_correct_simulation(tau: float, kappa: float) -> None:
    assert claims(FleetPlan(effects=6, tau=tau, kappa=kappa)) == {}


def test_each_level_is_named() -> None:
    plan = FleetPlan(
        cars=5,
        effects=7,
        recordings=40,
        injections=(
            SHARED_DRAG,
            CAR_TYRE,
            Injection("low_friction.mu_scale", NEW_SOFTWARE, -6.0),
        ),
    )
    found = claims(plan)
    assert set(found) == {
        ("aero_drag.cda", "all cars"),
        ("front_tyre_stiffness.scale", "car02"),
        ("low_friction.mu_scale", "software = 2.1"),
    }
    drag = found["aero_drag.cda", "all cars"]
    assert drag.interval[0] < 5.0 < drag.interval[1]


def test_a_drift_of_one_car_is_a_trend() -> None:
    drift = Injection("rolling_resistance.crr", Level(RAMP, car="car03", onset=25.0), 9.0)
    fleet = draw_fleet(2, FleetPlan(cars=4, effects=6, recordings=48, injections=(drift,)))
    selection = Selection(fleet)
    model = selection.select()
    levels = [c.level for c in model.claimed]
    assert [(level.kind, level.car) for level in levels] == [(RAMP, "car03")]
    assert 10.0 < levels[0].onset < 40.0


def test_a_fault_of_one_car_hides_no_other_level() -> None:
    """Each question is examined, and of each trend one change point."""
    drift = Injection("rolling_resistance.crr", Level(RAMP, car="car03", onset=25.0), 30.0)
    fleet = draw_fleet(2, FleetPlan(cars=4, effects=6, recordings=48, injections=(drift,)))
    ranked = Selection(fleet).ranked(FleetModel((), {}))
    effect = fleet.columns.effects.index(drift.key)
    kinds = [c.level.kind for _, c in ranked if c.effect == effect]
    assert set(kinds) == {SHARED, CAR, CONDITION, RAMP, STEP}
    found = {identity(candidate) for _, candidate in ranked}
    assert len(found) == len(ranked)


def test_an_unlisted_fault_of_one_car_does_not_hide_what_all_share() -> None:
    tyre = "front_tyre_stiffness.scale"
    shared = Injection(tyre, Level(SHARED), 1.5)
    plan = FleetPlan(recordings=36, effects=8, bias=0.0, deviation=0.3, injections=(shared,))
    fleet = draw_fleet(5, plan)
    sizes = -7.0 * (1.0 + 0.8 * np.random.default_rng(1).standard_normal(36))
    column = fleet.columns.first_effect + fleet.columns.effects.index(tyre)
    selection = Selection(with_unlisted_fault(fleet, "car01", column, sizes))
    assert claimed(fleet, selection.select()) == {(tyre, "all cars")}


def test_what_a_fault_leaves_is_no_scatter_of_what_all_cars_share() -> None:
    tyre, wind = "front_tyre_stiffness.scale", "crosswind.wind_y"
    injections = (
        Injection(tyre, Level(SHARED), 1.5),
        Injection(wind, Level(CAR, car="car01"), 12.0),
    )
    plan = FleetPlan(recordings=36, effects=8, bias=0.0, deviation=0.3, injections=injections)
    fleet = draw_fleet(5, plan)
    first = fleet.columns.first_effect
    rng = np.random.default_rng(5)
    for key in (tyre, "rear_tyre_stiffness.scale"):
        column, left = first + fleet.columns.effects.index(key), 3.0 * rng.standard_normal(36)
        fleet = with_unlisted_fault(fleet, "car01", column, left, 0.0)
    selection = Selection(fleet)
    model = selection.select()
    assert claimed(fleet, model) == {(tyre, "all cars"), (wind, "car01")}
    # It has the same evidence before it is claimed.
    shared = next(c for c in selection.assessed(model) if c.candidate.level == Level(SHARED))
    candidate = selection.assess(selection.without(model, shared.candidate), shared.candidate)
    assert candidate.evidence == pytest.approx(shared.evidence, rel=0.1)


@pytest.mark.parametrize("day", [21.0, 27.9, 30.2])
def test_the_onset_of_a_ramp_is_known_to_a_part_of_a_day(day: float) -> None:
    """Half a day leaves what seems a second ramp, where sizes are known to one in a thousand."""
    drift = Injection("rolling_resistance.crr", Level(RAMP, car="car03", onset=day), 9.0)
    plan = FleetPlan(
        cars=8, recordings=48, effects=7, bias=0.0, deviation=0.004, injections=(drift,)
    )
    fleet = draw_fleet(3, plan)
    (claim,) = Selection(fleet).select().claimed
    assert claim.level.onset == pytest.approx(day, abs=0.3)


def test_the_onset_of_a_claim_is_fitted_again_before_the_selection_ends() -> None:
    drift = Injection("rolling_resistance.crr", Level(RAMP, car="car03", onset=27.9), 9.0)
    plan = FleetPlan(
        cars=8, recordings=48, effects=7, bias=0.0, deviation=0.004, injections=(drift,)
    )
    fleet = draw_fleet(3, plan)
    selection = Selection(fleet)
    wrong = replace(drift.level, onset=29.5)
    effect = fleet.columns.effects.index(drift.key)
    start = selection.refitted(FleetModel((Candidate(effect, wrong, wrong.design(fleet)),), {}))
    (claim,) = selection.select(start).claimed
    assert claim.level.onset == pytest.approx(27.9, abs=0.15)


def test_an_effect_beyond_its_range_is_not_claimed() -> None:
    # A relaxation length cannot be negative.
    plan = FleetPlan(
        effects=9, injections=(Injection("tyre_relaxation.length", Level(SHARED), -6.0),)
    )
    assert ("tyre_relaxation.length", "all cars") not in claims(plan)


def test_levels_need_recordings_on_both_sides() -> None:
    fleet = draw_fleet(1, FleetPlan(cars=2, recordings=4))
    assert {level.kind for level in usable_levels(fleet)} == {SHARED}
    fleet = draw_fleet(1, FleetPlan(cars=2, recordings=30))
    assert {level.kind for level in usable_levels(fleet)} == {SHARED, CAR, CONDITION, RAMP, STEP}


def test_a_ramp_of_one_car_ends_with_its_recordings() -> None:
    """Car 3 records in the first half of the fleet's time only; its last size is the claim's."""
    fleet = draw_fleet(1, FleetPlan(cars=3, recordings=30))
    cars = tuple("car03" if i < 12 else "car01" for i in range(30))
    fleet = replace(fleet, cars=cars)
    ramp = Level(RAMP, car="car03", onset=float(fleet.days[4])).design(fleet)
    np.testing.assert_allclose(ramp[4:12], np.linspace(0.0, 1.0, 8))
    assert not ramp[12:].any()
    everywhere = Level(RAMP, onset=float(fleet.days[4])).design(fleet)
    assert everywhere[-1] == 1.0
    assert everywhere[11] < 0.3


@pytest.mark.parametrize("kind", [RAMP, STEP])
def test_a_fitted_change_point_leaves_enough_recordings(kind: str) -> None:
    """A single recording at the end, with a large effect, is no trend."""
    fleet = draw_fleet(2, FleetPlan(cars=4, effects=3, recordings=48, bias=0.0, deviation=0.3))
    j, last = fleet.columns.first_effect, [i for i, c in enumerate(fleet.cars) if c == "car03"][-1]
    scores = fleet.scores.copy()
    scores[last] += 12.0 * fleet.informations[last, j]
    selection = Selection(replace(fleet, scores=scores))
    level = next(x for x in selection.levels if (x.kind, x.car) == (kind, "car03"))
    empty = FleetModel((), {})
    found = selection.assess(empty, Candidate(0, level, level.design(fleet)))
    fitted = selection.with_fitted_onset(empty, found).candidate
    assert fitted.level.onset > level.onset
    assert np.count_nonzero(fitted.design) >= MIN_RECORDINGS


def test_tolerances_beyond_their_bounds_explain_nothing() -> None:
    """A large effect that resembles a tolerance leaves much unexplained until it is claimed."""
    drag = Injection("aero_drag.cda", Level(SHARED), 12.0)
    fleet = draw_fleet(3, FleetPlan(effects=6, bias=0.0, injections=(drag,)))
    # The first tolerance has the derivatives of the drag.
    fleet = with_same_derivatives(fleet, 0, fleet.columns.first_effect)
    selection = Selection(fleet)
    empty = FleetModel((), {})
    assert np.median(remaining_excess(fleet, empty)) > 30.0
    found = selection.assess(empty, Candidate(0, Level(SHARED), np.ones(len(fleet.names))))
    assert np.median(remaining_excess(fleet, extended(empty, found))) < 10.0


def small_drag(level: Level, cars: tuple[str, ...] = ()) -> tuple[Selection, Assessment]:
    """Return drag of 0.8 materiality thresholds at a level of six cars, well known."""
    drag = Injection("aero_drag.cda", level, 0.8)
    plan = FleetPlan(recordings=60, effects=6, bias=0.0, deviation=0.1, injections=(drag,))
    fleet = draw_fleet(3, plan)
    zero = np.zeros(fleet.columns.size)
    fleet = replace(fleet, cars=cars or fleet.cars, error=SimulationError(zero, zero, 3))
    selection = Selection(fleet)
    effect = fleet.columns.effects.index("aero_drag.cda")
    candidate = Candidate(effect, level, level.design(fleet))
    return selection, selection.assess(FleetModel((), {}), candidate)


@pytest.mark.parametrize(
    ("level", "is_claimable"), [(Level(SHARED), True), (Level(CAR, car="car02"), False)]
)
def test_build_tolerance_is_of_single_cars(level: Level, is_claimable: bool) -> None:
    selection, found = small_drag(level)
    assert 0.5 < found.size < 1.0
    assert selection.is_significant(found)
    assert selection.is_claimable(found) == is_claimable


def test_recordings_of_unknown_cars_may_be_of_one() -> None:
    names = small_drag(Level(SHARED))[0].fleet.names
    for cars, least, most in (
        (names, 1.0, 1.0),
        (("car01", *names[1:]), 1.0, 1.0),
        # Two thirds of the recordings are of the third car, or of any.
        (tuple(f"car{min(i % 9, 2)}" for i in range(60)), 1.3, 2.2),
        (tuple(f"car{i % 3}" for i in range(60)), 2.8, 3.0),
    ):
        selection, found = small_drag(Level(SHARED), cars)
        assert least <= selection.fleet.effective_cars(found.candidate.effect) <= most
        tolerance = selection.tolerance(found.candidate)
        assert most**-0.5 <= tolerance <= least**-0.5
        assert selection.is_claimable(found) == (found.size > tolerance)


def test_a_size_at_which_nothing_is_linearised_is_no_claim() -> None:
    cars = tuple(f"car{i}" for i in range(60))
    selection, found = small_drag(Level(SHARED), cars)
    assert selection.fleet.effective_cars(found.candidate.effect) > 30.0
    assert selection.tolerance(found.candidate) == 0.3


@pytest.mark.slow(seconds=60)
def test_false_alarms_power_and_coverage() -> None:
    from adk_ros.fleet.inference.operating_characteristics import characteristics

    strong = Injection("aero_drag.cda", Level(SHARED), 3.3)
    plan = FleetPlan(effects=6, deviation=0.3, injections=(strong,))
    found = characteristics(plan, range(100, 112))
    assert found.with_false_alarm <= 2
    assert found.found >= 9
    assert found.covered >= 0.7 * found.found


def test_an_effect_of_all_cars_need_not_explain_what_the_faults_of_some_do() -> None:
    """Two of six cars have a fault beside which little is exact; the others decide."""
    plan = FleetPlan(
        recordings=60,
        effects=7,
        bias=0.0,
        deviation=0.3,
        injections=(
            Injection("aero_drag.cda", Level(SHARED), 2.5),
            Injection("front_tyre_stiffness.scale", Level(CAR, car="car02"), 500.0),
            Injection("front_tyre_stiffness.scale", Level(CAR, car="car05"), -500.0),
        ),
    )
    fleet = draw_fleet(3, plan)
    selection = Selection(fleet)
    drag, *faults = (
        Candidate(fleet.columns.effects.index(one.key), one.level, one.level.design(fleet))
        for one in plan.injections
    )
    model = selection.refitted(FleetModel(tuple(faults), {}))
    assert selection.explains(model, selection.assess(model, drag))
