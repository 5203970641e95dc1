# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank as findings: what they need, and the comparison with an attitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.road import as_streams, circle, hills, hilly

from adk_ros.bags import IMU_TYPE, ODOMETRY_TYPE, message
from adk_ros.calibration.attitude import attitude_of, attitude_row
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.road import check_road
from adk_ros.calibration.streams import Stream, Streams


def found(streams: Streams) -> dict[str, Finding]:
    return {x.name: x for x in check_road(streams, [])[0]}


def test_grade_and_bank_are_said_with_their_intervals() -> None:
    findings = found(as_streams(hilly(path=circle)))
    grade, bank = findings["road_grade"], findings["road_bank"]
    assert grade.verdict is Verdict.OK
    assert "equal heights" in grade.text
    assert "v_x after 1 s" in grade.evidence
    assert grade.low is not None
    assert grade.high is not None
    assert grade.low < 0.0 < grade.high
    assert "level undetermined" in bank.text


def test_an_open_road_says_that_the_level_is_undetermined() -> None:
    assert "level undetermined" in found(as_streams(hilly()))["road_grade"].text


@pytest.mark.parametrize("absent", ["imu", "odometry"])
def test_a_missing_stream_is_the_reason(absent: str) -> None:
    streams = as_streams(hilly(seconds=30.0))
    less = replace(streams, imu=None) if absent == "imu" else replace(streams, odometry=None)
    grade = found(less)["road_grade"]
    assert grade.verdict is Verdict.NOT_DECIDABLE
    assert ("no IMU" if absent == "imu" else "no v_x") in grade.text


def test_accelerations_without_gravity_have_no_slope() -> None:
    streams = as_streams(hilly(seconds=30.0))
    assert streams.imu is not None
    without = streams.imu.having(a_z=streams.imu["a_z"] - 9.81)
    assert "gravity is removed" in found(replace(streams, imu=without))["road_grade"].text
    unreported = streams.imu.having(a_z=np.zeros_like(without["a_z"]))
    assert found(replace(streams, imu=unreported))["road_grade"].verdict is Verdict.OK


def test_a_cliff_is_a_faulty_channel() -> None:
    streams = as_streams(hilly(seconds=30.0))
    assert streams.odometry is not None
    fast = streams.odometry.having(v_x=20.0 * streams.odometry["v_x"])
    grade = found(replace(streams, odometry=fast))["road_grade"]
    assert grade.verdict is Verdict.NOT_DECIDABLE
    assert "more than 60%" in grade.text


def test_the_attitude_of_an_ins_agrees() -> None:
    findings = found(as_streams(hilly(bank=hills), attitude=True))
    assert findings["ins_pitch"].verdict is Verdict.OK
    assert findings["ins_pitch"].value == pytest.approx(1.0, abs=0.05)
    assert findings["ins_roll"].verdict is Verdict.OK


def test_a_flipped_pitch_is_a_finding() -> None:
    streams = as_streams(hilly(), attitude=True)
    assert streams.attitude is not None
    flipped = streams.attitude.having(pitch=-streams.attitude["pitch"])
    findings = found(replace(streams, attitude=flipped))
    assert findings["ins_pitch"].verdict is Verdict.FINDING
    assert "sign flipped" in findings["ins_pitch"].text
    # The road is flat across: nothing to compare the roll with.
    assert "ins_roll" not in findings


def quaternion(roll: float, pitch: float, heading: float) -> list[float]:
    """Return x, y, z, w."""
    cr, cp, ch = np.cos(0.5 * np.array([roll, pitch, heading]))
    sr, sp, sh = np.sin(0.5 * np.array([roll, pitch, heading]))
    return [
        float(sr * cp * ch - cr * sp * sh),
        float(cr * sp * ch + sr * cp * sh),
        float(cr * cp * sh - sr * sp * ch),
        float(cr * cp * ch + sr * sp * sh),
    ]


def test_roll_and_pitch_come_from_the_orientation() -> None:
    angles = [(0.02, -0.05, 1.0), (-0.03, 0.1, -2.0)]
    at = np.array([0.0, 1.0])
    attitude = attitude_of(at, np.array([quaternion(*each) for each in angles]), np.eye(3))
    assert isinstance(attitude, Stream)
    np.testing.assert_allclose(attitude["roll"], [0.02, -0.03], atol=1e-9)
    np.testing.assert_allclose(attitude["pitch"], [-0.05, 0.1], atol=1e-9)
    flat = np.array([quaternion(0.0, 0.0, each) for each in (0.0, 1.0)])
    assert attitude_of(at, flat, np.eye(3)) is None


def test_an_orientation_that_is_not_reported_is_none() -> None:
    header = {"stamp": 10**9, "frame_id": "imu"}
    q = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    given = message(IMU_TYPE, header=header, orientation=q)
    assert attitude_row(given)[1:] == [0.0, 0.0, 0.0, 1.0]
    given.orientation_covariance[0] = -1.0
    assert np.isnan(attitude_row(given)[1:]).all()
    pose = {"pose": {"orientation": dict(q, w=0.0)}}
    assert np.isnan(attitude_row(message(ODOMETRY_TYPE, header=header, pose=pose))[1:]).all()


def test_a_drive_too_short_to_leave_out_a_part_has_no_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    nan = float("nan")
    monkeypatch.setattr("adk_ros.calibration.road.held_out_speed_error", lambda *_: (nan, nan))
    evidence = found(as_streams(hilly(seconds=30.0)))["road_grade"].evidence
    assert "nan" not in evidence
    assert "v_x after 1 s" not in evidence
    assert "assumed: " in evidence
