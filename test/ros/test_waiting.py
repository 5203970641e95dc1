# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mis-remapped node says which topic it should have been given."""

import time
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.node import running_node, write_model
from nav_msgs.msg import Odometry

from adk_ros.ros.session import Session
from adk_ros.ros.waiting import waiting_hint
from adk_ros.signals.channels import Source

ODOMETRY, COMMAND = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
MISSING = {Source.ODOMETRY: ("/odometry", ODOMETRY), Source.COMMAND: ("/command", COMMAND)}


@pytest.mark.parametrize(
    ("published", "words"),
    [
        ([], "odometry: nobody publishes /odometry or any other nav_msgs/msg/Odometry; command: "),
        (
            [("/vehicle/odometry", [ODOMETRY]), ("/gps", [ODOMETRY]), ("/odom", ["other"])],
            "did you mean -r odometry:=/vehicle/odometry?",
        ),
        ([("/odometry", [ODOMETRY])], "/odometry is published but sends nothing that arrives"),
        ([("/joints", [COMMAND])], "did you mean -r command:=/joints?"),
    ],
)
def test_the_closest_topic_of_the_type_is_named(published: Any, words: str) -> None:
    text = waiting_hint(MISSING, published)
    assert text.startswith("waiting for odometry: ")
    assert words in text


def test_a_node_on_wrong_topics_says_so(tmp_path: Path) -> None:
    with (
        Session("car") as session,
        running_node(model=write_model(tmp_path / "m")) as node,
    ):
        session.node.create_publisher(Odometry, "/vehicle/odometry", 1)
        messages: list[str] = []
        session.node.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda array: messages.extend(status.message for status in array.status),
            10,
        )
        until_s = time.monotonic() + 60.0
        while all(text.startswith("starting") for text in messages):
            assert time.monotonic() < until_s
            session.spin(0.2)
        # The log tells of it after 5 s.
        assert node.process.stderr is not None
        line = next(text for text in node.process.stderr if "did you mean" in text)
        node.end()
    assert (
        "odometry: nobody publishes /odometry; did you mean -r odometry:=/vehicle/odometry?"
        in line
    )
    assert "command: nobody publishes /command" in line


def test_two_publishers_on_one_input_are_named(tmp_path: Path) -> None:
    messages: list[str] = []
    with (
        Session("gps") as gps,
        Session("wheels") as wheels,
        running_node(model=write_model(tmp_path / "m")) as node,
    ):
        for session in (gps, wheels):
            session.node.create_publisher(Odometry, "/odometry", 1)
        gps.node.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda array: messages.extend(status.message for status in array.status),
            10,
        )
        expected = "2 publishers on the topic of odometry, stop all but one: /gps, /wheels"
        until_s = time.monotonic() + 60.0
        while time.monotonic() < until_s and not any(expected in text for text in messages):
            gps.spin(0.1)
        node.end()
    assert expected in messages[-1]
    assert not any("UNKNOWN" in text for text in messages), "names that rmw makes up"
