# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Heading and sideslip of odometry against the direction of a receiver's velocity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration import added, existing, scaled
from helpers.satellite import with_course, write_with_receiver

from adk_ros.api.check import check_recording
from adk_ros.calibration.course import check_course
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.grid import on_grid
from adk_ros.calibration.streams import Streams
from adk_ros.signals.decode import SensorConfig


def found(streams: Streams, sensors: SensorConfig | None = None) -> dict[str, Finding]:
    s = on_grid(streams, [])
    assert s is not None
    return {x.name: x for x in check_course(s, streams.gps_speed, sensors or SensorConfig())}


def without_pose(streams: Streams) -> Streams:
    return scaled("odometry", 0.0, "x", "y")(streams)


def without_v_y(streams: Streams) -> Streams:
    odometry = existing(streams, "odometry")
    unknown = np.full(odometry.at_s.size, np.nan)
    return replace(streams, odometry=odometry.having(v_y=unknown))


def degrees(finding: Finding) -> tuple[float, float, float]:
    assert finding.value is not None
    assert finding.low is not None
    assert finding.high is not None
    low, value, high = np.degrees([finding.low, finding.value, finding.high])
    return float(low), float(value), float(high)


@pytest.mark.parametrize("scenario", ["town", "handling"])
@pytest.mark.parametrize("delay_s", [0.0, 0.3])
@pytest.mark.parametrize("ahead", [0.0, 0.8])
def test_a_course_that_agrees_is_ok(scenario: str, delay_s: float, ahead: float) -> None:
    """Neither the delay of the receiver nor its place on the roof is an error."""
    findings = found(with_course(scenario, delay_s=delay_s, ahead=ahead))
    heading, sideslip = findings["gps_heading"], findings["gps_sideslip"]
    assert heading.verdict is Verdict.OK
    assert abs(degrees(heading)[1]) < 0.1
    assert sideslip.verdict is Verdict.OK
    assert sideslip.value == pytest.approx(1.0, abs=0.1)
    assert "m/s on" in sideslip.evidence
    assert "correlation" in sideslip.text


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
@pytest.mark.parametrize("has_pose", [True, False])
@pytest.mark.parametrize("offset_deg", [3.0, -3.0])
def test_an_offset_of_the_heading_is_found_with_its_size(
    rate_hz: float, has_pose: bool, offset_deg: float
) -> None:
    turned = added("odometry", heading=np.radians(offset_deg))(with_course(rate_hz=rate_hz))
    heading = found(turned if has_pose else without_pose(turned))["gps_heading"]
    assert heading.verdict is Verdict.FINDING
    low, value, high = degrees(heading)
    assert low - 0.05 < offset_deg < high + 0.05
    assert value == pytest.approx(offset_deg, abs=0.1)
    assert heading.remedy
    assert not heading.parameters


def test_the_frame_of_a_pose_may_be_turned() -> None:
    streams = with_course(turned=np.radians(137.0))
    heading = found(streams)["gps_heading"]
    assert heading.verdict is Verdict.OK
    assert "turned by -137.0°" in heading.text
    off = found(added("odometry", heading=np.radians(3.0))(streams))["gps_heading"]
    assert off.verdict is Verdict.FINDING
    assert degrees(off)[1] == pytest.approx(3.0, abs=0.2)
    # Without a position, the frame and the heading cannot be distinguished.
    alone = found(without_pose(streams))["gps_heading"]
    assert alone.verdict is Verdict.NOT_DECIDABLE
    assert "-137.0°" in alone.text


def test_a_heading_from_north_is_another_convention() -> None:
    """Counted to the left from north: 90° less than from east."""
    turned = added("odometry", heading=np.radians(-90.0))(with_course())
    heading = found(turned)["gps_heading"]
    assert heading.verdict is Verdict.FINDING
    assert "whose zero is 90° from east" in heading.text


def test_a_course_of_the_other_direction_is_found() -> None:
    streams = with_course()
    gps = streams.gps_speed
    assert gps is not None
    wrong = gps.having(gps_course=-gps["gps_course"])
    heading = found(replace(streams, gps_speed=wrong))["gps_heading"]
    assert heading.verdict is Verdict.FINDING
    assert "opposite" in heading.text


def test_a_v_y_that_is_too_large_is_found() -> None:
    findings = found(scaled("odometry", 1.5, "v_y")(with_course("handling")))
    sideslip = findings["gps_sideslip"]
    assert sideslip.verdict is Verdict.FINDING
    assert sideslip.value == pytest.approx(1.0 / 1.5, abs=0.05)
    assert findings["gps_heading"].verdict is Verdict.OK


@pytest.mark.parametrize("scenario", ["town", "handling"])
def test_without_v_y_the_course_shows_the_slip(scenario: str) -> None:
    """0.0062 rad s²/m by a regression of the true v_y on r and r v_x²."""
    streams = without_v_y(with_course(scenario))
    slip = found(streams)["gps_sideslip"]
    assert slip.verdict is Verdict.OK
    assert slip.low is not None
    assert slip.high is not None
    assert slip.low < 0.0062 < slip.high
    assert "`sideslip`" in slip.text
    off = found(added("odometry", heading=np.radians(3.0))(streams))["gps_heading"]
    assert off.verdict is Verdict.FINDING
    assert degrees(off)[1] == pytest.approx(3.0, abs=0.1)


def test_a_sideslip_in_use_is_corrected() -> None:
    streams = without_v_y(with_course("handling", noise=0.01))
    sideslip = found(streams, SensorConfig(sideslip=(1.35, 0.02)))["gps_sideslip"]
    assert sideslip.verdict is Verdict.FINDING
    length, kappa = sideslip.parameters["sideslip"]
    assert length == 1.35
    assert 0.003 < kappa < 0.009


def test_slow_driving_is_not_compared_with_a_noisy_receiver() -> None:
    heading = found(with_course(noise=1.0))["gps_heading"]
    assert heading.verdict is Verdict.NOT_DECIDABLE
    assert "the car is slower" in heading.text
    part = found(with_course("handling", noise=0.3))["gps_heading"]
    speed = float(part.evidence.split(" m/s on")[0].split()[-1])
    assert 15.0 < speed < 20.0


def test_a_heading_that_follows_the_course_has_no_sideslip() -> None:
    streams = with_course()
    o = existing(streams, "odometry")
    assert streams.gps_speed is not None
    columns = {"gps_speed": o["v_x"], "gps_course": 0.5 * np.pi - o["heading"]}
    copy = replace(streams, gps_speed=replace(streams.gps_speed, at_s=o.at_s, columns=columns))
    assert found(copy)["gps_sideslip"].verdict is Verdict.NOT_DECIDABLE
    assert "follows the course" in found(copy)["gps_sideslip"].text


def test_a_gap_of_the_receiver_is_left_out() -> None:
    streams = with_course()
    gps = streams.gps_speed
    assert gps is not None
    inside = (gps.at_s > 50.0) & (gps.at_s < 80.0)
    wrong = np.where(inside, gps["gps_course"][0], gps["gps_course"])
    held = np.where(inside, gps["gps_speed"][0], gps["gps_speed"])
    stuck = gps.having(gps_course=wrong, gps_speed=held)
    heading = found(replace(streams, gps_speed=stuck))["gps_heading"]
    assert heading.verdict is Verdict.OK


def test_nothing_is_said_without_a_course_or_a_heading() -> None:
    streams = with_course()
    gps = streams.gps_speed
    assert gps is not None
    speed = replace(gps, columns={"gps_speed": gps["gps_speed"]})
    constant = gps.having(gps_course=np.full(gps.at_s.size, 0.6) + 1e-12 * gps["gps_speed"])
    unknown = gps.having(gps_course=np.full(gps.at_s.size, np.nan))
    for each in (None, speed, constant, unknown):
        assert not found(replace(streams, gps_speed=each))
    assert not found(scaled("odometry", 0.0, "heading")(streams))
    late = replace(gps, at_s=gps.at_s + 1e4)
    assert not found(replace(streams, gps_speed=late))


def test_a_short_overlap_is_too_few() -> None:
    streams = with_course()
    s = on_grid(streams, [])
    gps = streams.gps_speed
    assert s is not None
    assert gps is not None
    kept = gps.at_s < 12.0
    columns = {name: values[kept] for name, values in gps.columns.items()}
    short = replace(gps, at_s=gps.at_s[kept], columns=columns)
    (heading, *_) = check_course(s, short, SensorConfig())
    assert heading.verdict is Verdict.NOT_DECIDABLE


def test_a_bag_is_checked_for_its_course(tmp_path: Path) -> None:
    streams = added("odometry", heading=np.radians(3.0))(with_course(seconds=60.0))
    path = write_with_receiver(streams, tmp_path / "bag")
    findings = {x.name: x for x in check_recording(path).result.findings}
    heading = findings["gps_heading"]
    assert heading.verdict is Verdict.FINDING
    assert degrees(heading)[1] == pytest.approx(3.0, abs=0.1)
    assert "odometry_height" not in findings
