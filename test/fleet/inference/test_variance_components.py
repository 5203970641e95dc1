# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Degrees of freedom of sizes whose variance is estimated."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.fleet.inference.evidence import effect_columns
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.mixed_model import Components, MixedModel
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.shared_error import SHARED_ERROR, shared_error
from adk_ros.fleet.inference.variance_components import degrees_of_freedom
from adk_ros.mismatch.library.criteria import SYSTEMATIC_ERROR_PER_MATERIALITY

COMPONENTS = Components(np.array([2.0]), np.array([2.0]))
"""Between recordings and between cars: far more than noise."""


def freedom(cars: int, recordings: int, level: Level) -> float:
    plan = FleetPlan(cars=cars, recordings=recordings, effects=2, bias=0.0, deviation=0.1)
    fleet = draw_fleet(1, plan)
    wind = fleet.columns.effects.index("headwind.wind_x")
    term = Candidate(wind, level, level.design(fleet)).term
    return degrees_of_freedom(MixedModel(fleet, (wind,)), [term], COMPONENTS, 0)


@pytest.mark.parametrize("cars", [30, 28])
def test_without_repeated_recordings_all_of_them_count(cars: int) -> None:
    """Whatever part of their deviation the fit calls one of cars."""
    assert freedom(cars, 30, Level(SHARED)) == pytest.approx(29.0, rel=0.1)


def test_repeated_recordings_separate_cars_from_recordings() -> None:
    # Nearly all of the variance is between cars.
    assert freedom(6, 60, Level(SHARED)) == pytest.approx(5.0, rel=0.3)
    # A mean over the two recordings of a car depends on the part of each, which is not known.
    assert freedom(28, 30, Level(CAR, car="car01")) < 10.0


def test_cars_that_the_components_leave_out_are_no_degrees_of_freedom() -> None:
    plan = FleetPlan(cars=8, recordings=64, effects=2, bias=0.0, deviation=0.1)
    fleet = draw_fleet(1, plan)
    wind = fleet.columns.effects.index("headwind.wind_x")
    term = Candidate(wind, Level(SHARED), Level(SHARED).design(fleet)).term
    sample = np.array([car in {"car01", "car02", "car03", "car04"} for car in fleet.cars])
    mixed = MixedModel(fleet, (wind,))
    every, some = (degrees_of_freedom(mixed, [term], COMPONENTS, 0, of) for of in (None, sample))
    # Cars less one in either case; nearly all of the variance is between them.
    assert some == pytest.approx(every * 3.0 / 7.0, rel=0.2)


def test_further_recordings_of_a_car_that_is_left_out_repeat_none() -> None:
    """Each sound car has one recording; all of these are degrees of freedom, not one."""
    fleet = draw_fleet(1, FleetPlan(cars=13, recordings=130, effects=2, bias=0.0, deviation=0.1))
    faulty = [i for i, car in enumerate(fleet.cars) if car == "car01"]
    sound = {car: i for i, car in enumerate(fleet.cars) if car != "car01"}
    fleet = fleet.kept(sorted([*faulty, *sound.values()]))
    wind = fleet.columns.effects.index("headwind.wind_x")
    term = Candidate(wind, Level(SHARED), Level(SHARED).design(fleet)).term
    sample = np.array([car != "car01" for car in fleet.cars])
    alone = fleet.kept([int(i) for i in np.flatnonzero(sample)])
    of_some = degrees_of_freedom(MixedModel(fleet, (wind,)), [term], COMPONENTS, 0, sample)
    shared = Candidate(wind, Level(SHARED), Level(SHARED).design(alone)).term
    by_themselves = degrees_of_freedom(MixedModel(alone, (wind,)), [shared], COMPONENTS, 0)
    assert of_some == pytest.approx(by_themselves, rel=0.25)


def test_what_the_surrogate_feigns_on_other_roads_is_no_effect_of_all_cars() -> None:
    """Twice that error is no evidence, however many recordings say it; of one car it is."""
    key = "aero_downforce.cla"
    size = -2.0 * shared_error(key)
    for level, claimed in ((Level(SHARED), False), (Level(CAR, car="car01"), True)):
        fault = Injection(key, level, size)
        plan = FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=(fault,))
        fleet = draw_fleet(4, plan)
        selection = Selection(fleet)
        effect = fleet.columns.effects.index(key)
        found = selection.assess(FleetModel((), {}), Candidate(effect, level, level.design(fleet)))
        assert found.evidence > 100.0
        assert found.size == pytest.approx(size, abs=0.5)
        assert selection.is_significant(found) == claimed
        low, high = found.interval
        assert (high - low > 2.0 * shared_error(key)) == (not claimed)


def test_a_parameter_that_is_not_listed_has_the_error_of_any_equation() -> None:
    assert shared_error("steering_lag.tau") == SYSTEMATIC_ERROR_PER_MATERIALITY
    keys = {column.key for column in effect_columns()}
    assert set(SHARED_ERROR) <= keys
    assert min(SHARED_ERROR.values()) > SYSTEMATIC_ERROR_PER_MATERIALITY
