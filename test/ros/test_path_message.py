# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path as bytes equals the message that rclpy would serialise."""

import itertools
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message, serialize_message

from adk_ros.ros import path_message
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


@pytest.mark.parametrize("stale", [0x5A5A5A5A5A5A5A, 0x5A5A5A3A5A5A5A])
@pytest.mark.parametrize("length", range(1, 9))
def test_padding_that_holds_earlier_bytes(
    stale: int, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_stale_padding(message: Any) -> bytes:
        buffer = bytearray(serialize_message(message))
        end = f"{message.header.frame_id}\0".encode()
        at = 0
        for alignment in itertools.chain([4], itertools.repeat(8)):
            at = buffer.find(end, at) + len(end)
            if at < len(end):
                return bytes(buffer)
            padding = (4 - at) % alignment
            buffer[at : at + padding] = stale.to_bytes(7, "little")[:padding]
        raise AssertionError

    monkeypatch.setattr(path_message, "serialize_message", with_stale_padding)
    made = PathBytes("m" * length, 3)
    message = deserialize_message(made.fill(ORIGIN_NS, np.ones((3, 3)), 0.0), Path)
    assert [pose.header.frame_id for pose in message.poses] == ["m" * length] * 3
    assert [join_stamp(pose.header.stamp) for pose in message.poses] == [
        ORIGIN_NS + (i + 1) * TICK_NS for i in range(3)
    ]
