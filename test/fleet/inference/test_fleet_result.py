# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of a result in the units of the parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_result import FleetResult
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import (
    CAR,
    CONDITION,
    RAMP,
    SHARED,
    STEP,
    Level,
    same_recordings,
    usable_levels,
)
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.place_claims import days_of
from adk_ros.fleet.inference.place_data import Place
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.result_of_estimate import fleet_result
from adk_ros.fleet.report.fleet_figures import matrix_figure, trend_figure

DRAG, POWER = "aero_drag.cda", "power_limit.power"


def claimed(fleet: FleetEvidence, level: Level) -> Candidate:
    """Return a claim of the first effect."""
    return Candidate(0, level, level.design(fleet))


def estimate_of(fleet: FleetEvidence, model: FleetModel) -> FleetEstimate:
    selection = Selection(fleet)
    model = selection.refitted(model)
    ratios = dict.fromkeys(fleet.names, 1.0)
    return FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), ratios, {})


def test_a_power_limit_is_in_watts_everywhere(tmp_path: Path) -> None:
    """It is fitted by its reciprocal: 6 thresholds of 1 / 150 kW are 25 kW."""
    level = Level(RAMP, car="car02", onset=10.0)
    plan = FleetPlan(effects=2, bias=0.0, deviation=0.3, injections=(Injection(DRAG, level, 6.0),))
    fleet = draw_fleet(3, plan)
    fleet = replace(fleet, columns=replace(fleet.columns, effects=(POWER, "payload.mass")))
    result = fleet_result(estimate_of(fleet, FleetModel((claimed(fleet, level),), {})))
    (claim,) = result.claims
    assert claim.onset_day == 10.0
    assert claim.onset_low_day is not None
    assert claim.onset_high_day is not None
    assert claim.onset_low_day <= 10.0 <= claim.onset_high_day < 40.0
    assert claim.size == pytest.approx(25e3, rel=0.15)
    # Deviations of a tenth of a threshold or so, at that size.
    for deviation in (claim.between_cars, claim.between_recordings):
        assert 10.0 < deviation < 5e3
    values = {v.car: v for v in result.vehicles}
    mean = values["car02"]
    assert mean.low < mean.size < mean.high < 150e3
    assert mean.size == pytest.approx(150e3 / mean.thresholds)
    # The other cars have no limit, or one far above.
    assert all(v.high > 1e9 for car, v in values.items() if car != "car02")
    assert all(v.low > 150e3 for car, v in values.items() if car != "car02")
    points = sorted(result.trends, key=lambda p: p.day)
    assert points[-1].fitted == pytest.approx(claim.size)
    assert points[-1].low < points[-1].size < points[-1].high
    assert points[-1].size == pytest.approx(25e3, rel=0.3)
    matrix_figure(result, tmp_path / "vehicles.png")
    trend_figure(result.trends, claim.unit, {claim.car} - {""}, tmp_path / "trend.png")
    assert (tmp_path / "trend.png").stat().st_size > 1000


def test_sizes_of_scale_models_are_in_thresholds_of_their_size() -> None:
    """Drag area scales by the square of the length: what is 5 thresholds is 0.0015 m^2."""
    drag = Injection(DRAG, Level(SHARED), 5.0)
    fleet = draw_fleet(3, FleetPlan(effects=4, bias=0.0, deviation=0.3, injections=(drag,)))
    fleet = replace(fleet, columns=replace(fleet.columns, length_scale=0.1))
    estimate = estimate_of(fleet, FleetModel((claimed(fleet, Level(SHARED)),), {}))
    (claim,) = fleet_result(estimate).claims
    assert claim.size == pytest.approx(5.0 * 0.03 * 0.01, rel=0.15)
    (value,) = estimate.values_of(fleet.names[0]).values()
    assert value == pytest.approx(claim.size)
    assert value < 0.1 * column_of(DRAG).materiality
    (rounded,) = estimate.point_of(fleet.names[0]).values()
    assert rounded == pytest.approx(value, abs=0.1 * 0.03 * 0.01)


def test_a_car_is_no_better_known_than_what_is_claimed_of_all() -> None:
    """The surrogate's error on other roads is the same in all cars."""
    key = "aero_downforce.cla"
    shared = Injection(key, Level(SHARED), 8.0)
    fleet = draw_fleet(4, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=(shared,)))
    effect = fleet.columns.effects.index(key)
    level = Level(SHARED)
    model = FleetModel((Candidate(effect, level, level.design(fleet)),), {})
    result = fleet_result(estimate_of(fleet, model))
    (claim,) = result.claims
    assert len(result.vehicles) == len(result.cars)
    for value in result.vehicles:
        assert value.high - value.low > 0.95 * (claim.high - claim.low)


def test_a_ramp_has_another_size_at_the_last_of_more_recordings() -> None:
    level = Level(RAMP, car="car02", onset=10.0)
    plan = FleetPlan(effects=2, bias=0.0, deviation=0.3, injections=(Injection(DRAG, level, 6.0),))
    fleet = draw_fleet(3, plan)
    of_car = [r for r, car in enumerate(fleet.cars) if car == "car02"]
    last = max(of_car, key=lambda r: fleet.days[r])
    early = fleet.kept([r for r in range(len(fleet.names)) if r != last])
    estimate = estimate_of(early, FleetModel((claimed(early, level),), {}))
    widened = estimate.of_fleet(fleet)
    for name in early.names:
        assert widened.values_of(name) == pytest.approx(estimate.values_of(name))
    assert abs(widened.claims[0].size) > abs(estimate.claims[0].size)


def test_of_levels_with_the_same_recordings_one_is_examined() -> None:
    """A driver who drives one car only: the car is claimed, and the driver a tie."""
    fault = Injection(DRAG, Level(CAR, car="car02"), 8.0)
    fleet = draw_fleet(3, FleetPlan(effects=2, bias=0.0, deviation=0.3, injections=(fault,)))
    tags = tuple({"driver": "Anna" if car == "car02" else "Ben"} for car in fleet.cars)
    fleet = replace(fleet, tags=tags)
    selection = Selection(fleet)
    driver = Level(CONDITION, tag="driver", value="Anna")
    assert driver in selection.every_level
    assert driver not in selection.levels
    assert fault.level in selection.levels
    (claim,) = fleet_result(
        estimate_of(fleet, FleetModel((claimed(fleet, fault.level),), {}))
    ).claims
    assert f"aero_drag ({driver.text})" in claim.ties


def test_another_change_point_is_no_tie() -> None:
    """Between two days of recordings, a step may begin at any time."""
    fleet = draw_fleet(3, FleetPlan(cars=3, recordings=30, effects=2, bias=0.0, deviation=0.3))
    fleet = replace(fleet, days=np.array([float(i % 7) for i in range(30)]))
    levels = [level for level in usable_levels(fleet) if level.kind == STEP and not level.car]
    assert len({level.design(fleet).tobytes() for level in levels}) < len(levels)
    for level in levels:
        assert not any(other.kind == STEP for other in same_recordings(fleet, level, levels))


@pytest.mark.parametrize(("within_day", "is_claimed"), [(False, True), (True, False)])
def test_a_place_is_claimed_if_it_is_passed_on_two_days(
    within_day: bool, is_claimed: bool
) -> None:
    fleet = draw_fleet(3, FleetPlan(effects=2, bias=0.0, deviation=0.3))
    # The first ten recordings pass it, here within two hours.
    hours = np.concatenate([5.0 + np.linspace(0.0, 2.0 / 24.0, 10), fleet.days[10:]])
    days = hours if within_day else fleet.days
    (result, one_day) = (result_at_a_place(replace(fleet, days=x)) for x in (days, 0.0 * days))
    assert [place.days for place in result.places] == [10] * is_claimed
    reasons = [c.reason for c in result.not_claimed if c.level == "at a place, (210, 270) m"]
    assert len(reasons) == (not is_claimed)
    assert all(reason.startswith("passed on 1 day only") for reason in reasons)
    # Where no recording has a time, or all are of one day, the claim says so.
    assert [place.days for place in one_day.places] == [1]


def result_at_a_place(fleet: FleetEvidence) -> FleetResult:
    place = Place("road_grade.grade", (Cell(3, 4, 0),), 6.0, 0.5, 9.0, 1e-9, fleet.names[:10])
    return fleet_result(replace(estimate_of(fleet, FleetModel((), {})), places=(place,)))


@pytest.mark.parametrize(
    ("times", "days"),
    [
        ([3.0], 1),
        ([3.0, 3.3, 3.4], 1),
        ([3.0, 4.0, 3.2], 2),
        # Around the clock: no gap of half a day.
        (np.arange(0.0, 4.1, 0.3).tolist(), 4),
        ([0.0, 9.0, 9.3, 9.7, 10.1], 3),
        ([], 0),
    ],
)
def test_days_of_recordings(times: list[float], days: int) -> None:
    assert days_of(np.array(times)) == days
