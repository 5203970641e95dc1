# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check what a message says about itself: its frames and its covariances.

Conventions: REP-105 for frames, nav_msgs/Odometry (the twist is in child_frame_id), and
sensor_msgs/Imu for covariances (all zero: unknown; first element -1: not available). Duck-typed as
the decoder: for messages of rclpy and of rosbags.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from adk_ros.signals.channels import Source
from adk_ros.signals.decode import MAX_VARIANCE

_FIXED_FRAMES = ("odom", "map", "earth", "world")
"""Frames fixed to the ground: those of REP-105, and a usual name besides."""
_ODOMETRY_VARIANCES = (("v_x", 0), ("v_y", 7), ("yaw rate", 35))
_FORCE_VARIANCES = (("a_x", 0), ("a_y", 4))
_RATE_VARIANCES = (("yaw rate", 8),)


def message_warnings(
    source: Source, msg: Any, frame_id: str = "", *, is_shifted: bool = False
) -> list[str]:
    """
    Return one line per fault of an IMU or odometry message; none for other sources.

    :param frame_id: frame of the predictions; empty: not compared.
    :param is_shifted: predictions are of another point than odometry's (`reference_point`).
    """
    if source is Source.ODOMETRY and not hasattr(msg, "child_frame_id"):
        # Wheel speeds or a velocity over ground (`velocity_messages`).
        return []
    if source is Source.ODOMETRY:
        return _odometry_frames(msg, frame_id, is_shifted) + _variances(
            "odometry", "twist", msg.twist.covariance, _ODOMETRY_VARIANCES
        )
    if source is Source.IMU:
        force, rate = msg.linear_acceleration_covariance, msg.angular_velocity_covariance
        return (
            _imu_frame(msg)
            + _variances("the IMU", "acceleration", force, _FORCE_VARIANCES)
            + _variances("the IMU", "angular velocity", rate, _RATE_VARIANCES)
        )
    return []


def _odometry_frames(msg: Any, frame_id: str, is_shifted: bool) -> list[str]:
    child, parent = str(msg.child_frame_id), str(msg.header.frame_id)
    if _is_fixed(child) or (child and child == parent):
        return [
            f"odometry's child_frame_id is '{child}': the twist must be in the axes of the "
            "vehicle, such as base_link"
        ]
    if is_shifted and frame_id and frame_id in (child, "base_link"):
        return [
            f"predictions are of the reference point, but labelled '{frame_id}' as odometry is: "
            "leave frame_id empty, or name a frame at that point"
        ]
    if child and frame_id and frame_id != child and not is_shifted:
        return [
            f"odometry's child_frame_id is '{child}', but predictions are published in "
            f"'{frame_id}': set frame_id"
        ]
    return []


def _imu_frame(msg: Any) -> list[str]:
    frame = str(msg.header.frame_id)
    if not _is_fixed(frame):
        return []
    return [f"the IMU's frame_id is '{frame}': its values must be in the axes of the sensor"]


def _is_fixed(frame: str) -> bool:
    # Several vehicles: car1/odom.
    return frame.rsplit("/", 1)[-1] in _FIXED_FRAMES


def _variances(
    sender: str, field: str, covariance: Sequence[float], elements: Sequence[tuple[str, int]]
) -> list[str]:
    if covariance[0] == -1.0:
        return [f"{sender} marks its {field} as not available (covariance -1)"]
    warnings = []
    for name, index in elements:
        variance = float(covariance[index])
        if not math.isfinite(variance) or variance < 0.0:
            warnings.append(f"{sender}'s variance of {name} is negative or not finite: ignored")
        elif variance >= MAX_VARIANCE:
            warnings.append(
                f"{sender}'s variance of {name} is above {MAX_VARIANCE:g}, which marks it as not "
                "measured"
            )
    return warnings
