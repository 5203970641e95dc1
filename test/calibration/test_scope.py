# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that lack streams or channels, stand, or are too short: less scope, no refusal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.calibration import checked, driven, existing, scaled

from adk_ros.calibration.check import CheckResult
from adk_ros.calibration.finding import Finding, Verdict
from adk_ros.calibration.streams import Stream, Streams


def by_name(result: CheckResult) -> dict[str, Finding]:
    return {x.name: x for x in result.findings}


def cut(streams: Streams, seconds: float) -> Streams:
    """Return the first seconds."""
    for name in ("imu", "odometry", "command"):
        old = existing(streams, name)
        kept = old.at_s < seconds
        columns = {key: values[kept] for key, values in old.columns.items()}
        streams = streams.with_stream(name, Stream(old.name, old.at_s[kept], columns))
    return streams


@pytest.mark.parametrize("absent", ["imu", "odometry", "command"])
def test_a_missing_stream_is_not_decidable(absent: str) -> None:
    changes: dict[str, Any] = {absent: None}
    result = checked(replace(driven(), **changes))
    assert not result.of(Verdict.FINDING)
    assert by_name(result)[f"{absent}_stream"].verdict is Verdict.NOT_DECIDABLE


def test_without_a_vehicle_the_ratio_is_not_decidable() -> None:
    result = checked(driven(), vehicle=None)
    assert not result.of(Verdict.FINDING)
    ratio = by_name(result)["steering_ratio"]
    assert ratio.verdict is Verdict.NOT_DECIDABLE
    assert "give --vehicle" in ratio.text
    assert ratio.unit == "m"


@pytest.mark.parametrize(("stream", "column"), [("odometry", "v_y"), ("command", "torque")])
def test_a_constant_channel_is_named(stream: str, column: str) -> None:
    found = by_name(checked(scaled(stream, 0.0, column)(driven())))
    assert "0 throughout" in found[f"{stream}_{column}"].text
    if column == "v_y":
        assert found["imu_position"].verdict is Verdict.NOT_DECIDABLE


def test_without_a_pose_the_scale_is_not_decidable() -> None:
    result = checked(scaled("odometry", 0.0, "x", "y", "heading")(driven()))
    assert not result.of(Verdict.FINDING)
    assert by_name(result)["odometry_scale"].verdict is Verdict.NOT_DECIDABLE


def test_a_short_recording_is_said_to_be_short() -> None:
    found = by_name(checked(cut(driven(), 15.0)))
    assert found["driving"].verdict is Verdict.FINDING
    assert "moves for 1" in found["driving"].text
    assert found["calibration"].verdict is Verdict.NOT_DECIDABLE


def test_a_parked_car_is_said_to_stand() -> None:
    streams = driven()
    odometry = existing(streams, "odometry")
    still = odometry.at_s > 100.0
    columns = {
        name: np.where(still & (name in ("v_x", "v_y", "yaw_rate")), 1e-3 * (i + 1), values)
        for i, (name, values) in enumerate(odometry.columns.items())
    }
    parked = streams.with_stream("odometry", odometry.having(**columns))
    assert "stands for 50%" in by_name(checked(parked))["driving"].text


def test_a_low_rate_is_a_finding() -> None:
    streams = driven()
    old = existing(streams, "command")
    rare = Stream(old.name, old.at_s[::4], {k: v[::4] for k, v in old.columns.items()})
    found = by_name(checked(streams.with_stream("command", rare)))
    assert "10.0 Hz" in found["command_rate"].text


def test_at_constant_speed_nothing_false_is_claimed() -> None:
    """Speed, and all that grows with it, is proportional: position and ratio are not separable."""
    streams = driven()
    odometry, imu = existing(streams, "odometry"), existing(streams, "imu")
    speed = 15.0
    r = odometry["yaw_rate"]
    rng = np.random.default_rng(0)
    heading = np.cumsum(r) * 0.02
    x, y = (np.cumsum(speed * f(heading)) * 0.02 for f in (np.cos, np.sin))
    v_x = speed + 0.02 * rng.standard_normal(r.size)
    gyro = np.interp(imu.at_s, odometry.at_s, r)
    a_y = speed * gyro + 0.05 * rng.standard_normal(gyro.size)
    a_x = 0.05 * rng.standard_normal(gyro.size)
    cruise = replace(
        streams,
        odometry=odometry.having(v_x=v_x, v_y=0.0 * r, x=x, y=y, heading=heading),
        imu=imu.having(w_z=gyro, a_x=a_x, a_y=a_y),
        command=None,
    )
    names = {finding.name for finding in checked(cruise).of(Verdict.FINDING)}
    assert names == {"odometry_v_y"}
