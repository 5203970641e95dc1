# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Experiment design: manoeuvres that discriminate between competing effects."""

import numpy as np
import pytest
from helpers.mismatch_report import drag

from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    manoeuvres,
    most_discriminating_manoeuvre,
    parameters_with_effects,
)
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import DISCRIMINATION_LOSS
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.report.report_tables import discriminability_text, group_rows

NOISE = np.array([0.02, 0.02, 1e-3, 0.01, 0.01, 1e-3])


def car() -> np.ndarray:
    p = default_parameters()
    p[INDEX["mass"]], p[INDEX["yaw_inertia"]] = 2000.0, 3500.0
    return p


def compare(
    name: str, theta: tuple[float, ...], other: str, other_theta: tuple[float, ...]
) -> Discriminability:
    identified = ActiveEffect(EFFECTS[name], theta)
    competitor = ActiveEffect(EFFECTS[other], other_theta)
    return most_discriminating_manoeuvre(car(), [identified], 0, competitor, NOISE)


def test_yaw_excitation_separates_payload_and_torque_gain() -> None:
    """Both reduce the acceleration; only a payload adds yaw inertia."""
    found = compare("payload", (500.0,), "drive_torque_gain", (1.0 / 1.25,))
    assert found.distinguishes
    assert "steer" in found.manoeuvre or "slalom" in found.manoeuvre or "bend" in found.manoeuvre


def test_a_range_of_speeds_separates_drag_and_wind() -> None:
    """They are equal at one speed: the force of a headwind is not quadratic in speed."""
    p = car()
    p[INDEX["drag_area"]] = 0.7
    speed, cda = 15.0, 0.5
    wind = speed - speed * np.sqrt((0.7 + cda) / 0.7)
    found = most_discriminating_manoeuvre(
        p,
        [ActiveEffect(EFFECTS["aero_drag"], (cda,))],
        0,
        ActiveEffect(EFFECTS["headwind"], (float(wind),)),
        NOISE,
    )
    assert found.distinguishes
    assert "straight" in found.manoeuvre


def test_equivalent_effects_are_not_separated() -> None:
    radius = 1.05
    same = compare("drive_torque_gain", (1.0 / radius,), "wheel_radius", (1.0 / radius,))
    assert same.tried == len(manoeuvres())
    tilt, bias = (0.02, -0.01), (0.01 * 9.80665, 0.02 * 9.80665, 0.0)
    equal = compare("imu_tilt", tilt, "imu_bias", bias)
    assert not equal.distinguishes
    assert equal.loss < 1.0
    assert same.loss < 10.0 * DISCRIMINATION_LOSS


@pytest.mark.parametrize(
    ("name", "theta", "absent"),
    [
        ("imu_delay", (0.04,), (0.0,)),
        ("imu_lever_arm", (0.8, 0.4), (0.0, 0.0)),
        ("odometry_filter", (0.3,), (0.0,)),
    ],
)
def test_sensor_faults_are_simulated(
    name: str, theta: tuple[float, ...], absent: tuple[float, ...]
) -> None:
    """Each changes the sensors' signals only, not the motion."""
    assert compare(name, theta, name, absent).distinguishes


def test_steering_separates_imu_delay_and_lever_arm() -> None:
    result = compare("imu_delay", (0.04,), "imu_lever_arm", (0.5, 0.0))
    assert result.distinguishes
    straight = ("coasting", "acceleration from", "braking", "torque steps")
    assert not any(word in result.manoeuvre for word in straight)


def test_a_sensor_offset_is_a_nuisance() -> None:
    within, beyond = (compare("imu_bias", (x, 0.0, 0.0), "imu_bias", (0.0, 0.0, 0.0))
                      for x in (0.006, 0.3))  # fmt: skip
    assert not within.distinguishes
    assert beyond.loss > 100.0 * within.loss


def test_build_tolerances_reduce_the_loss() -> None:
    """A deviation of the yaw inertia within its tolerance is not distinguishable from none."""
    found = compare("yaw_inertia", (1.003,), "yaw_inertia", (1.0,))
    assert not found.distinguishes
    assert compare("yaw_inertia", (1.2,), "yaw_inertia", (1.0,)).distinguishes


def test_manoeuvres_are_distinct_and_complete() -> None:
    p = parameters_with_effects(car(), [ActiveEffect(EFFECTS["aero_drag"], (0.5,))])
    assert p[INDEX["drag_area"]] == pytest.approx(0.5)
    assert len({m.text for m in manoeuvres()}) == len(manoeuvres())
    assert all(m.acceleration_request.shape == m.steering_request.shape for m in manoeuvres())


def test_report_states_the_manoeuvre_and_the_loss() -> None:
    separable = Discriminability("aero_drag", "headwind", "coasting down", 900.0, 9)
    assert "from longitudinal wind: coasting down" in discriminability_text(separable)
    assert "none of 9 simulated manoeuvres" in discriminability_text(
        Discriminability("aero_drag", "headwind", "coasting down", 3.0, 9)
    )
    result = drag()
    assert group_rows(result)[0][1] == "-"
    result.discriminability.append(separable)
    assert "900" in group_rows(result)[0][1]
