# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What to drive next is simulated: some pairs a manoeuvre tells apart, some none does."""

import numpy as np
import pytest
from helpers.mismatch_report import drag

from adk_ros.mismatch.inference.experiment_design import (
    DISCRIMINATION_LOSS,
    Discriminability,
    manoeuvres,
    most_discriminating_manoeuvre,
    parameters_with_effects,
)
from adk_ros.mismatch.inference.likelihood import ActiveEffect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.report.report_tables import discriminability_text, group_rows

NOISE = np.array([0.02, 0.02, 1e-3, 0.01, 0.01, 1e-3])


def car() -> np.ndarray:
    p = default_parameters()
    p[INDEX["mass"]], p[INDEX["yaw_inertia"]] = 2000.0, 3500.0
    return p


def told(
    name: str, inner: tuple[float, ...], other: str, rival: tuple[float, ...]
) -> Discriminability:
    mine, theirs = ActiveEffect(EFFECTS[name], inner), ActiveEffect(EFFECTS[other], rival)
    return most_discriminating_manoeuvre(car(), [mine], 0, theirs, NOISE)


def test_a_payload_and_a_weak_drive_part_where_yaw_is_excited() -> None:
    """Both slow a car down alike; only one of them has a yaw inertia."""
    found = told("payload", (500.0,), "drive_torque_gain", (1.0 / 1.25,))
    assert found.distinguishes
    assert "steer" in found.manoeuvre or "slalom" in found.manoeuvre or "bend" in found.manoeuvre


def test_drag_and_wind_part_over_a_range_of_speeds() -> None:
    """Alike at one speed: a headwind's share of the drag goes with speed, not with its square."""
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


def test_what_is_the_same_on_every_drive_no_manoeuvre_parts() -> None:
    radius = 1.05
    same = told("drive_torque_gain", (1.0 / radius,), "wheel_radius", (1.0 / radius,))
    assert same.tried == len(manoeuvres())
    tilt, bias = (0.02, -0.01), (0.01 * 9.80665, 0.02 * 9.80665, 0.0)
    equal = told("imu_tilt", tilt, "imu_bias", bias)
    assert not equal.distinguishes
    assert equal.loss < 1.0
    assert same.loss < 10.0 * DISCRIMINATION_LOSS


def test_tolerances_take_what_they_can() -> None:
    """An inertia that is off by less than a car's usual tolerance is not told from none."""
    found = told("yaw_inertia", (1.003,), "yaw_inertia", (1.0,))
    assert not found.distinguishes
    assert told("yaw_inertia", (1.2,), "yaw_inertia", (1.0,)).distinguishes


def test_the_car_does_what_is_asked_of_it() -> None:
    p = parameters_with_effects(car(), [ActiveEffect(EFFECTS["aero_drag"], (0.5,))])
    assert p[INDEX["drag_area"]] == pytest.approx(0.5)
    assert len({m.text for m in manoeuvres()}) == len(manoeuvres())
    assert all(m.acceleration_request.shape == m.steering_request.shape for m in manoeuvres())


def test_the_report_says_what_was_simulated() -> None:
    tells = Discriminability("aero_drag", "headwind", "coasting down", 900.0, 9)
    assert "from longitudinal wind: coasting down" in discriminability_text(tells)
    assert "none of 9 simulated manoeuvres" in discriminability_text(
        Discriminability("aero_drag", "headwind", "coasting down", 3.0, 9)
    )
    findings = drag()
    assert group_rows(findings)[0][1] == "-"
    findings.discriminability.append(tells)
    assert "900" in group_rows(findings)[0][1]
