# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Serialise predictions: a twist, a trajectory and the covariances along the horizon.

rclpy takes half a millisecond to serialise a horizon of 80 points, although from one sample to
the next only numbers change. So each message is serialised once, by rclpy, with marker values in
place of its first numbers. The positions of the markers in the bytes show where the numbers
belong, and each sample then writes its numbers into a copy.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Twist, TwistWithCovarianceStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from adk_ros.model.prediction import Prediction
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS

NOT_ESTIMATED = 1e6
"""Variance of the axes that are not estimated (v_z, roll rate, pitch rate), SI units squared.

Large enough for a filter to ignore them, as in robot_localization."""
AXES = (0, 1, 5)
"""Rows and columns of v_x, v_y and yaw rate in the 6 x 6 covariance of a twist."""
JOINT_NAME = "vehicle"
DIAGNOSTIC_NAME = ": prediction"
"""End of the DiagnosticStatus name, after the name of the node."""

_STAMP_AT = 4
"""Byte offset of the stamp: messages begin with a header, after the 4-byte CDR header."""
_STAMP = struct.Struct("<iI")
_ZEROS = (0.0, 0.0, 0.0)
_UNKNOWN_ROWS = tuple((NOT_ESTIMATED * np.eye(6))[2:5].ravel().tolist())
"""Rows of v_z, roll rate and pitch rate in the covariance of a twist."""
_TWIST_NUMBERS = struct.Struct("<42d")
"""A twist and its covariance."""
_MARKER = 1.25e300
"""Marker: a value that no other field of the messages holds."""
_SECOND_MARKER = 2.5e300
_EFFORT_MARKER = 3.75e300


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """Return nanoseconds as (sec, nanosec), exactly."""
    return divmod(stamp_ns, 1_000_000_000)


def join_stamp(stamp: Any) -> int:
    """Return a builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


class TwistBytes:
    """CDR of a TwistWithCovarianceStamped, stamped with the predicted time, axes of `frame_id`."""

    def __init__(self, frame_id: str) -> None:
        message = TwistWithCovarianceStamped()
        message.header.frame_id = frame_id
        message.twist.twist.linear.x = _MARKER
        message.twist.covariance[0] = _SECOND_MARKER
        self._buffer = bytearray(serialize_message(message))
        twist_at = _find(self._buffer, _MARKER)
        covariance_at = _find(self._buffer, _SECOND_MARKER)
        assert covariance_at == twist_at + 48
        self._at = twist_at

    def fill(self, prediction: Prediction) -> bytes:
        """Return the message for `prediction`."""
        buffer = self._buffer
        _STAMP.pack_into(buffer, _STAMP_AT, *split_stamp(prediction.stamp_ns))
        x, y, z = prediction.x.tolist()
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = prediction.covariance.tolist()
        # All numbers in one call: after a pause, a call for each takes twice as long.
        _TWIST_NUMBERS.pack_into(
            buffer, self._at,
            x, y, *_ZEROS, z,
            xx, xy, *_ZEROS, xz,
            yx, yy, *_ZEROS, yz,
            *_UNKNOWN_ROWS,
            zx, zy, *_ZEROS, zz,
        )  # fmt: skip
        return bytes(buffer)


class HorizonBytes:
    """
    CDR of a MultiDOFJointTrajectory of `steps` points, 25 ms apart, stamped with its origin.

    Each point has one Twist in `velocities`; `transforms` is empty, since no pose is predicted.
    """

    def __init__(self, frame_id: str, steps: int) -> None:
        message = MultiDOFJointTrajectory()
        message.header.frame_id = frame_id
        message.joint_names = [JOINT_NAME]
        for step in range(1, steps + 1):
            sec, nanosec = split_stamp(step * TICK_NS)
            message.points.append(
                MultiDOFJointTrajectoryPoint(
                    velocities=[Twist()], time_from_start=Duration(sec=sec, nanosec=nanosec)
                )
            )
        first, last = message.points[0], message.points[-1]
        first.velocities[0].linear.x = _MARKER
        last.velocities[0].linear.x = _SECOND_MARKER if steps > 1 else _MARKER
        self._buffer = bytearray(serialize_message(message))
        start = _find(self._buffer, _MARKER)
        end = _find(self._buffer, _SECOND_MARKER) if steps > 1 else start
        stride = (end - start) // max(steps - 1, 1)
        twists = _doubles(self._buffer, start, (steps, 6), (max(stride, 48), 8))
        twists[:] = 0.0
        self._linear = twists[:, :2]
        self._yaw_rate = twists[:, 5]

    def fill(self, origin_ns: int, horizon: FloatArray) -> bytes:
        """Return the message for `horizon` (steps, 3) from the sample at `origin_ns`."""
        _STAMP.pack_into(self._buffer, _STAMP_AT, *split_stamp(origin_ns))
        self._linear[:] = horizon[:, :2]
        self._yaw_rate[:] = horizon[:, 2]
        return bytes(self._buffer)


class CovarianceBytes:
    """
    CDR of a Float64MultiArray (steps, 3, 3): error covariance of the horizon by step, SI units.

    Row-major; rows and columns are v_x, v_y, yaw rate. The type has no stamp: it is published
    right after each horizon, and with a stamp as `StampedCovarianceBytes`.
    """

    def __init__(self, steps: int) -> None:
        message = Float64MultiArray()
        sizes = {"step": steps, "row": 3, "column": 3}
        strides = (9 * steps, 9, 3)
        message.layout = MultiArrayLayout(
            dim=[
                MultiArrayDimension(label=label, size=size, stride=stride)
                for (label, size), stride in zip(sizes.items(), strides, strict=True)
            ]
        )
        message.data = [_MARKER, *[0.0] * (9 * steps - 1)]
        self._buffer = bytearray(serialize_message(message))
        self._data = _doubles(self._buffer, _find(self._buffer, _MARKER), (steps, 3, 3))

    def fill(self, covariance: FloatArray) -> bytes:
        """Return the message for `covariance` (steps, 3, 3)."""
        self._data[:] = covariance
        return bytes(self._buffer)


class StampedCovarianceBytes:
    """
    CDR of a JointTrajectory of `steps` points: the content of `CovarianceBytes`, stamped.

    Stamp, frame and points are those of `HorizonBytes`. The `positions` of each point are the nine
    elements of its covariance, row-major, SI units; `joint_names` names them, such as "v_x v_y".
    With `marked`, the single element of `effort` tells how far the point is outside the training
    range, see `TrainingRange.distance`.

    :param names: of the rows and columns.
    """

    def __init__(
        self,
        frame_id: str,
        steps: int,
        names: tuple[str, ...] = STATE_NAMES,
        marked: bool = False,
    ) -> None:
        message = JointTrajectory()
        message.header.frame_id = frame_id
        message.joint_names = [f"{row} {column}" for row in names for column in names]
        for step in range(1, steps + 1):
            sec, nanosec = split_stamp(step * TICK_NS)
            message.points.append(
                JointTrajectoryPoint(
                    positions=[0.0] * 9,
                    effort=[_EFFORT_MARKER] * marked,
                    time_from_start=Duration(sec=sec, nanosec=nanosec),
                )
            )
        message.points[-1].positions[0] = _SECOND_MARKER
        message.points[0].positions[0] = _MARKER
        self._buffer = bytearray(serialize_message(message))
        start = _find(self._buffer, _MARKER)
        end = _find(self._buffer, _SECOND_MARKER) if steps > 1 else start
        stride = (end - start) // max(steps - 1, 1)
        shape, strides = (steps, 3, 3), (max(stride, 72), 24, 8)
        self._data = _doubles(self._buffer, start, shape, strides)
        self._distance: FloatArray | None = None
        if marked:
            offset = _find(self._buffer, _EFFORT_MARKER)
            self._distance = _doubles(self._buffer, offset, (steps,), (max(stride, 8),))

    def fill(
        self, origin_ns: int, covariance: FloatArray, distance: FloatArray | None = None
    ) -> bytes:
        """
        Return the message for `covariance` (steps, 3, 3) from the sample at `origin_ns`.

        `distance` (steps,) outside the training range, for `marked` messages; None: unknown, NaN.
        """
        _STAMP.pack_into(self._buffer, _STAMP_AT, *split_stamp(origin_ns))
        self._data[:] = covariance
        if self._distance is not None:
            self._distance[:] = math.nan if distance is None else distance
        return bytes(self._buffer)


def _find(buffer: bytearray, marker: float) -> int:
    position = buffer.find(struct.pack("<d", marker))
    assert position > 0, "rclpy serialises little-endian CDR on all supported platforms"
    return position


def _doubles(
    buffer: bytearray,
    offset: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...] | None = None,
) -> FloatArray:
    view: FloatArray = np.ndarray(shape, "<f8", buffer, offset, strides)
    return view
