# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank by the attitude of an INS explain gravity, and nothing else does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from helpers.mismatch import car, steady

from adk_ros.mismatch import slopes_beyond_simulation
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.held_out import Evidence
from adk_ros.mismatch.deployment.simulator_input import sensor_log_of
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, NONE, UNKNOWN
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.joined import concatenated, shifted
from adk_ros.mismatch.recording.measured_road import joined_roads
from adk_ros.mismatch.recording.nominal_vehicle import nominal_vehicle_of
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.result_files import as_dict
from adk_ros.mismatch.road_by_ins import measured_road, with_measured_road, with_measured_roads
from adk_ros.mismatch.slopes_beyond_simulation import without_places_on_slopes
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.measured_slopes import slope_terms
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile
from adk_ros.mismatch.validation import Validation
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensors import Imu, Sensors
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

SECONDS = 40.0


def surrogate(**changes: float) -> SurrogateModel:
    return SurrogateModel(car(**changes), np.zeros(6), np.zeros((6, 1)), np.zeros((0, SIZE)))


def hilly(height: float = 0.03, offset: float = 0.0) -> SensorLog:
    """Return a car on waves of the road, held at 20 m/s by a torque; its attitude, no lap."""
    log = steady(seconds=SECONDS)
    p = car()

    def grade(at_s: FloatArray) -> FloatArray:
        return np.asarray(height * np.sin(2.0 * np.pi * at_s / 10.0))

    force = GRAVITY * np.sin(grade(log.imu_s))
    imu = np.column_stack([force, 0.0 * force, 0.0 * force])
    pull = p[INDEX["mass"]] * GRAVITY * np.sin(grade(log.command_s))
    command = np.column_stack([p[INDEX["wheel_radius"]] * pull, 0.0 * pull])
    attitude = np.column_stack([0.01 * np.sin(log.imu_s), -grade(log.imu_s) + offset])
    return replace(log, imu=imu, command=command, attitude_s=log.imu_s, attitude=attitude)


def test_the_grade_is_minus_the_pitch_less_the_lean_of_the_body() -> None:
    log = hilly()
    road = measured_road(log, surrogate())
    assert road is not None
    inner = (road.at_s > 1.0) & (road.at_s < SECONDS - 1.0)
    true = 0.03 * np.sin(2.0 * np.pi * road.at_s / 10.0)
    assert np.abs(road.values[0] - true)[inner].max() < 5e-4
    assert np.abs(road.errors[0])[inner].max() < 5e-4
    assert measured_road(replace(log, attitude_s=np.empty(0)), surrogate()) is None
    # A body that squats by 0.01 rad per m/s² of specific force.
    gradient = 0.01
    body = log.attitude - np.column_stack([0.0 * log.imu_s, gradient * log.imu[:, 0]])
    leaning = replace(log, attitude=body, imu=log.imu * (1.0 + GRAVITY * gradient))
    quick = surrogate(pitch_gradient=gradient, pitch_frequency=40.0)
    seen = measured_road(leaning, quick)
    assert seen is not None
    assert np.abs(seen.values[0] - true)[inner].max() < 2e-3


def test_a_grade_is_used_where_it_lowers_the_error_of_v_x() -> None:
    log = hilly()
    (used,), notes = with_measured_roads([log], surrogate())
    assert used.road is not None
    assert used.road.entries[0] == "grade"
    assert "lowers the error of v_x, predicted 1 s ahead by the simulation, from 0." in notes[0]
    problem = prepare_residual_problem(used)
    terms = surrogate().fixed_terms(problem)
    plain = prepare_residual_problem(log)
    before = plain.residuals(car())[3]
    after = problem.residuals(car(), terms)[3]
    assert np.std(after[50:]) < 0.1 * np.std(before[50:])


def test_an_attitude_that_contradicts_the_motion_is_not_used() -> None:
    log = hilly()
    flipped = replace(log, attitude=-log.attitude)
    (unused,), notes = with_measured_roads([flipped], surrogate())
    assert unused.road is None
    assert notes == [line for line in notes if "attitude of the recording is not used" in line]
    assert with_measured_roads([steady()], surrogate())[1] == []


def test_the_level_of_an_attitude_is_a_nuisance() -> None:
    (used,), _ = with_measured_roads([hilly(offset=0.004)], surrogate())
    assert used.road is not None
    likelihood = Likelihood.of(prepare_residual_problem(used), surrogate(), is_noisy=False)
    directions = likelihood.weak_directions[-len(used.road.entries) :]
    assert directions[0, INDEX["grade"]] == used.road.level_sigma[0] > 0.005
    assert np.count_nonzero(directions) == len(used.road.entries)


def test_a_measured_grade_takes_the_place_of_the_simulated_road() -> None:
    (used,), _ = with_measured_roads([hilly()], surrogate())
    line = np.column_stack([np.arange(0.0, 900.0, 5.0)] * 2 + [np.zeros(180)] * 2)
    road = RoadProfile(line, ("grade", "friction"), np.full((2, 95), 0.05))
    model = replace(surrogate(), road=road)
    terms = model.fixed_terms(prepare_residual_problem(used))
    grades = terms.entries == INDEX["grade"]
    assert np.count_nonzero(grades) == 1
    assert INDEX["friction"] in terms.entries
    assert road.without(("grade", "friction")) is None


def test_recordings_in_a_row_keep_their_slopes() -> None:
    logs, _ = with_measured_roads([hilly(), hilly(0.02)], surrogate())
    later = shifted(logs[1], 100.0)
    both = concatenated([logs[0], later]).road
    assert both is not None
    at_s = np.array([102.5])
    assert slope_terms(both, at_s).activations[1, 0] == pytest.approx(0.02, abs=1e-3)
    assert joined_roads([logs[0].road, None]) is None
    other = with_measured_road(hilly(), surrogate(), logs[0])
    assert other.road is not None
    assert with_measured_road(hilly(), surrogate(), hilly()).road is None


def test_a_place_on_slopes_is_claimed_only_for_an_error_that_is_not_explained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (used,), _ = with_measured_roads([hilly()], surrogate())
    nuisances = np.zeros(0)
    path = SelectionPath(levels=[[Hypothesis((), nuisances, 0.0)]])
    monkeypatch.setattr(
        slopes_beyond_simulation,
        "reassessed",
        lambda decision, training, path, left: replace(
            decision, hypothesis=Hypothesis(tuple(left), nuisances, 0.0)
        ),
    )
    effect = EFFECTS["low_friction"]
    place = Activation(None, ((10.0, 90.0),), 400.0)
    active = ActiveEffect(effect, (0.8,), place)
    named = Decision(EXPLAINED, [], None, Hypothesis((active,), nuisances, 0.0), None)
    payload = ActiveEffect(EFFECTS["payload"], (100.0,))
    training = cast(
        Likelihood, SimpleNamespace(fit=lambda left, **_: Hypothesis(tuple(left), nuisances, 0.0))
    )

    def judged(is_explained: bool) -> Callable[[Decision], Validation]:
        errors = SimpleNamespace(is_explained=is_explained)
        return lambda _: cast(Validation, SimpleNamespace(errors=errors))

    on_slopes, level = [Evidence(used)], [Evidence(steady())]
    assert without_places_on_slopes(named, training, path, on_slopes, judged(True)).verdict == NONE
    assert without_places_on_slopes(named, training, path, on_slopes, judged(False)) is named
    assert without_places_on_slopes(named, training, path, level, judged(True)) is named
    # What acts throughout stays.
    both = replace(named, hypothesis=Hypothesis((active, payload), nuisances, 0.0))
    left = without_places_on_slopes(both, training, path, on_slopes, judged(True))
    assert (left.verdict, left.hypothesis.effects) == (EXPLAINED, (payload,))


@cache
def drives() -> tuple[SensorLog, SensorLog]:
    """Return a flat simulation, and the same car on hills with an INS."""
    road = load_scenario("xyz_edges")
    flat = road.model_copy(update={"heights": [], "undulations": []})
    ins = Imu(attitude_noise=0.002, bias_pitch=0.004, bias_roll=-0.003)
    hills = road.model_copy(update={"sensors": Sensors(imu=ins)})
    return (
        sensor_log_of(simulate(flat, 1, duration_s=120.0)),
        sensor_log_of(simulate(hills, 3, duration_s=100.0)),
    )


@pytest.mark.slow(seconds=60)
def test_hills_are_no_missing_physics_with_an_attitude() -> None:
    simulation, recording = drives()
    nominal = nominal_vehicle_of(load_vehicle("imdv"), is_simulated=True)
    without = replace(recording, attitude_s=np.empty(0), attitude=np.empty((0, 2)))
    blind = identify_mismatch(simulation, without, nominal)
    seeing = identify_mismatch(simulation, recording, nominal)
    assert blind.verdict == UNKNOWN
    assert (seeing.verdict, seeing.effects) == (NONE, [])
    assert seeing.before["v_x"] < 0.2 * blind.before["v_x"]
    assert any("grade of the road is measured" in line for line in seeing.notes)
    assert "measured_road" not in as_dict(blind)
    measured = as_dict(seeing)["measured_road"]["grade"]
    assert 0.01 < measured["rms"] < 0.04
    assert measured["min"] < -0.02 < 0.02 < measured["max"]
    assert 0.0 < measured["error"] < measured["rms"]
    rows = {row["name"]: row for row in as_dict(seeing)["scope"]["rows"]}
    assert rows["grade"]["possible"] == "yes"
