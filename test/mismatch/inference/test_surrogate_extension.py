# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Extensions of the surrogate: road profile, effects and features of the simulator."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from helpers.mismatch import CAR, case, steady

from adk_ros.bench.mismatch.case_generator import InjectedMismatch, make_case
from adk_ros.bench.mismatch.unlisted_labels import UNLISTED_IN
from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch import simulator
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.held_out import Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor
from adk_ros.mismatch.deployment.prediction_starts import start_times_of
from adk_ros.mismatch.deployment.scenario_drive import position_dependent_terms
from adk_ros.mismatch.deployment.simulator_input import sensor_log_of
from adk_ros.mismatch.deployment.surrogate_file import SurrogateFile
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.inference.surrogate_extension import augment_surrogate, is_underfit, misfit
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.nominal_vehicle import nominal_vehicle_of
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.summary import sentence
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.mismatch.surrogate.identification import SurrogateModel, identify_surrogate
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.mismatch.surrogate.road_profile import (
    KNOT_SPACING_M,
    RoadProfile,
    spline_basis,
    zero_profile,
)
from adk_ros.mismatch.surrogate.road_profile_fit import graph_colouring
from adk_ros.mismatch.surrogate.state_index import A_X, A_Y, V_Y, YAW_ACCELERATION, YAW_RATE
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.elevation import Height, Undulation
from adk_ros.plant.environment.road import ROAD_GRADE, ROAD_HEADING, ROAD_X, ROAD_Y, lookup
from adk_ros.plant.injection.injectors import UNLISTED
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle

DRAG = 0.8


@cache
def hilly() -> Scenario:
    """The handling problem, on hills."""
    base = load_scenario("handling")
    hills = {
        "name": "hills",
        "duration_s": 130.0,
        "heights": [
            Height(at=at, height=height).model_dump()
            for at, height in ((0, 0.0), (500, 12.0), (1100, -5.0), (1700, 9.0), (2300, 2.0))
        ],
        "undulations": [
            Undulation(start=650.0, end=950.0, amplitude=0.3, wavelength=70.0).model_dump()
        ],
    }
    return validate("hills", base.model_dump() | hills, Scenario)


@cache
def driven(seed: int, more_drag: float = 0.0) -> tuple[SensorLog, Vehicle]:
    """What sensors say of a drive on the hills, and the car, `more_drag` m^2 added."""
    scenario = hilly()
    if more_drag:
        cda = scenario.car().cda + more_drag
        scenario = validate(
            "hills", scenario.model_dump() | {"vehicle_changes": {"cda": cda}}, Scenario
        )
    drive = simulate(scenario, seed)
    return sensor_log_of(drive), drive.vehicle


@cache
def hilly_problem() -> tuple[ResidualProblem, SurrogateModel, SurrogateModel]:
    """The problem, the surrogate without what was learned, and with it."""
    log, car = driven(1)
    problem = prepare_residual_problem(log)
    start = nominal_vehicle_of(car).parameters()
    plain = identify_surrogate(problem, start)
    return problem, plain, augment_surrogate(problem, plain, start)


@cache
def drag_on_hills() -> MismatchResult:
    simulation, car = driven(1)
    return identify_mismatch(simulation, driven(2, DRAG)[0], nominal_vehicle_of(car))


def test_spline_weights_sum_to_one_on_the_road_and_zero_off_it() -> None:
    first, weights = spline_basis(np.array([0.0, 3.7, 25.0, np.nan]), KNOT_SPACING_M)
    assert weights.sum(axis=0) == pytest.approx([1.0, 1.0, 1.0, 0.0])
    assert list(first[:3]) == [0, 0, 2]


def test_equal_knots_give_a_constant_curve() -> None:
    road = zero_profile(prepare_residual_problem(case().simulation), ("grade",))
    level = replace(road, coefficients=np.full_like(road.coefficients, 0.03))
    assert level.values_at(road.line[:, 0])[0] == pytest.approx(0.03)
    assert level.size == pytest.approx([0.03])


def test_only_the_next_lap_revisits_a_place() -> None:
    log = steady(speed=20.0, seconds=60.0)
    angle = 2.0 * np.pi * log.odometry_s / 25.0
    circle = np.column_stack([80.0 * np.sin(angle), 80.0 * (1.0 - np.cos(angle)), angle])
    road = zero_profile(prepare_residual_problem(replace(log, pose=circle)), ("grade",))
    # One lap and no more is on the map.
    assert road.line[-1, 0] == pytest.approx(2.0 * np.pi * 80.0, rel=0.03)
    pose = np.array([[80.0, 80.0, 0.5 * np.pi], [80.0, 80.0, 2.5 * np.pi]])
    first, again = road.distances(pose)
    assert first == pytest.approx(0.5 * np.pi * 80.0, abs=2.0)
    assert again == pytest.approx(first, abs=0.01)
    # The other way round, and beside the road, is elsewhere.
    assert np.isnan(
        road.distances(np.array([[80.0, 80.0, -0.5 * np.pi], [60.0, 80.0, 1.6]]))
    ).all()
    assert road.covered_share(prepare_residual_problem(steady(speed=20.0))) < 0.1


def test_knots_of_one_colour_have_disjoint_influence() -> None:
    rng = np.random.default_rng(3)
    felt = np.zeros((40, 200), dtype=bool)
    for row in felt:
        for begin in rng.integers(0, 180, 2):
            row[begin : begin + 12] = True
    colours = graph_colouring(felt)
    for colour in range(colours.max() + 1):
        assert felt[colours == colour].sum(axis=0).max() <= 1
    assert colours.max() < 20


@pytest.mark.slow(seconds=25)
def test_grade_of_a_simulated_road_is_identified() -> None:
    problem, plain, surrogate = hilly_problem()
    assert is_underfit(problem, plain)
    assert surrogate.road is not None
    # Longitudinal: the slope is what v_x lacked.
    assert surrogate.error[3] < 0.2 * plain.error[3]
    route = hilly().planned_route()
    # As far as the drive comes.
    at = np.linspace(100.0, 1900.0, 60)
    row = np.array([lookup(route.table, route.spacing, s, ROAD_GRADE) for s in at])
    x, y, heading = (
        np.array([lookup(route.table, route.spacing, s, column) for s in at])
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING)
    )
    place = surrogate.road.distances(np.column_stack([x, y, heading]))
    assert np.isfinite(place).mean() > 0.9
    on = np.isfinite(place)
    found = surrogate.road.values_at(place)[list(surrogate.road.entries).index("grade")]
    # But for a constant, which a simulated accelerometer's bias is as well.
    off = (found - row)[on]
    assert np.std(off) < 0.15 * np.std(row)
    assert "road grade" in surrogate.augmentation_notes[0]


def test_surrogate_that_fits_is_not_extended() -> None:
    c = case()
    problem = prepare_residual_problem(c.simulation)
    start = c.nominal.parameters()
    plain = identify_surrogate(problem, start)
    assert not is_underfit(problem, plain)
    assert augment_surrogate(problem, plain, start) is plain


@pytest.mark.slow(seconds=25)
def test_effect_is_identified_on_a_hilly_road() -> None:
    result = drag_on_hills()
    assert [e.effect.name for e in result.effects] == ["aero_drag"]
    cda = result.effects[0].parameters["cda"]
    assert cda.value == pytest.approx(DRAG, rel=0.1)
    assert any("road grade" in note for note in result.notes)
    assert result.after["v_x"] < 0.5 * result.before["v_x"]
    assert "drag area" in sentence(result)


@pytest.mark.slow(seconds=25)
def test_files_of_a_hilly_simulation_contain_its_road() -> None:
    result = drag_on_hills()
    model = SurrogateFile.model_validate(yaml.safe_load(result.simulation_yaml))
    road = model.road()
    assert road is not None
    log = driven(1)[0]
    level = model.model_copy(update={"extras": type(model.extras)()})
    with_road, without = (
        rmse(horizon_errors(m, [Evidence(log)], (1.0,)))[0] for m in (model, level)
    )
    assert with_road[0] < 0.3 * without[0]
    # And nothing of the future is used: cut off after the start, the prediction is the same.
    starts = start_times_of(log, 40, 5.0, 20.0)[:2]
    extended = OpenLoopPredictor(model, log).predict(starts, 40)
    cut = replace(
        log,
        odometry_s=log.odometry_s[log.odometry_s <= starts[-1] + 1e-9],
        odometry=log.odometry[log.odometry_s <= starts[-1] + 1e-9],
        pose=log.pose[log.odometry_s <= starts[-1] + 1e-9],
    )
    assert OpenLoopPredictor(model, cut).predict(starts, 40) == pytest.approx(extended)


@pytest.mark.slow(seconds=25)
def test_no_road_profile_is_fitted_for_another_road(monkeypatch: pytest.MonkeyPatch) -> None:
    _, plain, extended = hilly_problem()
    log, car = driven(1)

    def augmented(*arguments: object) -> SurrogateModel:
        return extended if arguments[-1] else plain

    monkeypatch.setattr(simulator, "identify_surrogate", lambda *_: plain)
    monkeypatch.setattr(simulator, "augment_surrogate", augmented)

    def report(done: float, text: str) -> None:
        assert 0.0 <= done <= 1.0
        assert text

    surrogate, notes = simulator.surrogate_of(log, log, nominal_vehicle_of(car), report)
    assert surrogate.road is extended.road
    assert surrogate.open_loop_error is not None
    assert np.all(surrogate.open_loop_error > 0.0)
    assert "road grade (RMS" in notes[0]
    moved = replace(log, pose=log.pose + np.array([900.0, 0.0, 0.0]))
    surrogate, notes = simulator.surrogate_of(log, moved, nominal_vehicle_of(car), report)
    assert surrogate.road is None
    assert len(notes) == 2
    assert "on another road than the simulation" in notes[0]
    assert "implies a yaw inertia of" in notes[1]


@pytest.mark.slow(seconds=25)
def test_without_its_road_a_surrogate_is_extended_by_what_holds_anywhere() -> None:
    problem, plain, _ = hilly_problem()
    start = nominal_vehicle_of(driven(1)[1]).parameters()
    extended = augment_surrogate(problem, plain, start, along_road=False)
    assert extended.road is None


@pytest.mark.slow(seconds=25)
def test_unmodelled_part_of_a_simulator_becomes_a_feature_term() -> None:
    injected = InjectedMismatch(unlisted={"scrub_drag": UNLISTED["scrub_drag"]})
    c = make_case("scrub", injected, 5, seconds=(60.0, 90.0, 30.0), noise=0.02)
    problem, start = prepare_residual_problem(c.recording), c.nominal.parameters()
    plain = identify_surrogate(problem, start)
    assert is_underfit(problem, plain)
    extended = augment_surrogate(problem, plain, start)
    assert extended.feature_terms
    assert extended.feature_terms[0].equation == "v_x"
    assert extended.feature_terms[0].feature in UNLISTED_IN["scrub_drag"][1]
    assert misfit(problem, extended) < 0.05 * misfit(problem, plain)
    # On a drive that it was not learned on, it is there as well.
    model = SurrogateFile.model_validate(
        yaml.safe_load(surrogate_yaml(extended.parameters, surrogate=extended))
    )
    without = model.model_copy(update={"extras": type(model.extras)()})
    errors = [rmse(horizon_errors(m, [Evidence(c.held_out)], (1.0,)))[0] for m in (model, without)]
    assert errors[0][0] < 0.5 * errors[1][0]


@pytest.mark.slow(seconds=20)
def test_a_yaw_moment_by_the_driving_torque_follows_the_torque_that_acts() -> None:
    log, start = case().simulation, case().nominal.parameters()
    problem = prepare_residual_problem(log)
    plain = identify_surrogate(problem, start)
    uneven = plain.parameters.copy()
    uneven[INDEX["drive_yaw_moment"]] = 0.15
    more = problem.run(uneven, gain=0.0) - problem.run(plain.parameters, gain=0.0)

    def added(at_s: FloatArray, row: int) -> FloatArray:
        return np.asarray(np.interp(at_s, problem.middle_s, more[row]))

    imu = log.imu + np.column_stack([added(log.imu_s, row) for row in (A_X, A_Y, YAW_RATE)])
    odometry = log.odometry.copy()
    for column, row in ((1, V_Y), (2, YAW_RATE)):
        odometry[:, column] += added(log.odometry_s, row)
    simulated = prepare_residual_problem(replace(log, imu=imu, odometry=odometry))
    without = identify_surrogate(simulated, start)
    assert is_underfit(simulated, without)
    extended = augment_surrogate(simulated, without, start)
    assert "max(T, 0)" in extended.augmentation_notes[0]
    assert not extended.feature_terms
    moment = extended.parameters[INDEX["drive_yaw_moment"]]
    assert moment == pytest.approx(0.15, rel=0.15)
    # With half of the torque, it is half as large.
    weak, none = extended.parameters.copy(), extended.parameters.copy()
    none[INDEX["drive_yaw_moment"]] = 0.0
    whole = problem.run(weak, gain=0.0)[YAW_ACCELERATION]
    whole -= problem.run(none, gain=0.0)[YAW_ACCELERATION]
    weak[INDEX["torque_gain"]] = none[INDEX["torque_gain"]] = 0.5
    half = problem.run(weak, gain=0.0)[YAW_ACCELERATION]
    half -= problem.run(none, gain=0.0)[YAW_ACCELERATION]
    assert np.abs(half).max() < 0.7 * np.abs(whole).max()


@pytest.mark.slow(seconds=25)
def test_effect_of_a_simulator_extends_the_surrogate() -> None:
    injected = InjectedMismatch({"steering_backlash": {"half_gap": 0.0025}})
    c = make_case("play", injected, 6, seconds=(60.0, 90.0, 30.0), noise=0.02)
    problem, start = prepare_residual_problem(c.recording), c.nominal.parameters()
    plain = identify_surrogate(problem, start)
    extended = augment_surrogate(problem, plain, start)
    assert "steering_backlash" in extended.augmentation_notes[0]
    assert extended.parameters[INDEX["steer_half_gap"]] == pytest.approx(0.0025, rel=0.2)


def test_file_keeps_the_extras() -> None:
    line = np.column_stack([np.arange(5.0) * 10.0, np.arange(5.0) * 10.0, np.zeros((5, 2))])
    road = RoadProfile(line, ("grade",), np.linspace(0.0, 0.04, 9)[None])
    simulator = SurrogateModel(
        CAR.parameters(),
        np.zeros(6),
        np.zeros((6, 100)),
        np.empty((0, CAR.parameters().size)),
        road,
        (FeatureTerm("v_x", "speed_squared", -0.001, 0.0),),
    )
    content = yaml.safe_load(surrogate_yaml(simulator.parameters, surrogate=simulator))
    model = SurrogateFile.model_validate(content)
    again = model.surrogate()
    assert again.road is not None
    assert again.road.coefficients == pytest.approx(road.coefficients)
    assert again.feature_terms == simulator.feature_terms
    assert model.feature_coefficients()[1][0, 0] == -0.001
    # A scenario has a road of its own.
    assert position_dependent_terms(model) == ["the grade of the simulator's road"]
    content["extras"]["road"]["curves"]["grade"] = [0.0, 0.1]
    with pytest.raises(UsageError, match="four knots"):
        validate("model", content, SurrogateFile)
