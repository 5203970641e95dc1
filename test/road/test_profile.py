# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank of known hills: values, intervals, and what determines the level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.road import Hilly, circle, flat, hills, hilly

from adk_ros.numerics.arrays import FloatArray
from adk_ros.road.open_loop import held_out_speed_error, speed_error
from adk_ros.road.profile import STANDING_SPEED, START, RoadProfile, road_profile


def profile_of(hilly: Hilly) -> RoadProfile:
    profile = road_profile(hilly.drive)
    assert profile is not None
    return profile


def true_grade(hilly: Hilly, profile: RoadProfile) -> FloatArray:
    return np.asarray(np.interp(profile.at_s, hilly.at_s, hilly.grade))


def turned_round(distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a path along x for 700 m and back on the other lane."""
    out = distance < 700.0
    over = np.clip(distance - 700.0, 0.0, 10.0 * np.pi)
    angle = over / 10.0
    x = np.where(out, distance, 700.0 + 10.0 * np.sin(angle) - np.maximum(distance - 731.4, 0.0))
    # A loop of 20 m, then a change to 3 m beside the way out.
    y = 10.0 * (1.0 - np.cos(angle)) - 17.0 * np.clip((distance - 731.4) / 60.0, 0.0, 1.0)
    return x, y, angle


def there_and_back(distance: FloatArray) -> FloatArray:
    """Return the grade of `turned_round`, which changes its sign on the way back."""
    return np.where(distance < 715.7, hills(distance) + 0.03, -hills(1431.4 - distance) - 0.03)


@pytest.mark.parametrize("seed", [1, 2])
def test_hills_are_found_with_their_interval(seed: int) -> None:
    drive = hilly(seed=seed)
    profile = profile_of(drive)
    truth = true_grade(drive, profile)
    assert np.corrcoef(truth, profile.grade.value)[0, 1] > 0.99
    inside = (truth >= profile.grade.low) & (truth <= profile.grade.high)
    assert inside.mean() > 0.85
    assert float(np.std(profile.grade.value - truth)) < 0.004


def test_the_error_of_speed_falls_by_four_fifths() -> None:
    drive = hilly(seed=3)
    variances = profile_of(drive).grade_variances
    before, after = held_out_speed_error(drive.drive, variances, STANDING_SPEED)
    assert after < 0.2 * before
    # By the true grade, which explains no noise.
    _, least = speed_error(drive.drive, drive.at_s, drive.grade, STANDING_SPEED)
    assert least < after


def test_a_grade_that_changes_too_fast_is_not_explained_by_itself() -> None:
    """The noise of a_x, taken for a grade, does not predict itself."""
    drive = hilly(flat, seed=4)
    rng = np.random.default_rng(4)
    noisy = replace(drive.drive, a_x=drive.drive.a_x + np.repeat(rng.normal(0.0, 0.5, 120), 100))
    profile = road_profile(noisy)
    assert profile is not None
    before, after = held_out_speed_error(noisy, profile.grade_variances, STANDING_SPEED)
    _, by_itself = speed_error(noisy, profile.at_s, profile.grade.value, STANDING_SPEED)
    assert by_itself < 0.5 * before
    assert after > 0.8 * before


def test_too_short_a_drive_has_no_error() -> None:
    short = replace(hilly(seed=3).drive, imu_at_s=np.zeros(1))
    assert np.isnan(held_out_speed_error(short, START, STANDING_SPEED)).all()


@pytest.mark.parametrize("body", [0.0, 0.04, 0.08])
def test_strong_accelerations_are_no_grade(body: float) -> None:
    """The car accelerates and brakes with 2.6 m/s² on a flat road."""
    profile = profile_of(hilly(flat, body=body, swing=7.0))
    assert (profile.grade.low <= 0.0).all()
    assert (profile.grade.high >= 0.0).all()


def test_on_an_open_road_the_level_is_undetermined() -> None:
    drive = hilly(offset=0.2)
    profile = profile_of(drive)
    assert profile.level_by == ""
    assert profile.grade.level > 0.05
    assert profile.grade.relative < 0.01
    truth = true_grade(drive, profile)
    assert ((truth >= profile.grade.low) & (truth <= profile.grade.high)).all()


def test_a_closed_path_separates_the_offset() -> None:
    drive = hilly(path=circle, offset=0.2)
    profile = profile_of(drive)
    assert "heights" in profile.level_by
    assert profile.repeated > 0.5
    assert profile.grade.offset == pytest.approx(0.2, abs=0.02)
    assert profile.grade.offset_error < 0.05
    assert abs(float(np.mean(profile.grade.value - true_grade(drive, profile)))) < 0.002


def test_both_directions_separate_the_offset() -> None:
    drive = hilly(there_and_back, turned_round, offset=-0.2)
    profile = profile_of(drive)
    assert "both directions" in profile.level_by
    assert (profile.direction < 0.0).mean() > 0.3
    assert profile.grade.offset == pytest.approx(-0.2, abs=0.03)
    assert float(np.std(profile.grade.value - true_grade(drive, profile))) < 0.005


def test_bank_is_found_up_to_its_level() -> None:
    drive = hilly(flat, bank=hills)
    profile = profile_of(drive)
    truth = np.interp(profile.at_s, drive.at_s, drive.bank)
    assert np.corrcoef(truth, profile.bank.value)[0, 1] > 0.97
    assert profile.bank.level > 0.05


def test_without_v_y_and_pose_a_profile_over_time_remains() -> None:
    drive = hilly(seed=4)
    less = replace(drive.drive, v_y=None, x=None, y=None, heading=None)
    profile = road_profile(less)
    assert profile is not None
    assert profile.x is None
    assert len(profile.assumed) == 3
    assert np.corrcoef(true_grade(drive, profile), profile.grade.value)[0, 1] > 0.99


def test_a_pose_that_does_not_move_is_no_return() -> None:
    drive = hilly(seconds=60.0).drive
    assert drive.x is not None
    profile = road_profile(replace(drive, x=0.0 * drive.x, y=0.0 * drive.x))
    assert profile is not None
    assert profile.level_by == ""
    assert profile.repeated == 0.0


def test_standing_and_gaps_have_no_profile() -> None:
    drive = hilly().drive
    standing = (drive.odometry_at_s > 40.0) & (drive.odometry_at_s < 50.0)
    v_x = np.where(standing, 0.0, drive.v_x)
    profile = road_profile(replace(drive, v_x=v_x, unusable=((70.0, 75.0),)))
    assert profile is not None
    for begin, end in ((40.3, 49.7), (70.0, 75.0)):
        assert not ((profile.at_s > begin) & (profile.at_s < end)).any()


def test_low_rates_are_enough() -> None:
    drive = hilly(seed=5)
    d = drive.drive
    o, i = slice(None, None, 10), slice(None, None, 10)
    columns = {
        name: getattr(d, name)[o]
        for name in ("odometry_at_s", "v_x", "yaw_rate", "v_y", "x", "y", "heading")
    }
    slow = replace(d, imu_at_s=d.imu_at_s[i], a_x=d.a_x[i], a_y=d.a_y[i], **columns)
    profile = road_profile(slow)
    assert profile is not None
    assert np.corrcoef(true_grade(drive, profile), profile.grade.value)[0, 1] > 0.98


def test_a_short_drive_has_none() -> None:
    assert road_profile(hilly(seconds=4.0).drive) is None
