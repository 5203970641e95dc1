# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The catalogue, and how an effect enters the stand-in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import car, steady, with_commands

from adk_ros.mismatch.inference.forward_selection import SelectionPath, min_required_gain
from adk_ros.mismatch.inference.likelihood import (
    N_FIXED_NUISANCES,
    SENSOR_OFFSETS,
    TOLERANCE_PARAMETERS,
    ActiveEffect,
    Hypothesis,
    Likelihood,
    inactive_effect,
)
from adk_ros.mismatch.inference.segments import (
    GRADUAL_EDGE_WIDTHS,
    optimal_segmentation,
    segments_of_mask,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.surrogate.activation import Activation, inside_segments
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem

NAMES = [
    "aero_drag", "rolling_resistance", "headwind", "crosswind", "aero_downforce", "road_grade",
    "road_bank", "low_friction", "front_tyre_stiffness", "rear_tyre_stiffness",
    "tyre_relaxation", "load_sensitivity", "payload", "cg_shift", "yaw_inertia",
    "steering_offset", "steering_ratio", "steering_delay", "steering_lag", "steering_backlash",
    "compliance_steer", "rear_wheel_steer", "drive_torque_gain", "brake_torque_gain",
    "drive_torque_delay", "drive_torque_lag", "torque_offset", "power_limit", "rotating_inertia",
    "wheel_radius", "brake_drag_one_side", "imu_bias", "imu_tilt", "imu_lever_arm", "imu_delay",
    "odometry_scale", "gyro_scale", "odometry_filter", "clock_offset",
]  # fmt: skip


@pytest.fixture(scope="module")
def course() -> ResidualProblem:
    """A drive with torque and steering of several frequencies."""
    evidence = steady(22.0, seconds=40.0)
    t = evidence.command_s
    command = np.column_stack(
        [
            900.0 * np.sin(0.9 * t) + 500.0 * np.sign(np.sin(2.3 * t)),
            0.025 * np.sin(1.3 * t) + 0.01 * np.sin(5.0 * t),
        ]
    )
    return prepare_residual_problem(with_commands(evidence, command))


@pytest.fixture(scope="module")
def likelihood(course: ResidualProblem) -> Likelihood:
    p = car(drag_area=0.5, rolling=0.01)
    own = SurrogateModel(p, np.zeros(6), 1e-4 * np.ones((6, course.bins)), np.empty((0, SIZE)))
    return Likelihood.of(course, own)


def test_all_names_are_there() -> None:
    assert sorted(EFFECTS) == sorted(NAMES)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda e: e.name)
def test_an_effect_is_whole(effect: Effect) -> None:
    assert all((effect.equation, effect.excitation, effect.equations, effect.activations))
    assert all(name in EFFECTS for name in effect.confusables)
    for p in effect.parameters:
        low, high = p.bounds()
        assert low <= p.theta_neutral <= high
        assert all(entry in INDEX for entry in p.targets)
        assert not p.is_material(p.theta_neutral)
        for start in p.starts:
            assert low <= p.theta(start) <= high
            assert p.value(p.theta(start)) == pytest.approx(start)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda e: e.name)
def test_neutral_adds_nothing_and_anything_else_something(
    likelihood: Likelihood, effect: Effect
) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    before = likelihood.residuals(none, [])
    np.testing.assert_allclose(
        likelihood.residuals(none, [inactive_effect(effect)]), before, atol=1e-9
    )
    for j, p in enumerate(effect.parameters):
        inner = [q.theta_neutral for q in effect.parameters]
        inner[j] = p.theta(p.starts[-1]) if p.starts else p.theta_neutral + 10.0 * p.step
        after = likelihood.residuals(none, [ActiveEffect(effect, tuple(inner))])
        assert np.abs(after - before).max() > 0.1, p.name


def test_a_gate_limits_an_effect_to_a_time(
    course: ResidualProblem, likelihood: Likelihood
) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    before = likelihood.residuals(none, [])
    late = ActiveEffect(EFFECTS["imu_bias"], (0.5, 0.0, 0.0), Activation(onset_s=20.0))
    change = (likelihood.residuals(none, [late]) - before)[: course.bins]
    assert np.abs(change[course.bin_s < 18.0]).max() < 1e-6
    assert np.abs(change[course.bin_s > 22.0]).min() > 1.0


def test_intervals_of_a_place(course: ResidualProblem) -> None:
    distance = (course.middle_s * 22.0) % 220.0
    gate = Activation(segments=((44.0, 88.0),), lap_length=220.0, distance=distance)
    assert gate.kind == "place"
    intervals = gate.intervals(course)
    assert len(intervals) == 4
    np.testing.assert_allclose(intervals[1], [12.0, 14.0], atol=0.02)
    # Across the lap's beginning.
    gate = Activation(segments=((198.0, 242.0),), lap_length=220.0, distance=distance)
    np.testing.assert_allclose(gate.intervals(course)[1], [9.0, 11.0], atol=0.02)


def test_its_variables_go_out_and_in() -> None:
    gate = Activation(segments=((1.0, 2.0), (5.0, 6.0)), lap_length=10.0, distance=np.zeros(1))
    assert gate.variables() == [1.0, 2.0, 5.0, 6.0]
    assert gate.with_variables([1.5, 2.0, 5.0, 7.0]).segments == ((1.5, 2.0), (5.0, 7.0))
    assert Activation(onset_s=3.0).with_variables([4.0]).onset_s == 4.0


def test_stretches_that_pay() -> None:
    gain = np.array([-1.0, 30.0, 0.0, 30.0, -1.0, -50.0, 0.5, -1.0, 40.0, 40.0])
    mask = optimal_segmentation(gain, 16.0)
    # What says nothing between two that pay joins them; one that pays less than a stretch is left.
    np.testing.assert_array_equal(np.flatnonzero(mask), [0, 1, 2, 3, 8, 9])
    assert segments_of_mask(mask, 100.0) == ((80.0, 140.0),)
    assert not optimal_segmentation(-np.ones(10), 16.0).any()
    assert optimal_segmentation(np.ones(40), 16.0).all()


def test_a_bias_below_what_is_worth_a_name_is_tolerance(likelihood: Likelihood) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    course = likelihood.problem
    imu = course.log.imu + np.array([0.012, 0.0, 0.0])
    shifted = replace(likelihood, problem=replace(course, log=replace(course.log, imu=imu)))
    off = none.copy()
    off[len(TOLERANCE_PARAMETERS) + list(SENSOR_OFFSETS).index("bias_a_x")] = 0.012
    np.testing.assert_allclose(
        shifted.residuals(off, []), likelihood.residuals(none, []), atol=1e-6
    )
    for parameter, most in zip(
        EFFECTS["imu_bias"].parameters,
        likelihood.nuisance_bounds()[len(TOLERANCE_PARAMETERS) :],
        strict=False,
    ):
        assert most < parameter.materiality_threshold


def test_less_is_asked_of_a_stand_in_that_meets_its_simulator() -> None:
    plain = Hypothesis((), np.zeros(N_FIXED_NUISANCES), 1000.0)
    good, poor = (
        SelectionPath(expected_loss=1000.0, surrogate_error_dof=10.0),
        SelectionPath(expected_loss=1000.0, surrogate_error_dof=2000.0),
    )
    assert min_required_gain(plain, good) < 50.0
    assert min_required_gain(plain, poor) > 200.0


def test_a_slope_begins_gradually_and_wetness_at_once() -> None:
    distance = np.linspace(0.0, 300.0, 3001)
    sharp = inside_segments(distance, ((100.0, 200.0),), 300.0)
    soft = inside_segments(distance, ((100.0, 200.0),), 300.0, 18.0)
    assert sharp[1040] > 0.95 > soft[1040] > 0.5
    assert soft[1000] == pytest.approx(0.5, abs=0.01)
    assert set(GRADUAL_EDGE_WIDTHS) == {"road_grade", "road_bank"}
