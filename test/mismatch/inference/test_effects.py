# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The effect catalogue, and how effects enter the surrogate model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.mismatch import car, steady, with_commands

from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, inactive_effect
from adk_ros.mismatch.inference.identifiability import STRUCTURALLY_EQUIVALENT
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES, TOLERANCE_PARAMETERS
from adk_ros.mismatch.inference.segmentation import optimal_segmentation, segments_of_mask
from adk_ros.mismatch.inference.segments import (
    GRADUAL_EDGE_WIDTHS,
)
from adk_ros.mismatch.inference.selection_path import SelectionPath, min_required_gain
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import SENSOR_OFFSET_PRIORS
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.surrogate.activation import Activation, inside_segments
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import (
    DISTANCE_INTERVAL_S,
    ResidualProblem,
    prepare_residual_problem,
)

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
def problem() -> ResidualProblem:
    """A recording with torque and steering of several frequencies."""
    log = steady(22.0, seconds=40.0)
    t = log.command_s
    command = np.column_stack(
        [
            900.0 * np.sin(0.9 * t) + 500.0 * np.sign(np.sin(2.3 * t)),
            0.025 * np.sin(1.3 * t) + 0.01 * np.sin(5.0 * t),
        ]
    )
    return prepare_residual_problem(with_commands(log, command))


@pytest.fixture(scope="module")
def likelihood(problem: ResidualProblem) -> Likelihood:
    p = car(drag_area=0.5, rolling=0.01)
    residuals = 1e-4 * np.ones((6, problem.bins))
    return Likelihood.of(problem, SurrogateModel(p, np.zeros(6), residuals, np.empty((0, SIZE))))


def test_catalogue_names() -> None:
    assert sorted(EFFECTS) == sorted(NAMES)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda e: e.name)
def test_effect_is_complete(effect: Effect) -> None:
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
def test_only_non_neutral_values_change_residuals(likelihood: Likelihood, effect: Effect) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    before = likelihood.residuals(none, [])
    np.testing.assert_allclose(
        likelihood.residuals(none, [inactive_effect(effect)]), before, atol=1e-9
    )
    for j, p in enumerate(effect.parameters):
        theta = [q.theta_neutral for q in effect.parameters]
        theta[j] = p.theta(p.starts[-1]) if p.starts else p.theta_neutral + 10.0 * p.step
        after = likelihood.residuals(none, [ActiveEffect(effect, tuple(theta))])
        assert np.abs(after - before).max() > 0.1, p.name


def test_onset_limits_an_effect_to_a_time(
    problem: ResidualProblem, likelihood: Likelihood
) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    before = likelihood.residuals(none, [])
    late = ActiveEffect(EFFECTS["imu_bias"], (0.5, 0.0, 0.0), Activation(onset_s=20.0))
    change = (likelihood.residuals(none, [late]) - before)[: problem.bins]
    assert np.abs(change[problem.bin_s < 18.0]).max() < 1e-6
    assert np.abs(change[problem.bin_s > 22.0]).min() > 1.0


def test_time_intervals_of_a_segment(problem: ResidualProblem) -> None:
    distance = (problem.middle_s * 22.0) % 220.0
    activation = Activation(segments=((44.0, 88.0),), lap_length=220.0, distance=distance)
    assert activation.kind == "place"
    intervals = activation.intervals(problem)
    assert len(intervals) == 4
    np.testing.assert_allclose(intervals[1], [12.0, 14.0], atol=0.02)
    # Across the start of the lap.
    activation = Activation(segments=((198.0, 242.0),), lap_length=220.0, distance=distance)
    np.testing.assert_allclose(activation.intervals(problem)[1], [9.0, 11.0], atol=0.02)


def test_activation_variables_round_trip() -> None:
    activation = Activation(
        segments=((1.0, 2.0), (5.0, 6.0)), lap_length=10.0, distance=np.zeros(1)
    )
    assert activation.variables() == [1.0, 2.0, 5.0, 6.0]
    assert activation.with_variables([1.5, 2.0, 5.0, 7.0]).segments == ((1.5, 2.0), (5.0, 7.0))
    assert Activation(onset_s=3.0).with_variables([4.0]).onset_s == 4.0


def test_optimal_segmentation_by_gain_and_penalty() -> None:
    gain = np.array([-1.0, 30.0, 0.0, 30.0, -1.0, -50.0, 0.5, -1.0, 40.0, 40.0])
    mask = optimal_segmentation(gain, 16.0)
    # A bin without gain between two with gain joins them; a gain below the penalty is left out.
    np.testing.assert_array_equal(np.flatnonzero(mask), [0, 1, 2, 3, 8, 9])
    assert segments_of_mask(mask, 100.0) == ((80.0, 140.0),)
    assert not optimal_segmentation(-np.ones(10), 16.0).any()
    assert optimal_segmentation(np.ones(40), 16.0).all()


def test_immaterial_imu_bias_is_a_nuisance(likelihood: Likelihood) -> None:
    none = np.zeros(N_FIXED_NUISANCES)
    problem = likelihood.problem
    imu = problem.log.imu + np.array([0.012, 0.0, 0.0])
    shifted = replace(likelihood, problem=replace(problem, log=replace(problem.log, imu=imu)))
    offsets = none.copy()
    offsets[len(TOLERANCE_PARAMETERS) + list(SENSOR_OFFSET_PRIORS).index("bias_a_x")] = 0.012
    np.testing.assert_allclose(
        shifted.residuals(offsets, []), likelihood.residuals(none, []), atol=1e-6
    )
    for parameter, bound in zip(
        EFFECTS["imu_bias"].parameters,
        likelihood.nuisance_bounds()[len(TOLERANCE_PARAMETERS) :],
        strict=False,
    ):
        assert bound < parameter.materiality_threshold


def test_accurate_surrogate_lowers_the_required_gain() -> None:
    plain = Hypothesis((), np.zeros(N_FIXED_NUISANCES), 1000.0)
    good, poor = (
        SelectionPath(expected_loss=1000.0, surrogate_error_dof=10.0),
        SelectionPath(expected_loss=1000.0, surrogate_error_dof=2000.0),
    )
    assert min_required_gain(plain, good) < 50.0
    assert min_required_gain(plain, poor) > 150.0
    # Next to another effect, whose equation is inexact, more is required.
    next_to = replace(plain, effects=(ActiveEffect(EFFECTS["aero_drag"], (1.0,)),), loss=1001.0)
    assert min_required_gain(next_to, good) > min_required_gain(plain, good)
    assert min_required_gain(next_to, poor) > min_required_gain(plain, poor)


@pytest.mark.parametrize(
    ("one", "other"),
    [("rolling_resistance", "torque_offset"), ("drive_torque_gain", "wheel_radius")],
)
def test_equal_forces_are_alternatives_both_ways(one: str, other: str) -> None:
    assert STRUCTURALLY_EQUIVALENT[one] == (other,)
    assert STRUCTURALLY_EQUIVALENT[other] == (one,)


def test_only_grade_and_bank_change_gradually() -> None:
    distance = np.linspace(0.0, 300.0, 3001)
    sharp = inside_segments(distance, ((100.0, 200.0),), 300.0)
    soft = inside_segments(distance, ((100.0, 200.0),), 300.0, 18.0)
    assert sharp[1040] > 0.95 > soft[1040] > 0.5
    assert soft[1000] == pytest.approx(0.5, abs=0.01)
    assert set(GRADUAL_EDGE_WIDTHS) == {"road_grade", "road_bank"}


def test_held_out_part_excludes_later_distance_intervals(likelihood: Likelihood) -> None:
    problem = likelihood.problem
    none = np.zeros(N_FIXED_NUISANCES)
    until_s = problem.start_s + 5.5 * DISTANCE_INTERVAL_S
    early = replace(likelihood, until_s=until_s)
    assert early.residuals(none, []).size - 6 * problem.bins == 5
    assert likelihood.residuals(none, []).size - 6 * problem.bins == problem.distances.shape[0]
