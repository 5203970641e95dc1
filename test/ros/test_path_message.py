# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path as bytes equals the message that rclpy would serialise."""

import numpy as np
import pytest
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message

from adk_ros.ros.messages import join_stamp
from adk_ros.ros.path_message import PathBytes
from adk_ros.signals.channels import TICK_NS

ORIGIN_NS = 1_760_000_000_990_000_000


@pytest.mark.parametrize("frame_id", ["", "odom", "map12345", "car/odom_with_a_long_name"])
@pytest.mark.parametrize("steps", [1, 2, 80])
def test_path(frame_id: str, steps: int) -> None:
    rng = np.random.default_rng(steps)
    poses = rng.normal(0.0, 2.0, (steps, 3))
    made = PathBytes(frame_id, steps)
    made.fill(0, np.ones((steps, 3)), 9.0)
    message = deserialize_message(made.fill(ORIGIN_NS, poses, 1.5), Path)
    assert message.header.frame_id == frame_id
    assert join_stamp(message.header.stamp) == ORIGIN_NS
    assert len(message.poses) == steps
    for i, (pose, expected) in enumerate(zip(message.poses, poses, strict=True)):
        assert pose.header.frame_id == frame_id
        assert join_stamp(pose.header.stamp) == ORIGIN_NS + (i + 1) * TICK_NS
        p, q = pose.pose.position, pose.pose.orientation
        assert (p.x, p.y, p.z) == (expected[0], expected[1], 1.5)
        assert (q.x, q.y) == (0.0, 0.0)
        assert np.exp(1j * expected[2]) == pytest.approx(complex(q.w, q.z) ** 2)
