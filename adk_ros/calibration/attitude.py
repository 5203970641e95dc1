# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Roll and pitch of an inertial navigation system, for comparison with the slopes of the road.

They come from the orientation of the IMU or, if that has none, of odometry. A planar odometry has
a heading alone: then there is no attitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from adk_ros.calibration.messages import stamp_s
from adk_ros.calibration.stream_table import MIN_MESSAGES, usable_rows
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.frames import rotation

ATTITUDE_COLUMNS = ("roll", "pitch")
"""rad, REP-103: right side down and nose down are positive."""
_MAX_NORM_ERROR = 0.1
"""A quaternion of another length is none: drivers that measure no orientation leave zeros."""


def attitude_row(msg: Any) -> list[float]:
    """Return stamp and orientation x, y, z, w (5,) of an Imu or Odometry; NaN if it has none."""
    q = msg.orientation if hasattr(msg, "orientation") else msg.pose.pose.orientation
    values = [float(q.x), float(q.y), float(q.z), float(q.w)]
    unreported = hasattr(msg, "orientation") and msg.orientation_covariance[0] == -1.0
    if unreported or abs(math.hypot(*values) - 1.0) > _MAX_NORM_ERROR:
        values = [math.nan] * 4
    return [stamp_s(msg), *values]


def attitude_of(at_s: FloatArray, quaternions: FloatArray, mounting: FloatArray) -> Stream | None:
    """
    Return roll and pitch of the vehicle; None if they are not reported or never change.

    :param at_s: stamps (n,), s. :param quaternions: x, y, z, w (n, 4) from sensor to world.
    :param mounting: matrix (3, 3) from the axes of the sensor to those of the vehicle.
    """
    known = np.isfinite(quaternions).all(axis=1)
    if known.mean() < 0.5:
        return None
    x, y, z, w = (quaternions[known] / np.linalg.norm(quaternions[known], axis=1)[:, None]).T
    # The world's vertical in the axes of the sensor, then of the vehicle.
    up = mounting @ np.vstack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    pitch, roll = -np.arcsin(np.clip(up[0], -1.0, 1.0)), np.arctan2(up[1], up[2])
    stream = Stream("the attitude", at_s[known], {"roll": roll, "pitch": pitch})
    return stream if stream.has("roll") and stream.has("pitch") else None


def recorded_attitude(
    rows: Mapping[str, list[list[float]]], seconds: float, sensors: SensorConfig, first_s: float
) -> Stream | None:
    """
    Return roll and pitch of the IMU, else of odometry; None if neither reports them.

    :param rows: those of `attitude_row`, by "imu" and "odometry". :param seconds: duration of the
        log. :param first_s: stamp from which times count.
    """
    for role, mounting in (("imu", rotation(*sensors.imu_rotation)), ("odometry", np.eye(3))):
        table, _ = usable_rows(rows[role], seconds)
        if table.shape[0] < MIN_MESSAGES:
            continue
        attitude = attitude_of(table[:, 0] - first_s, table[:, 1:], mounting)
        if attitude is not None:
            return attitude
    return None
