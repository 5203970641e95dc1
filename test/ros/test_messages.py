# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The serialised bytes equal the messages that rclpy serialises."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from adk_ros.model.prediction import Prediction, Status
from adk_ros.ros.echo import ReceivedPrediction, header, json_line, line
from adk_ros.ros.messages import (
    NOT_ESTIMATED,
    CovarianceBytes,
    HorizonBytes,
    StampedCovarianceBytes,
    TwistBytes,
    join_stamp,
    split_stamp,
)


def prediction(steps: int = 80, stamp_ns: int = 1_760_000_000_123_456_789) -> Prediction:
    rng = np.random.default_rng(steps)
    root = rng.normal(size=(3, 3))
    return Prediction(
        origin_ns=stamp_ns - 25_000_000,
        stamp_ns=stamp_ns,
        x=rng.normal(size=3),
        covariance=root @ root.T,
        horizon=rng.normal(size=(steps, 3)),
        horizon_covariance=rng.normal(size=(steps, 3, 3)),
        innovation=np.zeros(3),
        status=Status.PREDICTED,
    )


@pytest.mark.parametrize("frame_id", ["base_link", "", "a", "car/base_link", "ümläut"])
def test_twist(frame_id: str) -> None:
    buffer = TwistBytes(frame_id)
    for steps in (3, 4):
        expected = prediction(steps)
        message = deserialize_message(buffer.fill(expected), TwistWithCovarianceStamped)
        assert message.header.frame_id == frame_id
        assert join_stamp(message.header.stamp) == expected.stamp_ns
        twist = message.twist.twist
        assert (twist.linear.x, twist.linear.y, twist.angular.z) == tuple(expected.x)
        assert (twist.linear.z, twist.angular.x, twist.angular.y) == (0.0, 0.0, 0.0)
        flat = message.twist.covariance
        c = expected.covariance
        assert (flat[0], flat[7], flat[35]) == (c[0, 0], c[1, 1], c[2, 2])
        assert (flat[1], flat[6]) == (c[0, 1], c[1, 0])
        assert (flat[5], flat[30]) == (c[0, 2], c[2, 0])
        assert (flat[11], flat[31]) == (c[1, 2], c[2, 1])
        assert (flat[14], flat[21], flat[28]) == (NOT_ESTIMATED,) * 3
        others = set(range(36)) - {0, 7, 35, 1, 6, 5, 30, 11, 31, 14, 21, 28}
        assert all(flat[index] == 0.0 for index in others)


@pytest.mark.parametrize("frame_id", ["base_link", "", "abc", "abcd", "abcde"])
@pytest.mark.parametrize("steps", [1, 2, 3, 80, 400])
def test_horizon(frame_id: str, steps: int) -> None:
    buffer = HorizonBytes(frame_id, steps)
    for stamp_ns in (1_760_000_000_000_000_001, 25_000_000):
        expected = prediction(steps, stamp_ns)
        content = buffer.fill(expected.origin_ns, expected.horizon)
        message = deserialize_message(content, MultiDOFJointTrajectory)
        assert message.header.frame_id == frame_id
        assert join_stamp(message.header.stamp) == expected.origin_ns
        assert message.joint_names == ["vehicle"]
        assert len(message.points) == steps
        for number, (point, row) in enumerate(
            zip(message.points, expected.horizon, strict=True), start=1
        ):
            assert len(point.transforms) == len(point.accelerations) == 0
            assert join_stamp(point.time_from_start) == number * 25_000_000
            (twist,) = point.velocities
            assert (twist.linear.x, twist.linear.y, twist.angular.z) == tuple(row)
            assert (twist.linear.z, twist.angular.x, twist.angular.y) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("steps", [1, 2, 40, 80, 400])
def test_horizon_covariance(steps: int) -> None:
    buffer = CovarianceBytes(steps)
    for seed in (0, 1):
        expected = np.random.default_rng(seed).normal(size=(steps, 3, 3))
        content = buffer.fill(expected)
        message = Float64MultiArray()
        sizes = {"step": (steps, 9 * steps), "row": (3, 9), "column": (3, 3)}
        message.layout.dim = [
            MultiArrayDimension(label=label, size=size, stride=stride)
            for label, (size, stride) in sizes.items()
        ]
        message.data = expected.ravel().tolist()
        read = deserialize_message(content, Float64MultiArray)
        # The bytes may differ in rclpy's alignment gaps.
        assert read == message
        assert len(content) == len(serialize_message(message))
        np.testing.assert_array_equal(np.reshape(read.data, (steps, 3, 3)), expected)
        # std_msgs/MultiArrayLayout: the stride of an index is that of the following dimensions.
        flat, (_, row, column) = read.data, (dim.stride for dim in read.layout.dim)
        assert flat[row * (steps - 1) + column * 1 + 2] == expected[steps - 1, 1, 2]


@pytest.mark.parametrize("frame_id", ["base_link", "", "abc", "abcd", "abcde"])
@pytest.mark.parametrize("steps", [1, 2, 80, 400])
def test_stamped_horizon_covariance(frame_id: str, steps: int) -> None:
    buffer = StampedCovarianceBytes(frame_id, steps)
    for seed in (0, 1):
        expected = np.random.default_rng(seed).normal(size=(steps, 3, 3))
        content = buffer.fill(1_760_000_000_000_000_001 + seed, expected)
        message = deserialize_message(content, JointTrajectory)
        assert join_stamp(message.header.stamp) == 1_760_000_000_000_000_001 + seed
        assert message.header.frame_id == frame_id
        assert message.joint_names[:4] == ["v_x v_x", "v_x v_y", "v_x yaw_rate", "v_y v_x"]
        assert len(message.joint_names) == 9
        read = [point.positions for point in message.points]
        np.testing.assert_array_equal(np.reshape(read, (steps, 3, 3)), expected)
        assert {
            len(p.velocities) + len(p.accelerations) + len(p.effort) for p in message.points
        } == {0}
        times = [join_stamp(point.time_from_start) for point in message.points]
        assert times == [step * 25_000_000 for step in range(1, steps + 1)]
        assert deserialize_message(serialize_message(message), JointTrajectory) == message


@pytest.mark.parametrize("steps", [1, 2, 80])
def test_a_marked_covariance_has_the_distance_from_the_training_range(steps: int) -> None:
    buffer = StampedCovarianceBytes("base_link", steps, marked=True)
    rng = np.random.default_rng(steps)
    for distance in (rng.random(steps), np.zeros(steps), None):
        expected = rng.normal(size=(steps, 3, 3))
        message = deserialize_message(buffer.fill(7, expected, distance), JointTrajectory)
        read = [point.positions for point in message.points]
        np.testing.assert_array_equal(np.reshape(read, (steps, 3, 3)), expected)
        marks = np.array([point.effort for point in message.points])
        wanted = np.full(steps, np.nan) if distance is None else distance
        np.testing.assert_array_equal(marks, wanted[:, None])
        times = [join_stamp(point.time_from_start) for point in message.points]
        assert times == [step * 25_000_000 for step in range(1, steps + 1)]


@pytest.mark.parametrize("stamp_ns", [0, 1, 999_999_999, 10**9, 1_760_000_000_999_999_999])
def test_stamps_are_exact(stamp_ns: int) -> None:
    sec, nanosec = split_stamp(stamp_ns)
    assert 0 <= nanosec < 10**9
    assert sec * 10**9 + nanosec == stamp_ns


def test_printed_and_json_lines() -> None:
    received = ReceivedPrediction(
        stamp_ns=1_760_000_000_025_000_000,
        x=(10.0, -0.5, math.radians(20.0)),
        covariance=np.diag([0.01, 0.04, math.radians(2.0) ** 2]),
        arrival_ns=0,
    )
    shown = line(received)
    assert shown.split() == [
        "1760000000.025", "36.00", "±", "0.36", "-1.80", "±", "0.72", "20.00", "±", "2.00",
    ]  # fmt: skip
    assert len(header()) == len(shown)
    assert json_line(received) == (
        '{"stamp_ns": 1760000000025000000, "v_x": 10.0, "v_y": -0.5, '
        f'"yaw_rate": {math.radians(20.0)}, "covariance": [[0.01, 0.0, 0.0], [0.0, 0.04, 0.0], '
        f"[0.0, 0.0, {math.radians(2.0) ** 2}]]}}"
    )
