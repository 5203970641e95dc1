# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry's speed against that of a satellite receiver."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.auxiliary_bags import drive_with_wheels, with_auxiliary_topics
from helpers.calibration import checked, driven, existing, scaled

from adk_ros.api.check import check_recording
from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.check import CheckResult
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.signals.decode import SensorConfig


@lru_cache
def received(
    scenario: str = "town", delay_s: float = 0.0, rate_hz: float = 10.0, noise: float = 0.05
) -> Streams:
    """Return a drive with a receiver of the speed over ground."""
    streams = driven(scenario, 2, 200.0)
    odometry = existing(streams, "odometry")
    at = np.arange(1.0, odometry.at_s[-1] - 1.0, 1.0 / rate_hz)
    speed = np.hypot(odometry["v_x"], odometry["v_y"])
    values = np.interp(at - delay_s, odometry.at_s, speed)
    values = values + noise * np.random.default_rng(4).standard_normal(at.size)
    return replace(streams, gps_speed=Stream("the GPS receiver", at, {"gps_speed": values}))


def by_name(result: CheckResult) -> dict[str, Finding]:
    return {x.name: x for x in result.findings}


@pytest.mark.parametrize(
    ("scenario", "rate_hz"), [("town", 10.0), ("handling", 10.0), ("town", 1.0)]
)
def test_a_receiver_that_agrees_is_no_finding(scenario: str, rate_hz: float) -> None:
    result = checked(received(scenario, rate_hz=rate_hz))
    assert [x.text for x in result.of(Verdict.FINDING)] == []
    scale = by_name(result)["gps_scale"]
    assert scale.verdict is Verdict.OK
    assert scale.value == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize("delay_s", [0.0, 0.3])
def test_a_scale_of_odometry_is_found_whatever_the_delay(delay_s: float) -> None:
    """Without a pose, the receiver is the only reference."""
    still = scaled("odometry", 0.0, "x", "y", "heading")(received(delay_s=delay_s))
    fast = scaled("odometry", 1.03, "v_x", "v_y")(still)
    found = by_name(checked(fast))
    scale, delay = found["gps_scale"], found["gps_delay"]
    assert found["odometry_scale"].verdict is Verdict.NOT_DECIDABLE
    assert scale.verdict is Verdict.FINDING
    assert scale.low is not None
    assert scale.high is not None
    assert scale.value == pytest.approx(1.03, abs=0.003)
    assert scale.low - 0.001 < 1.03 < scale.high + 0.001
    assert scale.seconds is not None
    assert scale.seconds > 60.0
    assert delay.value == pytest.approx(delay_s, abs=0.04)
    assert delay.verdict is (Verdict.FINDING if delay_s else Verdict.OK)


def test_kilometres_per_hour_are_named() -> None:
    still = scaled("odometry", 0.0, "x", "y", "heading")(received())
    fast = replace(scaled("odometry", 3.6, "v_x", "v_y")(still), imu=None)
    scale = by_name(checked(fast))["gps_scale"]
    assert scale.verdict is Verdict.FINDING
    assert "km/h" in scale.text
    assert scale.parameters == {"odometry_scale": pytest.approx(3.6, rel=0.02)}


def test_a_receiver_that_holds_its_speed_in_a_tunnel_is_not_used_there() -> None:
    streams = received()
    gps = streams.gps_speed
    assert gps is not None
    inside = (gps.at_s > 60.0) & (gps.at_s < 100.0)
    held = np.where(inside, gps["gps_speed"][np.flatnonzero(inside)[0]], gps["gps_speed"])
    result = checked(replace(streams, gps_speed=gps.having(gps_speed=held)))
    scale = by_name(result)["gps_scale"]
    assert scale.verdict is Verdict.OK
    whole = by_name(checked(streams))["gps_scale"]
    assert scale.seconds is not None
    assert whole.seconds is not None
    assert whole.seconds - scale.seconds >= 25.0


def test_a_v_x_of_the_receiver_is_not_compared_with_itself() -> None:
    streams = driven("town", 2, 200.0)
    odometry = existing(streams, "odometry").having(v_y=0.0 * existing(streams, "odometry").at_s)
    gps = Stream("the GPS receiver", odometry.at_s, {"gps_speed": odometry["v_x"]})
    scale = by_name(checked(replace(streams, odometry=odometry, gps_speed=gps)))["gps_scale"]
    assert scale.verdict is Verdict.NOT_DECIDABLE
    assert "itself" in scale.text


def test_a_wheel_radius_in_use_is_corrected_by_the_receiver(tmp_path: Path) -> None:
    """The recording is read by joints of wheels with a radius that is 5 % too small."""
    drive = drive_with_wheels()
    path = with_auxiliary_topics(drive, tmp_path / "bag", gps_factor=1.0, keeps_joints=True)
    sensors = SensorConfig(odometry_type="wheel_joints", wheel_radius=0.95 * 0.325)
    options = RecordingOptions(odometry="/vehicle/wheels", sensors=sensors)
    result = check_recording(path, options=options).result
    assert by_name(result)["gps_scale"].verdict is Verdict.FINDING
    assert result.parameters["wheel_radius"] == pytest.approx(0.325, rel=0.006)
