# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a forward selection cannot do alone: exchange, ignore strangers, look at all candidates."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest
from helpers.numerical_fleets import claimed, with_unlisted_fault

from adk_ros.fleet.inference import fleet_estimate
from adk_ros.fleet.inference.assessment import Assessment, extended
from adk_ros.fleet.inference.exchange import exchanged, plainer_levels
from adk_ros.fleet.inference.fleet_candidates import Identity, identity
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import (
    Candidate,
    FleetModel,
    likelihood,
    remaining_excess,
    strangers_of,
)
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, CONDITION, RAMP, SHARED, STEP, Level, is_trend
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.saved_loss import SavedLoss, best_half
from adk_ros.fleet.inference.simplification import explaining
from adk_ros.fleet.inference.ties import tied_pairs
from adk_ros.fleet.inference.variance_components import start_components


def test_a_fault_of_one_car_does_not_hide_that_of_another() -> None:
    """Two cars with one effect make cars seem to differ, unless one is known to be faulty."""
    tyre = "front_tyre_stiffness.scale"
    sizes = {"car02": 9.0, "car05": -20.0}
    faults = tuple(Injection(tyre, Level(CAR, car=car), size) for car, size in sizes.items())
    plan = FleetPlan(cars=8, recordings=48, effects=7, injections=faults)
    fleet = draw_fleet(7, plan)
    selection = Selection(fleet)
    level = Level(CAR, car="car02")
    candidate = Candidate(fleet.columns.effects.index(tyre), level, level.design(fleet))
    alone = selection.assess(FleetModel((), {}, ("car05",)), candidate)
    mixed = selection.assess(FleetModel((), {}), candidate)
    assert selection.is_significant(alone)
    assert not selection.is_significant(mixed)
    assert alone.interval[0] < 9.0 < alone.interval[1]


def test_a_car_whose_fault_changes_says_nothing_on_how_recordings_differ() -> None:
    """A fault that grows moves each recording of its car differently."""
    tyre = "front_tyre_stiffness.scale"
    growing = Injection(tyre, Level(RAMP, car="car05"), -60.0)
    shared = Injection(tyre, Level(SHARED), -5.0)
    plan = FleetPlan(cars=8, recordings=48, effects=7, injections=(growing, shared))
    fleet = draw_fleet(7, plan)
    selection = Selection(fleet)
    level = Level(SHARED)
    candidate = Candidate(fleet.columns.effects.index(tyre), level, level.design(fleet))
    known = selection.assess(FleetModel((), {}, ("car05",)), candidate)
    unknown = selection.assess(FleetModel((), {}), candidate)
    assert known.components[0] < 1.0 < unknown.components[0]
    assert known.size == pytest.approx(-5.0, abs=1.0)
    assert selection.is_significant(known)


def test_strangers_are_the_cars_that_are_explained_far_worse() -> None:
    fleet = draw_fleet(7, FleetPlan(cars=8, recordings=48, effects=7))
    cars = np.array(fleet.cars)
    usual = np.full(cars.size, 100.0)
    assert strangers_of(fleet, usual) == ()
    worse = usual + 3.0 * fleet.expected_loss * np.isin(cars, ["car02", "car05"])
    assert strangers_of(fleet, worse) == ("car02", "car05")
    # Where all are explained badly, it is no fault of some cars.
    assert strangers_of(fleet, usual + 9.0 * fleet.expected_loss) == ()


ROLLING, WIND = "rolling_resistance.crr", "crosswind.wind_y"
SOFTER = {"front_tyre_stiffness.scale", "rear_tyre_stiffness.scale"}


def one_for_two() -> tuple[FleetEvidence, Selection, FleetModel]:
    """Return a fleet of softer tyres, in which an effect that was not injected is claimed."""
    pair = tuple(Injection(key, Level(SHARED), -6.0) for key in sorted(SOFTER))
    fleet = draw_fleet(5, FleetPlan(effects=8, bias=0.0, deviation=0.3, injections=pair))
    selection = Selection(fleet)
    wrong = fleet.columns.effects.index(ROLLING)
    claim = Candidate(wrong, Level(SHARED), np.ones(len(fleet.names)))
    components = {wrong: (float(start_components(1).tau[0]), 0.1)}
    return fleet, selection, selection.refitted(FleetModel((claim,), components))


def test_an_effect_that_resembles_two_is_exchanged_for_them() -> None:
    fleet, selection, model = one_for_two()
    found = selection.select(exchanged(selection, model))
    assert claimed(fleet, found) == {(key, "all cars") for key in SOFTER}


def test_claims_at_both_values_of_a_tag_are_one_of_all_cars_and_a_difference() -> None:
    tyre = "front_tyre_stiffness.scale"
    values = [Level(CONDITION, tag="software", value=v) for v in ("2.0", "2.1")]
    sizes = zip(values, (-3.0, -9.0), strict=True)
    both = tuple(Injection(tyre, level, size) for level, size in sizes)
    fleet = draw_fleet(5, FleetPlan(effects=7, bias=0.0, deviation=0.3, injections=both))
    selection = Selection(fleet)
    effect = fleet.columns.effects.index(tyre)
    claims = tuple(Candidate(effect, x, x.design(fleet)) for x in values)
    found = plainer_levels(selection, selection.refitted(FleetModel(claims, {})))
    assert claimed(fleet, found) == {(tyre, "all cars"), (tyre, "software = 2.1")}
    sizes_found = {c.candidate.level.text: c.size for c in selection.assessed(found)}
    assert sizes_found["all cars"] == pytest.approx(-3.0, abs=0.5)
    assert sizes_found["software = 2.1"] == pytest.approx(-6.0, abs=0.5)


def test_a_claim_is_exchanged_for_a_likelier_one_of_less_evidence() -> None:
    """What all cars have seems to drift in one, where another effect drifts there."""
    wind, downforce = "crosswind.wind_y", "aero_downforce.cla"
    drift = Level(RAMP, car="car04", onset=40.0)
    injections = (
        Injection(wind, Level(SHARED), -2.0),
        Injection(downforce, drift, 20.0),
        Injection(wind, Level(STEP, car="car04", onset=50.0), 1.0),
    )
    plan = FleetPlan(recordings=36, effects=8, deviation=0.02, bias=0.0, injections=injections)
    fleet = draw_fleet(3, plan)
    selection = Selection(fleet)

    def candidate(key: str, level: Level) -> Candidate:
        return Candidate(fleet.columns.effects.index(key), level, level.design(fleet))

    shared, wrong = candidate(wind, Level(SHARED)), candidate(wind, drift)
    model = selection.refitted(FleetModel((shared, wrong), {}))
    rest = selection.without(model, wrong)
    right = selection.assess(rest, candidate(downforce, drift))
    assert right.evidence < selection.assessed(model)[1].evidence
    assert likelihood(fleet, extended(rest, right)) > likelihood(fleet, model)
    found = exchanged(selection, model)
    levels = {fleet.columns.effects[c.effect]: c.level for c in found.claimed}
    assert set(levels) == {wind, downforce}
    assert levels[wind] == Level(SHARED)
    assert replace(levels[downforce], onset=40.0) == drift
    assert 30.0 < levels[downforce].onset < 42.0


def test_what_fits_the_fault_of_a_stranger_is_not_likelier() -> None:
    """Rear tyres of all cars would fit what differs in one car, in each recording differently."""
    tyre = "front_tyre_stiffness.scale"
    plan = FleetPlan(
        recordings=18,
        effects=8,
        bias=0.0,
        deviation=0.3,
        injections=(Injection(tyre, Level(SHARED), 4.0),),
    )
    fleet = draw_fleet(5, plan)
    rear = fleet.columns.first_effect + fleet.columns.effects.index("rear_tyre_stiffness.scale")
    sizes = 60.0 * np.random.default_rng(1).standard_normal(18)
    fleet = with_unlisted_fault(fleet, "car01", rear, sizes)
    selection = Selection(fleet)
    model = selection.select()
    assert model.strangers == ("car01",)
    assert claimed(fleet, exchanged(selection, model)) == {(tyre, "all cars")}


def test_what_the_shape_of_a_trend_leaves_is_no_second_one() -> None:
    """A ramp with a step in it would be three trends of one effect in one car."""
    key = "front_tyre_stiffness.scale"
    both = (
        Injection(key, Level(RAMP, car="car02", onset=5.0), 10.0),
        Injection(key, Level(STEP, car="car02", onset=30.0), 20.0),
    )
    plan = FleetPlan(recordings=90, effects=7, bias=0.0, deviation=0.02, injections=both)
    fleet = draw_fleet(3, plan)
    found = Selection(fleet).select()
    effect = fleet.columns.effects.index(key)
    trends = [c.level for c in found.claimed if c.effect == effect and is_trend(c.level)]
    assert [level.car for level in trends] == ["car02"]


def test_next_to_a_large_fault_of_a_car_a_small_one_is_what_it_leaves() -> None:
    """An equation that is not exact leaves the same in all recordings of the car."""
    fault, remnant = "front_tyre_stiffness.scale", "rear_tyre_stiffness.scale"
    level = Level(CAR, car="car02")
    for size, is_enough in ((40.0, False), (5.0, True)):
        both = (Injection(fault, level, size), Injection(remnant, level, 1.5))
        plan = FleetPlan(recordings=60, effects=9, bias=0.0, deviation=0.02, injections=both)
        fleet = draw_fleet(3, plan)
        selection = Selection(fleet)
        first, second = (
            Candidate(fleet.columns.effects.index(key), level, level.design(fleet))
            for key in (fault, remnant)
        )
        model = selection.refitted(FleetModel((first,), {}))
        found = selection.assess(model, second)
        assert selection.is_claimable(found)
        assert selection.explains(model, found) == is_enough


def test_a_change_point_must_be_worth_its_parameter() -> None:
    """Friction above that of the road stands for something else, in all recordings of its car."""
    friction = Injection("low_friction.mu_scale", Level(CAR, car="car02"), 1.5)
    plan = FleetPlan(recordings=36, effects=6, bias=0.0, deviation=0.3, injections=(friction,))
    fleet = draw_fleet(1, plan)
    selection = Selection(fleet)
    found = exchanged(selection, selection.select())
    assert [c.level for c in found.claimed] == [friction.level]


def test_saved_loss_agrees_with_the_loss_of_a_claim() -> None:
    drag = Injection("aero_drag.cda", Level(SHARED), 12.0)
    fleet = draw_fleet(3, FleetPlan(effects=6, bias=0.0, injections=(drag,)))
    empty = FleetModel((), {})
    excess = remaining_excess(fleet, empty)
    everywhere = np.ones((1, len(fleet.names)))
    saved = SavedLoss.of(fleet, empty, everywhere, excess)
    total = float(excess[best_half(excess, everywhere[0])].mean())
    assert saved.exceeds(0, np.full(excess.size, 0.5 * total)).all()
    assert not saved.exceeds(0, np.full(excess.size, 2.0 * total)).any()
    assert not saved.exceeds(5, np.full(excess.size, 0.5 * total)).any()


def test_saved_loss_lets_a_claim_follow_that_stands_for_two() -> None:
    """One of two similar effects is claimed with the size of both; the other saves by sharing."""
    shared = Level(SHARED)
    # Columns of the first two effects correlate by 0.8.
    keys = draw_fleet(3, FleetPlan(effects=6)).columns.effects[:2]
    pair = tuple(Injection(key, shared, 8.0) for key in keys)
    fleet = draw_fleet(3, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=pair))
    selection = Selection(fleet)
    everywhere = np.ones((1, len(fleet.names)))
    one, other = (Candidate(i, shared, everywhere[0]) for i in range(2))
    model = selection.refitted(FleetModel((one,), {}))
    assert selection.assessed(model)[0].size > 10.0
    excess = remaining_excess(fleet, model)
    left = remaining_excess(fleet, extended(model, selection.assess(model, other)))
    counted = best_half(excess, everywhere[0])
    saved = SavedLoss.of(fleet, model, everywhere, excess)
    most = float(saved.most(other.effect)[0])
    assert most >= float((excess - left)[counted].sum()) > 0.0
    stays = replace(saved, claimed=saved.claimed[:0])
    assert most > 1.5 * float(stays.most(other.effect)[0])


def test_a_pair_that_is_likelier_than_a_claim_is_its_tie() -> None:
    fleet, selection, model = one_for_two()
    (claim,) = selection.assessed(model)
    tied = tied_pairs(selection, model, claim)
    assert SOFTER in [{fleet.columns.effects[c.effect] for c in pair} for pair in tied]
    of_car = replace(claim, candidate=replace(claim.candidate, level=Level(CAR, car="car02")))
    assert tied_pairs(selection, model, of_car) == []


def test_the_best_half_is_of_the_recordings_in_which_an_effect_acts() -> None:
    excess = np.array([5.0, 1.0, 3.0, 900.0, 0.0])
    counted = best_half(excess, np.array([1.0, 1.0, 1.0, 1.0, 0.0]))
    assert counted.tolist() == [False, True, True, False, False]


def test_two_effects_that_cancel_are_found_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where neither saves enough alone, both are claimed if each does next to the other."""
    pair = tuple(
        Injection(key, Level(SHARED), size)
        for key, size in (("aero_drag.cda", 6.0), ("crosswind.wind_y", -6.0))
    )
    fleet = draw_fleet(5, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=pair))
    selection = Selection(fleet)
    names = {one.key for one in pair}
    explains = Selection.explains

    def only_next_to_the_other(
        self: Selection, model: FleetModel, found: Assessment, excess: object = None
    ) -> bool:
        has_other = {fleet.columns.effects[c.effect] for c in model.claimed} & names
        return bool(has_other) and explains(self, model, found)

    monkeypatch.setattr(Selection, "explains", only_next_to_the_other)
    assert selection.best(FleetModel((), {}), set()) is None
    found = selection.select()
    assert claimed(fleet, found) == {(key, "all cars") for key in names}


def start_with(*keys: str) -> tuple[FleetEvidence, Selection]:
    """Return a fleet of softer tyres, and a selection that starts with some other claims."""
    pair = tuple(Injection(key, Level(SHARED), -6.0) for key in sorted(SOFTER))
    fleet = draw_fleet(5, FleetPlan(effects=8, bias=0.0, deviation=0.3, injections=pair))
    claims = tuple(
        Candidate(fleet.columns.effects.index(key), Level(SHARED), np.ones(30)) for key in keys
    )

    class Started(Selection):
        def select(
            self, start: FleetModel | None = None, replaced: Collection[Identity] = ()
        ) -> FleetModel:
            if start is None:
                return self.refitted(FleetModel(claims, {}))
            assert identity(claims[0]) in replaced
            return super().select(start, replaced)

    return fleet, Started(fleet)


@pytest.fixture
def only_explaining(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no better model be found: what is left is to see that a claim explains nothing."""
    monkeypatch.setattr(fleet_estimate, "exchanged", lambda _, model: model)
    monkeypatch.setattr(fleet_estimate, "simplified", lambda _, model: (model, set()))


@pytest.mark.usefixtures("only_explaining")
def test_what_a_claim_without_effect_has_displaced_is_added_again() -> None:
    fleet, selection = start_with(WIND)
    found = fleet_estimate._selected(selection)
    assert claimed(fleet, found) == {(key, "all cars") for key in SOFTER}


@pytest.mark.usefixtures("only_explaining")
def test_what_explained_nothing_next_to_a_claim_without_effect_returns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet, selection = start_with(WIND, max(SOFTER))
    dropped: list[FleetModel] = []

    def without_all(selection: Selection, model: FleetModel) -> FleetModel:
        if dropped:
            return explaining(selection, model)
        dropped.append(model)
        return selection.without(model, *model.claimed)

    monkeypatch.setattr(fleet_estimate, "explaining", without_all)
    found = fleet_estimate._selected(selection)
    assert claimed(fleet, dropped[0]) == {(WIND, "all cars"), (max(SOFTER), "all cars")}
    assert claimed(fleet, found) == {(key, "all cars") for key in SOFTER}


def test_what_a_fault_leaves_is_no_difference_between_recordings() -> None:
    """A large fault is not exact: another effect of its car seems to differ by what it leaves."""
    tyre, drag = "front_tyre_stiffness.scale", "aero_drag.cda"
    growing = Injection(tyre, Level(RAMP, car="car05"), -60.0)
    shared = Injection(drag, Level(SHARED), 5.0)
    plan = FleetPlan(
        cars=8, recordings=48, effects=7, bias=0.0, deviation=0.3, injections=(growing, shared)
    )
    fleet = draw_fleet(7, plan)
    # What is not exact looks like drag, in both directions.
    column = fleet.columns.first_effect + fleet.columns.effects.index(drag)
    left = np.array([8.0 if car == "car05" else 0.0 for car in fleet.cars])
    left *= np.where(np.arange(len(left)) % 2, 1.0, -1.0)
    fleet = replace(fleet, scores=fleet.scores + fleet.informations[:, :, column] * left[:, None])
    selection = Selection(fleet)
    levels = (Level(SHARED), Level(RAMP, car="car05"))
    claims = tuple(
        Candidate(fleet.columns.effects.index(key), level, level.design(fleet))
        for key, level in zip((drag, tyre), levels, strict=True)
    )
    model = selection.refitted(FleetModel(claims, {}))
    tau, _ = model.components[claims[0].effect]
    assert tau < 0.5
    found = selection.assessed(model)[0]
    assert found.size == pytest.approx(5.0, abs=1.5)
    assert found.deviation < 0.5
