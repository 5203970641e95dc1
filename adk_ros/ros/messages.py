# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction -> the bytes that go out: a twist, a trajectory and the covariances along it.

A horizon of 80 points costs rclpy half a millisecond to serialise, though from one tick to the
next only numbers change. So each message is serialised once, by rclpy, with marks in place of its
first numbers; where the marks come to lie tells where the numbers go, and a tick then writes
numbers into a copy. Nothing is assumed of the layout but what the marks show.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Twist, TwistWithCovarianceStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from adk_ros.model.prediction import Prediction
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS

NOT_ESTIMATED = 1e6
"""Variance on the axes that are not estimated (v_z, roll and pitch rate)."""
AXES = (0, 1, 5)
"""Rows and columns of the 6 x 6 covariance that v_x, v_y and yaw rate have."""
JOINT_NAME = "vehicle"
DIAGNOSTIC_NAME = ": prediction"
"""What the name of the DiagnosticStatus ends with, behind the node's."""

_STAMP_AT = 4
"""Both messages begin with a header, and that with its stamp, behind four bytes of CDR."""
_STAMP = struct.Struct("<iI")
_MARK = 1.25e300
_SECOND_MARK = 2.5e300


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """Nanoseconds as (sec, nanosec), exactly: floats nowhere."""
    return divmod(stamp_ns, 1_000_000_000)


def join_stamp(stamp: Any) -> int:
    """A builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


class TwistBytes:
    """CDR of a TwistWithCovarianceStamped at the time predicted for, in axes of `frame_id`."""

    def __init__(self, frame_id: str) -> None:
        message = TwistWithCovarianceStamped()
        message.header.frame_id = frame_id
        message.twist.twist.linear.x = _MARK
        message.twist.covariance[0] = _SECOND_MARK
        self._buffer = bytearray(serialize_message(message))
        self._twist = _doubles(self._buffer, _find(self._buffer, _MARK), (6,))
        covariance = _doubles(self._buffer, _find(self._buffer, _SECOND_MARK), (6, 6))
        covariance[:] = np.diag([NOT_ESTIMATED] * 6)
        self._twist[:] = 0.0
        self._estimated = np.ix_(AXES, AXES)
        self._covariance = covariance

    def fill(self, prediction: Prediction) -> bytes:
        """Return the message for `prediction`."""
        _STAMP.pack_into(self._buffer, _STAMP_AT, *split_stamp(prediction.stamp_ns))
        self._twist[0], self._twist[1], self._twist[5] = prediction.x
        self._covariance[self._estimated] = prediction.covariance
        return bytes(self._buffer)


class HorizonBytes:
    """
    CDR of a MultiDOFJointTrajectory of `steps` points, 25 ms apart, from the time of the origin.

    Each point holds one Twist in `velocities`; `transforms` stay empty, for no pose is predicted.
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
        first.velocities[0].linear.x = _MARK
        last.velocities[0].linear.x = _SECOND_MARK if steps > 1 else _MARK
        self._buffer = bytearray(serialize_message(message))
        start = _find(self._buffer, _MARK)
        end = _find(self._buffer, _SECOND_MARK) if steps > 1 else start
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
    CDR of a Float64MultiArray (steps, 3, 3): covariance of the horizon's errors by step, SI.

    Row-major; rows and columns are v_x, v_y, yaw rate. It has no stamp: it goes out with each
    horizon, right behind it.
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
        message.data = [_MARK, *[0.0] * (9 * steps - 1)]
        self._buffer = bytearray(serialize_message(message))
        self._data = _doubles(self._buffer, _find(self._buffer, _MARK), (steps, 3, 3))

    def fill(self, covariance: FloatArray) -> bytes:
        """Return the message for `covariance` (steps, 3, 3)."""
        self._data[:] = covariance
        return bytes(self._buffer)


def _find(buffer: bytearray, mark: float) -> int:
    position = buffer.find(struct.pack("<d", mark))
    assert position > 0, "rclpy serialises little-endian CDR on every platform that it runs on"
    return position


def _doubles(
    buffer: bytearray,
    offset: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...] | None = None,
) -> FloatArray:
    view: FloatArray = np.ndarray(shape, "<f8", buffer, offset, strides)
    return view
