# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What to drive next is simulated: some pairs a manoeuvre tells apart, some none does."""

import numpy as np
import pytest
from mismatch_report_tools import drag

from adk_ros.mismatch.catalogue import EFFECTS
from adk_ros.mismatch.likelihood import Active
from adk_ros.mismatch.manoeuvres import ENOUGH, Separation, manoeuvres, separate, vector
from adk_ros.mismatch.parameters import INDEX, usual
from adk_ros.mismatch.report.tables import group_rows, separation_text

NOISE = np.array([0.02, 0.02, 1e-3, 0.01, 0.01, 1e-3])


def car() -> np.ndarray:
    p = usual()
    p[INDEX["mass"]], p[INDEX["yaw_inertia"]] = 2000.0, 3500.0
    return p


def told(name: str, inner: tuple[float, ...], other: str, rival: tuple[float, ...]) -> Separation:
    mine, theirs = Active(EFFECTS[name], inner), Active(EFFECTS[other], rival)
    return separate(car(), [mine], 0, theirs, NOISE)


def test_a_payload_and_a_weak_drive_part_where_yaw_is_excited() -> None:
    """Both slow a car down alike; only one of them has a yaw inertia."""
    found = told("payload", (500.0,), "drive_torque_gain", (1.0 / 1.25,))
    assert found.tells
    assert "steer" in found.manoeuvre or "slalom" in found.manoeuvre or "bend" in found.manoeuvre


def test_drag_and_wind_part_over_a_range_of_speeds() -> None:
    """Alike at one speed: a headwind's share of the drag goes with speed, not with its square."""
    p = car()
    p[INDEX["drag_area"]] = 0.7
    speed, cda = 15.0, 0.5
    wind = speed - speed * np.sqrt((0.7 + cda) / 0.7)
    found = separate(
        p, [Active(EFFECTS["aero_drag"], (cda,))], 0,
        Active(EFFECTS["headwind"], (float(wind),)), NOISE,
    )
    assert found.tells
    assert "straight" in found.manoeuvre


def test_what_is_the_same_on_every_drive_no_manoeuvre_parts() -> None:
    radius = 1.05
    same = told("drive_torque_gain", (1.0 / radius,), "wheel_radius", (1.0 / radius,))
    assert same.tried == len(manoeuvres())
    tilt, bias = (0.02, -0.01), (0.01 * 9.80665, 0.02 * 9.80665, 0.0)
    equal = told("imu_tilt", tilt, "imu_bias", bias)
    assert not equal.tells
    assert equal.loss < 1.0
    assert same.loss < 10.0 * ENOUGH


def test_tolerances_take_what_they_can() -> None:
    """An inertia that is off by less than a car's usual tolerance is not told from none."""
    found = told("yaw_inertia", (1.003,), "yaw_inertia", (1.0,))
    assert not found.tells
    assert told("yaw_inertia", (1.2,), "yaw_inertia", (1.0,)).tells


def test_the_car_does_what_is_asked_of_it() -> None:
    p = vector(car(), [Active(EFFECTS["aero_drag"], (0.5,))])
    assert p[INDEX["drag_area"]] == pytest.approx(0.5)
    assert len({m.text for m in manoeuvres()}) == len(manoeuvres())
    assert all(m.push.shape == m.angle.shape for m in manoeuvres())


def test_the_report_says_what_was_simulated() -> None:
    tells = Separation("aero_drag", "headwind", "coasting down", 900.0, 9)
    assert "from wind along the road: coasting down" in separation_text(tells)
    assert "none of 9 simulated manoeuvres" in separation_text(
        Separation("aero_drag", "headwind", "coasting down", 3.0, 9)
    )
    findings = drag()
    assert group_rows(findings)[0][1] == "-"
    findings.separations.append(tells)
    assert "900" in group_rows(findings)[0][1]
