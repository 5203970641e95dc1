# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed of an axle from the messages of its wheels."""

from __future__ import annotations

from typing import Any

from adk_ros.bags import message
from adk_ros.bags.auxiliary_topics import TWIST
from adk_ros.bags.axle_speed import AxleSpeed

LEFT, RIGHT = "/left", "/right"
STEP_NS = 20_000_000
START_NS = 10**18


def wheel(stamp_ns: int, speed: float) -> Any:
    header = {"stamp": stamp_ns, "frame_id": "wheel"}
    return message(TWIST, header=header, twist={"angular": {"y": speed}})


def joined(*messages: tuple[str, int, float]) -> list[tuple[int, float]]:
    """Return (stamp after the start in ns, speed) of the joined messages."""
    axle = AxleSpeed([LEFT, RIGHT])
    out = []
    for topic, after_ns, speed in messages:
        msg = axle.add(topic, 0, wheel(START_NS + after_ns, speed))
        if msg is not None:
            stamp = msg.header.stamp
            out.append((stamp.sec * 10**9 + stamp.nanosec - START_NS, msg.twist.angular.y))
    return out


def test_wheels_that_take_turns_are_averaged_in_speed_and_time() -> None:
    assert joined((LEFT, 0, 30.0), (RIGHT, 8, 32.0), (LEFT, 20, 33.0), (RIGHT, 28, 35.0)) == [
        (4, 31.0),
        (24, 34.0),
    ]


def test_a_lost_message_of_one_wheel_costs_one_of_the_axle() -> None:
    lost = joined(
        (LEFT, 0, 30.0),
        (RIGHT, 0, 32.0),
        (LEFT, STEP_NS, 30.0),
        (LEFT, 2 * STEP_NS, 40.0),
        (RIGHT, 2 * STEP_NS, 42.0),
    )
    assert lost == [(0, 31.0), (2 * STEP_NS, 41.0)]


def test_wheels_of_different_moments_are_not_joined() -> None:
    second = 10**9
    assert joined((LEFT, 0, 30.0), (RIGHT, second, 50.0), (LEFT, second, 52.0)) == [(second, 51.0)]
