# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frozen readings and jumps of the pose of a 1:10 car, as of a full-size one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.calibration import driven, existing

from adk_ros.calibration.continuity import frozen, pose_jumps
from adk_ros.calibration.stream_table import stream_of, usable_rows
from adk_ros.calibration.streams import Stream

SMALL = 0.1
"""Scale of lengths; speeds and times scale with its root (dynamic similarity)."""


def odometry(scale: float) -> Stream:
    """Return the odometry of a drive of a car of this scale."""
    full = existing(driven(), "odometry")
    root = math.sqrt(scale)
    factors = {"v_x": root, "v_y": root, "yaw_rate": 1.0 / root, "x": scale, "y": scale}
    columns = {name: values * factors.get(name, 1.0) for name, values in full.columns.items()}
    return Stream(full.name, full.at_s * root, columns)


@pytest.mark.parametrize("scale", [1.0, SMALL])
def test_a_jump_is_found_at_any_size(scale: float) -> None:
    stream = odometry(scale)
    assert pose_jumps(stream, size=scale) == []
    at = stream.at_s.size // 2
    assert abs(stream["v_x"][at]) > 2.0 * math.sqrt(scale)
    moved = stream["x"] + np.where(np.arange(stream.at_s.size) >= at, 2.0 * scale, 0.0)
    ((time_s, distance, _),) = pose_jumps(stream.having(x=moved), size=scale)
    assert time_s == stream.at_s[at]
    assert distance == pytest.approx(2.0 * scale, rel=0.1)


@pytest.mark.parametrize("scale", [1.0, SMALL])
def test_a_frozen_sensor_is_found_at_any_size(scale: float) -> None:
    stream = odometry(scale)
    speed = np.abs(stream["v_x"])
    assert frozen(stream, speed) == []
    at = stream.at_s.size // 2
    held = {name: values.copy() for name, values in stream.columns.items()}
    for values in held.values():
        values[at : at + 200] = values[at]
    ((begin, end),) = frozen(stream.having(**held), speed)
    assert begin == stream.at_s[at]
    assert end == stream.at_s[at + 199]


def test_a_channel_without_values_for_long_is_not_used_there() -> None:
    """A receiver without a fix for 4 s: its speed is no straight line between both ends."""
    rows = [[0.1 * i + 1.0, 10.0 + 0.01 * i] for i in range(200)]
    for i in range(100, 140):
        rows[i][1] = np.nan
    rows[20][1] = np.nan
    stream = stream_of("odometry", usable_rows(rows, 20.0), ["v_x"], 1.0)
    assert stream is not None
    (interval,) = stream.unknown
    assert interval == pytest.approx((9.9, 14.0))
    assert stream["v_x"][20] == pytest.approx(10.2)
    assert stream.having(v_x=stream["v_x"]).unknown == stream.unknown


def test_a_pose_does_not_jump_in_a_bend_where_no_yaw_rate_is_known() -> None:
    """A heading at 10 Hz turns by 5 degrees a message; what turns the car is the gyro's to say."""
    at_s = np.linspace(0.0, 39.9, 400)
    heading = np.where((at_s > 10.0) & (at_s < 12.0), 0.8 * (at_s - 10.0), 0.0)
    heading = np.where(at_s >= 12.0, 1.6, heading)
    v = 5.0
    x, y = (np.cumsum(v * 0.1 * f(heading)) for f in (np.cos, np.sin))
    columns = {
        "v_x": np.full(400, v) + 1e-3 * np.sin(at_s), "v_y": np.zeros(400), "x": x, "y": y,
        "heading": heading, "yaw_rate": np.full(400, np.nan),
    }  # fmt: skip
    assert pose_jumps(Stream("odometry", at_s, columns), [], 1.0) == []
