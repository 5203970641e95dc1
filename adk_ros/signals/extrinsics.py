# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position and rotation of the IMU from the fixed transforms of `/tf_static`.

A transform gives the pose of a child frame in its parent: p_parent = R p_child + t (REP-105). The
frames form trees; the pose of the IMU in odometry's child frame follows along the tree.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig

TOPIC, MSGTYPE = "/tf_static", "tf2_msgs/msg/TFMessage"
_MAX_DEPTH = 100
"""Frames above one another; more are a loop."""


class Pose(NamedTuple):
    """Position (3,), m, and rotation matrix (3, 3) of a frame in another one."""

    position: FloatArray
    rotation: FloatArray


class StaticTransforms:
    """The fixed transforms that were published, by child frame; a later one replaces another."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Pose]] = {}

    def add(self, message: Any) -> None:
        """Add the transforms of a tf2_msgs/TFMessage; those with unusable numbers are ignored."""
        for entry in message.transforms:
            pose = _pose(entry.transform)
            child, parent = _frame(entry.child_frame_id), _frame(entry.header.frame_id)
            if pose is not None and child and parent and child != parent:
                self._parents[child] = (parent, pose)

    def pose_of(self, frame: str, within: str) -> Pose | None:
        """Return the pose of a frame in the frame `within`; None if no transforms connect them."""
        ancestors, others = self._ancestors(_frame(frame)), self._ancestors(_frame(within))
        for common, pose in ancestors.items():
            if common in others:
                other = others[common]
                back = other.rotation.T
                return Pose(back @ (pose.position - other.position), back @ pose.rotation)
        return None

    def _ancestors(self, frame: str) -> dict[str, Pose]:
        """Return the pose of a frame in itself and in all frames above it, nearest first."""
        pose = Pose(np.zeros(3), np.eye(3))
        out = {frame: pose}
        while frame in self._parents and len(out) < _MAX_DEPTH:
            frame, step = self._parents[frame]
            if frame in out:
                break
            pose = Pose(
                step.rotation @ pose.position + step.position, step.rotation @ pose.rotation
            )
            out[frame] = pose
        return out


def frame_of(message: Any) -> str:
    """Return the frame of a message's values: odometry's twist is in its child frame."""
    name = getattr(message, "child_frame_id", None)
    return str(message.header.frame_id if name is None else name)


def wants_extrinsics(sensors: SensorConfig) -> bool:
    """Whether position and rotation of the IMU are to be taken from `/tf_static`."""
    return sensors.use_tf and not any((*sensors.imu_position, *sensors.imu_rotation))


def with_extrinsics(
    sensors: SensorConfig, transforms: StaticTransforms, vehicle: str, imu: str
) -> SensorConfig:
    """
    Return the configuration with the pose of the frame `imu` in the frame `vehicle`.

    Unchanged where it names a pose itself, where `use_tf` is off, and where no transforms connect
    the frames.
    """
    if not wants_extrinsics(sensors) or not vehicle or not imu:
        return sensors
    pose = transforms.pose_of(imu, vehicle)
    if pose is None:
        return sensors
    x, y, _ = (_rounded(v) for v in pose.position)
    return replace(sensors, imu_position=(x, y), imu_rotation=roll_pitch_yaw(pose.rotation))


def extrinsics_text(sensors: SensorConfig) -> str:
    """Return where the IMU is, for a person."""
    (x, y), angles = sensors.imu_position, sensors.imu_rotation
    turned = ", ".join(f"{math.degrees(angle):.3g}" for angle in angles)
    return f"IMU at ({x:.3g}, {y:.3g}) m, rotated by ({turned})° (roll, pitch, yaw): {TOPIC}"


def roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """Return the fixed-axis angles, rad, of a rotation matrix (3, 3); see `frames.rotation`."""
    pitch = math.asin(min(max(-float(rotation[2, 0]), -1.0), 1.0))
    if abs(rotation[2, 0]) > 1.0 - 1e-12:
        # Only the sum or difference of roll and yaw is determined: roll is zero.
        return 0.0, pitch, math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
    return (
        _rounded(math.atan2(rotation[2, 1], rotation[2, 2])),
        _rounded(pitch),
        _rounded(math.atan2(rotation[1, 0], rotation[0, 0])),
    )


def _rounded(value: float) -> float:
    # A quaternion is rarely exact: 1e-9 m or rad must not turn an unrotated IMU into a rotated.
    return round(float(value), 9) + 0.0


def _frame(name: Any) -> str:
    # tf of ROS 1 has names such as /base_link.
    return str(name).removeprefix("/")


def _pose(transform: Any) -> Pose | None:
    t, q = transform.translation, transform.rotation
    x, y, z, w = (float(v) for v in (q.x, q.y, q.z, q.w))
    position = np.array([float(t.x), float(t.y), float(t.z)])
    size = math.sqrt(x * x + y * y + z * z + w * w)
    if not (np.isfinite(position).all() and math.isfinite(size) and size > 1e-6):
        return None
    x, y, z, w = x / size, y / size, z / size, w / size
    return Pose(
        position,
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        ),
    )
