# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Serialise a horizon of poses; as in `ros.messages`, numbers are written into a copy."""

from __future__ import annotations

import struct

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.ros.messages import split_stamp
from adk_ros.signals.channels import TICK_NS

_SECOND_NS = 1_000_000_000
_HEADER_STAMP_AT = 4
_MARKER = struct.Struct("<iI")
_MARKER_STAMP = (0x5A5A5A5A, 0x3A5A5A5A)
"""Marker: a stamp that no field holds while the message is built, longer than any padding.

CDR pads with up to 7 bytes of whatever the memory held, such as half a marker of an earlier
message."""


class PathBytes:
    """
    CDR of a nav_msgs/Path of `steps` poses in `frame_id`, 25 ms apart, stamped with its origin.

    Each pose has the stamp of the time that it is predicted for. Roll and pitch are zero.
    """

    def __init__(self, frame_id: str, steps: int) -> None:
        self.frame_id = frame_id
        message = Path()
        message.header.frame_id = frame_id
        for _ in range(steps):
            pose = PoseStamped()
            pose.header.frame_id = frame_id
            pose.header.stamp.sec, pose.header.stamp.nanosec = _MARKER_STAMP
            message.poses.append(pose)
        self._buffer = bytearray(serialize_message(message))
        marker = _MARKER.pack(*_MARKER_STAMP)
        self._first_at = first = self._buffer.find(marker)
        second = self._buffer.find(marker, first + 8) if steps > 1 else len(self._buffer)
        # Seven numbers end a pose, the next one's stamp follows. Only before the first pose may
        # be another number of padding bytes.
        stride = (len(self._buffer) - second) // max(steps - 1, 1)
        self._stamps: IntArray = np.ndarray(
            (steps - 1, 2), "<i4", self._buffer, second if steps > 1 else 0, (stride, 4)
        )
        self._poses: FloatArray = np.ndarray(
            (steps, 7), "<f8", self._buffer, second - 56, (max(stride, 56), 8)
        )
        self._after_ns = TICK_NS * np.arange(1, steps + 1, dtype=np.int64)

    def fill(self, origin_ns: int, poses: FloatArray, z: float) -> bytes:
        """Return the message for poses (steps, 3): x, y in m, heading in rad; at height `z`."""
        struct.pack_into("<iI", self._buffer, _HEADER_STAMP_AT, *split_stamp(origin_ns))
        stamps = origin_ns + self._after_ns
        struct.pack_into("<iI", self._buffer, self._first_at, *split_stamp(int(stamps[0])))
        self._stamps[:, 0], self._stamps[:, 1] = np.divmod(stamps[1:], _SECOND_NS)
        numbers = self._poses
        numbers[:, :2], numbers[:, 2], numbers[:, 3:5] = poses[:, :2], z, 0.0
        numbers[:, 5], numbers[:, 6] = np.sin(0.5 * poses[:, 2]), np.cos(0.5 * poses[:, 2])
        return bytes(self._buffer)
