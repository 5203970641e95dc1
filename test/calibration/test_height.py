# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Heights of odometry and of a receiver against the grade of the road."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.road import Hilly, as_streams, circle, flat, hilly, with_height
from helpers.satellite import write_with_receiver

from adk_ros.api.road import road_frame, road_summary, write_road
from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.from_bag import read_streams
from adk_ros.calibration.height import check_heights
from adk_ros.calibration.height_slope import HeightSlope
from adk_ros.calibration.road import check_road
from adk_ros.calibration.streams import Streams
from adk_ros.road.profile import RoadProfile

DRIVE = hilly()


@lru_cache
def profile_of(drive: Hilly) -> RoadProfile:
    profile = check_road(as_streams(drive), [])[1]
    assert profile is not None
    return profile


def compared(streams: Streams, drive: Hilly = DRIVE) -> tuple[Finding, HeightSlope]:
    (finding,), slopes = check_heights(profile_of(drive), streams)
    (slope,) = slopes.values()
    return finding, slope


@pytest.mark.parametrize("seed", [7, 8, 9])
@pytest.mark.parametrize(
    ("source", "rate_hz", "noise"),
    [("odometry", 50.0, 0.01), ("gps", 10.0, 0.5), ("gps", 1.0, 0.2)],
)
def test_a_height_that_agrees_is_ok(source: str, rate_hz: float, noise: float, seed: int) -> None:
    finding, slope = compared(with_height(DRIVE, source, rate_hz=rate_hz, noise=noise, seed=seed))
    assert finding.name == f"{source}_height"
    assert finding.verdict is Verdict.OK
    assert slope.scale.low < 1.0 < slope.scale.high
    assert slope.correlation > 0.98
    assert slope.rms < 0.01
    assert slope.level.low - 0.002 < 0.0 < slope.level.high + 0.002
    known = np.isfinite(slope.grade)
    assert known.mean() > 0.8
    true = np.interp(profile_of(DRIVE).at_s, DRIVE.at_s, DRIVE.grade)
    assert np.corrcoef(true[known], slope.grade[known])[0, 1] > 0.95


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_a_scaled_height_is_found_with_its_size(factor: float) -> None:
    finding, _ = compared(with_height(DRIVE, factor=factor))
    assert finding.verdict is Verdict.FINDING
    assert finding.low is not None
    assert finding.high is not None
    assert finding.low < factor < finding.high
    assert finding.high - finding.low < 0.2
    assert finding.value == pytest.approx(factor, abs=0.03)


def test_feet_are_named() -> None:
    finding, _ = compared(with_height(DRIVE, factor=1.0 / 0.3048))
    assert finding.verdict is Verdict.FINDING
    assert "looks like ft" in finding.text


def test_a_depth_is_a_flipped_sign() -> None:
    finding, _ = compared(with_height(DRIVE, factor=-1.0))
    assert finding.verdict is Verdict.FINDING
    assert "sign flipped" in finding.text


def test_noise_and_drift_widen_the_interval() -> None:
    widths = []
    for noise, drift in ((0.1, 0.0), (2.0, 0.0), (0.1, 0.3)):
        finding, slope = compared(with_height(DRIVE, noise=noise, drift=drift))
        assert slope.scale.low < 1.0 < slope.scale.high
        assert finding.verdict is not Verdict.FINDING
        widths.append(slope.scale.high - slope.scale.low)
    assert min(widths[1:]) > 1.5 * widths[0]


def test_a_delay_of_the_height_is_no_scale() -> None:
    finding, slope = compared(with_height(DRIVE, delay_s=1.0))
    assert finding.verdict is Verdict.OK
    assert slope.scale.low < 1.0 < slope.scale.high


def test_the_height_shows_the_level_that_an_offset_of_the_imu_hides() -> None:
    """The pitch of the body takes 4 % of the offset."""
    drive = hilly(offset=0.3)
    finding, slope = compared(with_height(drive), drive)
    assert finding.verdict is Verdict.OK
    assert slope.level.value == pytest.approx(-0.3 / 9.81, abs=0.002)
    assert "an offset of a_x by 0.29 m/s²" in finding.text


def test_a_closed_path_makes_the_scale_exact() -> None:
    drive = hilly(path=circle)
    _, slope = compared(with_height(drive), drive)
    assert slope.scale.low < 1.0 < slope.scale.high
    assert slope.scale.high - slope.scale.low < 0.05


def test_a_flat_road_does_not_decide() -> None:
    drive = hilly(flat, seconds=60.0)
    finding, _ = compared(with_height(drive), drive)
    assert finding.verdict is Verdict.NOT_DECIDABLE


def test_gaps_and_held_heights_are_not_used() -> None:
    streams = with_height(DRIVE)
    height = streams.heights["gps"]
    inside = (height.at_s > 40.0) & (height.at_s < 60.0)
    values = np.where(inside, height["height"][np.flatnonzero(inside)[0]], height["height"])
    held = height.having(height=values)
    columns = {"height": height["height"][~inside]}
    gap = replace(height, at_s=height.at_s[~inside], columns=columns)
    for each in (held, gap):
        finding, slope = compared(replace(streams, heights={"gps": each}))
        assert finding.verdict is Verdict.OK
        unknown = ~np.isfinite(slope.grade)
        at = profile_of(DRIVE).at_s
        assert unknown[(at > 41.0) & (at < 59.0)].all()


def test_too_few_data_are_said() -> None:
    drive = hilly(seconds=25.0)
    (finding,), slopes = check_heights(profile_of(drive), with_height(drive))
    assert finding.verdict is Verdict.NOT_DECIDABLE
    assert not slopes


def test_without_a_height_or_a_profile_nothing_is_said() -> None:
    assert check_heights(profile_of(DRIVE), as_streams(DRIVE)) == ([], {})
    assert check_heights(None, with_height(DRIVE)) == ([], {})


def test_table_figure_and_json_have_the_slope_of_the_height(tmp_path: Path) -> None:
    profile = profile_of(DRIVE)
    _, slopes = check_heights(profile, with_height(DRIVE))
    frame = road_frame(profile, None, slopes)
    assert "gps_height_grade" in frame
    write_road(profile, tmp_path / "road.png", None, slopes)
    write_road(profile, tmp_path / "road.csv", None, slopes)
    heights = json.loads(json.dumps(road_summary(profile, None, slopes)))["heights"]
    assert heights["gps"]["scale"] == pytest.approx(1.0, abs=0.03)
    assert heights["gps"]["correlation"] > 0.99


@pytest.mark.parametrize("topic", ["/gps/fix", "/ublox/fix"])
def test_heights_are_read_from_a_bag(tmp_path: Path, topic: str) -> None:
    drive = hilly(seconds=30.0)
    by_gps = with_height(drive)
    z = with_height(drive, "odometry").heights["odometry"]
    streams = replace(by_gps, heights={**by_gps.heights, "odometry": z})
    path = write_with_receiver(streams, tmp_path / "bag", topic)
    read = read_streams(path, RecordingOptions()).streams
    assert set(read.heights) == {"odometry", "gps"}
    gps, true = read.heights["gps"], by_gps.heights["gps"]
    # Neither messages without a fix nor those without an altitude.
    assert gps.at_s.size == pytest.approx(0.8 * true.at_s.size, abs=2)
    assert gps["height"].min() > 300.0
    assert np.ptp(read.heights["odometry"]["height"]) > 1.0


def test_a_constant_height_is_none(tmp_path: Path) -> None:
    streams = with_height(hilly(seconds=30.0))
    height = streams.heights["gps"]
    constant = height.having(height=np.full(height.at_s.size, 350.0))
    path = write_with_receiver(replace(streams, heights={"gps": constant}), tmp_path / "bag")
    assert not read_streams(path, RecordingOptions()).streams.heights
