# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grade and bank of the road from the streams of a recording, as findings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from adk_ros.calibration.continuity import Interval
from adk_ros.calibration.criteria import MATERIAL, MIN_CORRELATION
from adk_ros.calibration.finding import Finding, Verdict, found, not_decidable
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.open_loop import held_out_speed_error
from adk_ros.road.profile import RoadProfile, SlopeProfile, road_profile
from adk_ros.road.recorded_drive import RecordedDrive
from adk_ros.signals.moving_speed import STANDING_SPEED

_EVIDENCE = "random walk along the way in a_x + r v_y - dv_x/dt, a_y - r v_x - dv_y/dt"
_MIN_GRAVITY = 0.3
"""Share of g: a shorter mean vector that varies on z is an acceleration without gravity."""
_MAX_TANGENT = 0.6
"""Steepest slope: 31°, where the grip of off-road tyres ends; public roads end at 0.35."""


def check_road(
    streams: Streams, unusable: Iterable[Interval]
) -> tuple[list[Finding], RoadProfile | None]:
    """Return the findings on grade, bank and the attitude, and the profile of the road."""
    reason = missing_for_road(streams)
    if reason:
        return [not_decidable("road_grade", reason), not_decidable("road_bank", reason)], None
    drive = recorded_drive(streams, unusable)
    profile = road_profile(drive)
    if profile is None:
        reason = "the car moves for less than 5 s in which IMU and odometry are usable"
        return [not_decidable("road_grade", reason), not_decidable("road_bank", reason)], None
    findings = [_grade(profile, drive), _bank(profile)]
    if streams.attitude is not None:
        findings += _against_attitude(profile, streams.attitude)
    return findings, profile


def missing_for_road(streams: Streams) -> str:
    """Return which channel grade and bank lack, empty if none."""
    imu, odometry = streams.imu, streams.odometry
    if imu is None:
        return "the recording has no IMU: gravity along the road is not measured"
    if not (imu.has("a_x") and imu.has("a_y")):
        return "a_x or a_y of the IMU is not measured"
    if odometry is None or not odometry.has("v_x"):
        return "the recording has no v_x, whose change must be subtracted from a_x"
    a = np.array([float(np.mean(np.nan_to_num(imu[name]))) for name in ("a_x", "a_y", "a_z")])
    if imu.has("a_z") and float(np.linalg.norm(a)) < _MIN_GRAVITY * GRAVITY:
        return "gravity is removed from the accelerations, and with it the slope"
    return ""


def recorded_drive(streams: Streams, unusable: Iterable[Interval]) -> RecordedDrive:
    """Return what the estimate of the road needs; the streams must have IMU and v_x."""
    imu, odometry = streams.imu, streams.odometry
    assert imu is not None
    assert odometry is not None
    at = odometry.at_s
    if imu.has("w_z"):
        rate = np.interp(at, imu.at_s, imu["w_z"])
    elif odometry.has("yaw_rate"):
        rate = odometry["yaw_rate"]
    elif odometry.has("heading"):
        rate = np.gradient(odometry["heading"], at)
    else:
        rate = np.zeros_like(at)

    def where_measured(name: str) -> FloatArray | None:
        return odometry[name] if odometry.has(name) else None

    return RecordedDrive(
        at,
        odometry["v_x"],
        np.asarray(rate),
        imu.at_s,
        imu["a_x"],
        imu["a_y"],
        where_measured("v_y"),
        where_measured("x"),
        where_measured("y"),
        where_measured("heading"),
        tuple(unusable),
    )


def _grade(profile: RoadProfile, drive: RecordedDrive) -> Finding:
    before, after = held_out_speed_error(drive, profile.grade_variances, STANDING_SPEED)
    evidence = [_EVIDENCE]
    if math.isfinite(before) and math.isfinite(after):
        evidence.append(
            f"the kinematic error of v_x after 1 s is {before:.2f} m/s, with the grade by the "
            f"data before and after {after:.2f} m/s"
        )
    evidence.append(f"assumed: {'; '.join(profile.assumed)}")
    level = profile.grade.level
    if profile.level_by:
        text = f"level by {profile.level_by}"
    else:
        text = (
            f"level undetermined within ±{level:.1%}: no return and no other direction separates "
            "it from the offset of the IMU"
        )
    return _judged("road_grade", profile.grade, text, "; ".join(evidence))


def _bank(profile: RoadProfile) -> Finding:
    text = f"level undetermined within ±{profile.bank.level:.1%} (offset of the IMU)"
    return _judged("road_bank", profile.bank, text, _EVIDENCE)


def _judged(name: str, slope: SlopeProfile, level: str, evidence: str) -> Finding:
    """Return the finding on a profile, decided where changes along the way are."""
    tangent = np.tan(slope.value)
    mean, rms = float(tangent.mean()), float(np.sqrt(np.mean(tangent**2)))
    size = MATERIAL[name].size
    low, high = np.percentile(100.0 * tangent, [0.0, 100.0])
    number = (
        f"{low:.1f} to {high:.1f} %, RMS {100.0 * rms:.1f} %, changes within "
        f"±{100.0 * slope.relative:.1f} %; {level}"
    )
    is_decided = slope.relative <= size
    if float(np.abs(tangent).max()) > _MAX_TANGENT:
        reason = f"slopes of more than {_MAX_TANGENT:.0%} mean that a_x, a_y or v_x is wrong"
        return not_decidable(name, reason, evidence)
    if not is_decided:
        number = (
            f"not decidable, because its changes are uncertain by more than ±{size:.1%}: {number}"
        )
    return Finding(
        name,
        Verdict.OK if is_decided else Verdict.NOT_DECIDABLE,
        number,
        mean,
        mean - slope.level,
        mean + slope.level,
        "1",
        evidence=evidence,
    )


def attitude_comparison(
    profile: RoadProfile, attitude: Stream
) -> Iterator[tuple[str, float, float, float]]:
    """Yield name, correlation, scale and RMS angle, rad, of the INS for grade and bank."""
    # Uphill is nose up, which is a negative pitch (REP-103).
    for name, slope, column, sign in (
        ("grade", profile.grade, "pitch", -1.0),
        ("bank", profile.bank, "roll", 1.0),
    ):
        angle = sign * np.interp(profile.at_s, attitude.at_s, attitude[column])
        spread = float(np.std(angle))
        if spread == 0.0 or float(np.std(slope.value)) == 0.0:
            continue
        covariance = float(np.mean((angle - angle.mean()) * (slope.value - slope.value.mean())))
        yield (
            name,
            covariance / (spread * float(np.std(slope.value))),
            covariance / spread**2,
            spread,
        )


def _against_attitude(profile: RoadProfile, attitude: Stream) -> Iterator[Finding]:
    for name, correlation, scale, spread in attitude_comparison(profile, attitude):
        column = "pitch" if name == "grade" else "roll"
        text = (
            f"{name} follows the {column} of the INS with a correlation of {correlation:.2f} and "
            f"a scale of {scale:.2f}"
        )
        check = f"ins_{column}"
        evidence = f"{name} along the way against the {column}, which has an RMS of {spread:.1%}"
        if spread < MATERIAL[f"road_{name}"].size:
            reason = f"the {column} of the INS changes by {spread:.1%} only"
            yield not_decidable(check, reason, evidence)
        elif correlation > MIN_CORRELATION:
            yield Finding(check, Verdict.OK, text, scale, unit="1", evidence=evidence)
        elif correlation < -MIN_CORRELATION:
            yield found(check, f"the {column} of the INS has its sign flipped: {text}", evidence)
        else:
            yield not_decidable(check, text, evidence)
