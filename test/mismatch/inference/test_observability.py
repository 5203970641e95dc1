# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Observability without an IMU, a torque command or an unfiltered yaw rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import CAR, case
from helpers.mismatch_drive import SECONDS, STEP_S, drive_of, driven, simulated_car

from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.observability import (
    PHASE_LAG_EFFECTS,
    ObservableEffects,
    longest_moving_segment,
    observable_effects,
    with_pseudo_imu,
    yaw_filter,
)
from adk_ros.mismatch.inference.result import EXPLAINED
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import MIN_SPEED
from adk_ros.mismatch.library.features import FEATURES
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.report.summary import sentence
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.mismatch.surrogate.run_inputs import no_terms
from adk_ros.mismatch.surrogate.state_index import V_Y

MASS, RADIUS = 2000.0, 0.325


def without_imu(e: SensorLog) -> SensorLog:
    return replace(e, imu_s=np.empty(0), imu=np.empty((0, 3)))


def with_pedal(e: SensorLog) -> SensorLog:
    command = e.command.copy()
    command[:, 0] /= np.abs(command[:, 0]).max()
    return replace(e, command=command)


def filtered(e: SensorLog, tau: float) -> SensorLog:
    odometry = e.odometry.copy()
    for k in range(1, e.odometry_s.size):
        keep = np.exp(-(e.odometry_s[k] - e.odometry_s[k - 1]) / tau)
        odometry[k, 2] = e.odometry[k, 2] + (odometry[k - 1, 2] - e.odometry[k, 2]) * keep
    return replace(e, odometry=odometry)


def test_complete_recording_has_no_missing_channels() -> None:
    scope = observable_effects(case().recording, MASS, RADIUS)
    assert scope.is_complete
    assert not scope.unobservable
    assert not scope.missing_channels()


@pytest.mark.parametrize("tau", [0.2, 0.4])
def test_yaw_rate_filter_is_identified(tau: float) -> None:
    assert yaw_filter(filtered(case().recording, tau)) == pytest.approx(tau, abs=0.06)


def test_unfiltered_yaw_rate_has_no_filter() -> None:
    for evidence in (case().recording, case().simulation, case("aero_drag", cda=1.0).recording):
        assert yaw_filter(evidence) == 0.0


def test_pedal_position_is_no_torque() -> None:
    assert observable_effects(case().recording, MASS, RADIUS).torque
    assert not observable_effects(with_pedal(case().recording), MASS, RADIUS).torque
    pedal_alone = with_pedal(case().recording)
    pedal_alone = replace(pedal_alone, command=pedal_alone.command * np.array([1.0, 0.0]))
    assert not observable_effects(pedal_alone, MASS, RADIUS).is_excited


def test_a_torque_without_a_steering_angle_counts_on_a_straight_road_only() -> None:
    bends = case().recording
    bends = replace(bends, command=bends.command * np.array([1.0, 0.0]))
    scope = observable_effects(bends, MASS, RADIUS)
    assert scope.torque
    assert not scope.is_excited
    assert scope.not_predicted() == ["v_x", "v_y", "yaw_rate"]
    assert scope.missing_channels()[-1].what == "a steering angle in bends"
    on_straight = observable_effects(straight(), MASS, RADIUS)
    assert on_straight.is_excited
    assert on_straight.known_bends


def test_unobservable_effects() -> None:
    blind = ObservableEffects(imu=False, torque=False, yaw_filter_s=0.4)
    assert {
        "imu_bias",
        "gyro_scale",
        "odometry_scale",
        "road_bank",
        "aero_drag",
    } <= blind.unobservable
    assert {"drive_torque_gain", "torque_squared", "v_x", *PHASE_LAG_EFFECTS} <= blind.unobservable
    assert {"steering_ratio", "front_tyre_stiffness"}.isdisjoint(blind.unobservable)
    assert blind.unobservable <= {*EFFECTS, *FEATURES, "v_x"}
    assert len(blind.missing_channels()) == 3
    assert "aero_drag" not in ObservableEffects(imu=False).unobservable


def without_v_y(e: SensorLog) -> SensorLog:
    return without_dead_channels(replace(e, odometry=e.odometry * np.array([1.0, 0.0, 1.0])))[0]


def straight(**changes: float) -> SensorLog:
    p = simulated_car(**changes)
    return drive_of(p, no_terms(round(SECONDS / STEP_S)), SECONDS, steered=0.0)


def test_constant_channels_are_not_judged() -> None:
    whole = case().recording
    no_torque = replace(whole, command=whole.command * np.array([0.0, 1.0]) + [500.0, 0.0])
    for log, states, missing in (
        (whole, [], []),
        (without_v_y(whole), ["v_y"], ["a lateral velocity"]),
        (no_torque, ["v_x"], ["a torque command"]),
        (straight(), ["v_y", "yaw_rate"], ["a steering angle"]),
    ):
        scope = observable_effects(log, MASS, RADIUS)
        assert scope.not_predicted() == states
        assert [x.what for x in scope.missing_channels()] == missing
    on_course = observable_effects(straight(), MASS, RADIUS).unobservable
    assert {"steering_ratio", "rear_tyre_stiffness", "yaw_rate", "v_y"} <= on_course
    assert {"aero_drag", "rolling_resistance", "v_x"}.isdisjoint(on_course)
    # An accelerometer tells the lateral force without a lateral velocity.
    assert not ObservableEffects(v_y=False).unobservable
    assert ObservableEffects(v_y=False, imu=False).unobservable >= {"v_y", "imu_bias"}


def test_dead_channels() -> None:
    whole = case().recording
    assert without_dead_channels(whole) == (whole, [])
    found, lines = without_dead_channels(replace(whole, imu=whole.imu * np.array([1.0, 1.0, 0.0])))
    assert not found.imu_s.size
    assert lines == [f"{whole.name}: the IMU's yaw rate is 0 throughout: the IMU is left out"]
    constant = whole.odometry * np.array([1.0, 0.0, 1.0]) + np.array([0.0, 0.3, 0.0])
    found, lines = without_dead_channels(replace(whole, odometry=constant))
    assert not found.measures_v_y
    assert not found.odometry[:, 1].any()
    assert lines == []
    assert not found.between(1.0, 2.0).measures_v_y


def test_a_dead_lateral_velocity_corrects_nothing() -> None:
    log, parameters = driven(), simulated_car()
    followed = prepare_residual_problem(log).run(parameters)
    free = prepare_residual_problem(without_v_y(log)).run(parameters)
    as_measured = prepare_residual_problem(replace(without_v_y(log), measures_v_y=True))
    error = np.abs(free[V_Y] - followed[V_Y]).mean()
    assert error < 0.1 * np.abs(as_measured.run(parameters)[V_Y] - followed[V_Y]).mean()


def test_uninformative_channels_have_no_weight() -> None:
    course = prepare_residual_problem(with_pseudo_imu(without_imu(case().recording)))
    plain = SurrogateModel(
        case().nominal.parameters(), np.zeros(6), np.zeros((6, 100)), np.empty((0, len(INDEX)))
    )
    scope = ObservableEffects(imu=False, torque=False, yaw_filter_s=0.4)
    found = scope.masked(Likelihood.of(course, scope.adapted(plain)))
    assert not found.weights[:4].any()
    assert found.weights[4:].any()
    assert found.unobservable == scope.unobservable
    no_v_y = ObservableEffects(v_y=False).masked(Likelihood.of(course, plain)).weights.any(axis=1)
    assert no_v_y.tolist() == [True, True, True, True, False, True]
    straight = ObservableEffects(steering=False).masked(Likelihood.of(course, plain))
    assert straight.weights.any(axis=1).tolist() == [True, False, False, True, False, False]
    assert found.parameters[INDEX["odometry_lag"]] == 0.4
    assert plain.parameters[INDEX["odometry_lag"]] == 0.0


def test_pseudo_imu_follows_odometry() -> None:
    whole = case().recording
    assert with_pseudo_imu(whole) is whole
    made = with_pseudo_imu(without_imu(whole))
    measured = np.interp(made.imu_s, whole.imu_s, whole.imu[:, 1])
    assert np.corrcoef(made.imu[:, 1], measured)[0, 1] > 0.95


def test_longest_moving_segment() -> None:
    e = case().recording
    odometry = e.odometry.copy()
    odometry[(e.odometry_s > 20.0) & (e.odometry_s < 25.0), 0] = 0.0
    part = longest_moving_segment(replace(e, odometry=odometry))
    assert part.odometry_s[0] == pytest.approx(25.0, abs=0.1)
    assert part.odometry_s[-1] == pytest.approx(e.odometry_s[-1], abs=0.05)
    assert part.odometry[:, 0].min() > MIN_SPEED
    still = replace(e, odometry=0.0 * e.odometry)
    assert longest_moving_segment(still) is still


@pytest.mark.slow
def test_drag_is_identified_without_an_imu() -> None:
    drag = case("aero_drag", cda=1.0)
    found = identify_mismatch(drag.simulation, without_imu(drag.recording), drag.nominal)
    assert found.verdict == EXPLAINED
    (one,) = found.effects
    assert "aero_drag" in (one.effect.name, *one.alternatives)
    assert "imu_bias" in found.not_judged
    assert sentence(found).endswith("Analysed without an IMU.")


@pytest.mark.slow
def test_no_longitudinal_effect_with_a_pedal_position() -> None:
    drag = case("aero_drag", cda=1.0)
    found = identify_mismatch(
        drag.simulation, with_pedal(without_imu(drag.recording)), drag.nominal
    )
    assert all("v_x" not in one.effect.equations for one in found.effects)
    assert np.isnan(found.before["v_x"])
    assert np.isfinite(found.before["yaw_rate"])
    assert not found.series.before[3].any()


@pytest.mark.slow(seconds=40)
def test_a_steering_ratio_is_identified_without_a_lateral_velocity() -> None:
    ratio = case("steering_ratio", scale=0.9)
    found = identify_mismatch(ratio.simulation, without_v_y(ratio.recording), ratio.nominal)
    assert found.verdict == EXPLAINED
    (one,) = found.effects
    assert one.effect.name == "steering_ratio"
    assert one.parameters["scale"].value == pytest.approx(0.9, abs=0.02)
    assert np.isnan(found.before["v_y"])
    assert found.after["yaw_rate"] < 0.5 * found.before["yaw_rate"]


@pytest.mark.slow(seconds=40)
def test_a_steering_ratio_is_identified_without_a_torque() -> None:
    ratio = case("steering_ratio", scale=0.9)
    command = ratio.recording.command * np.array([0.0, 1.0])
    recording = replace(ratio.recording, command=command)
    found = identify_mismatch(ratio.simulation, recording, ratio.nominal, held_out=[recording])
    assert [x.effect.name for x in found.effects] == ["steering_ratio"]
    assert found.effects[0].parameters["scale"].value == pytest.approx(0.9, abs=0.02)
    assert np.isnan(found.before["v_x"])


@pytest.mark.slow(seconds=40)
def test_drag_is_identified_on_a_straight_drive() -> None:
    recording = replace(straight(drag_area=1.4), name="straight")
    found = identify_mismatch(driven(), recording, CAR)
    assert found.verdict == EXPLAINED
    (drag,) = found.effects
    assert "aero_drag" in (drag.effect.name, *drag.alternatives)
    assert np.isnan(found.before["yaw_rate"])
    assert "steering_ratio" in found.not_judged
