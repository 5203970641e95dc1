# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Debug topics, the stamped covariance, ~/enable and the layouts, with a running node."""

import json
import math
import re
import threading
import time
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, TwistStamped, TwistWithCovarianceStamped
from helpers.node import running_node, write_model
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from adk_ros.model.training_range import TrainingRange
from adk_ros.ros.debug_topics import normalised_innovation_squared
from adk_ros.ros.messages import join_stamp
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import publish_synthetic_sensors

CONFIG = Path(__file__).resolve().parents[2] / "config"
KINDS = {
    "predicted_twist": TwistWithCovarianceStamped,
    "predicted_horizon_covariance": Float64MultiArray,
    "predicted_horizon_covariance_stamped": JointTrajectory,
    "debug/innovation": TwistStamped,
    "debug/normalised_innovation_squared": JointState,
    "debug/disturbance": AccelStamped,
    "debug/tick_time": JointState,
}


def curves() -> list[str]:
    """Return the curves of the layout for PlotJuggler, fields separated by slashes."""
    root = ET.parse(CONFIG / "plotjuggler.xml").getroot()
    return [curve.attrib["name"] for curve in root.iter("curve")]


def paths() -> list[str]:
    """Return the message paths of the layout for Foxglove."""
    panels = json.loads((CONFIG / "foxglove.json").read_text())["configById"]
    return [path["value"] for panel in panels.values() for path in panel.get("paths", ())]


def panels_in(layout: Any) -> set[str]:
    if isinstance(layout, str):
        return {layout}
    return panels_in(layout["first"]) | panels_in(layout["second"])


def has_field(topics: dict[str, list[str]], curve: str) -> bool:
    """Return whether a topic of the running node has the field of a curve or path."""
    name = max((n for n in topics if re.match(re.escape(n) + r"[/.]", curve)), key=len, default="")
    if not name:
        return False
    package, _, kind = topics[name][0].partition("/msg/")
    message = getattr(import_module(f"{package}.msg"), kind)()
    fields = re.split(r"[/.]", curve[len(name) + 1 :])
    if isinstance(message, JointState):
        # PlotJuggler writes the name of the value before the field.
        return re.sub(r"\[\d\]", "", fields[-1]) == "position" and len(fields) <= 2
    for field in fields:
        message = getattr(message, field, None)
    return isinstance(message, float)


def spin_until(session: Session, condition: Callable[[], bool], limit_s: float = 30.0) -> None:
    until_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < until_s
        session.spin(0.05)


@pytest.mark.slow(seconds=15)
def test_a_running_node(tmp_path: Path) -> None:
    received: dict[str, list[Any]] = defaultdict(list)
    messages: list[str] = []
    backwards = TrainingRange(np.full(7, -9.0), np.array([-3.0, *[9e3] * 6]))
    written = write_model(tmp_path / "model", trained_on=backwards)
    with (
        running_node(model=written, reference_point="[1.2, 0.0]") as node,
        Session("watcher") as session,
    ):
        for name, kind in KINDS.items():
            session.node.create_subscription(
                kind, f"/predictor/{name}", received[name].append, 1000
            )
        session.node.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda array: messages.extend(status.message for status in array.status),
            10,
        )
        client = session.node.create_client(SetBool, "/predictor/enable")
        traffic = threading.Thread(target=publish_synthetic_sensors, args=(12.0,))
        traffic.start()
        spin_until(session, lambda: len(received["debug/tick_time"]) > 60)
        topics = dict(session.node.get_topic_names_and_types())

        done = client.call_async(SetBool.Request(data=False))
        spin_until(session, done.done)
        assert (done.result().success, done.result().message) == (True, "disabled")
        spin_until(session, lambda: messages[-1] == "disabled")
        for name in KINDS:
            received[name].clear()
        quiet_until_s = time.monotonic() + 1.0
        spin_until(session, lambda: time.monotonic() > quiet_until_s)
        assert not any(received.values())
        assert messages[-1] == "disabled"
        done = client.call_async(SetBool.Request(data=True))
        compared = received["debug/normalised_innovation_squared"]
        spin_until(session, lambda: len(compared) > 40)
        traffic.join()
        assert node.end()[0] == 0

    for name, kind in KINDS.items():
        if kind is not Float64MultiArray:
            assert {m.header.frame_id for m in received[name]} == {"centre_of_gravity"}, name
    twists = {join_stamp(m.header.stamp): m for m in received["predicted_twist"]}
    stamped = {join_stamp(m.header.stamp): m for m in received["debug/innovation"]}
    squares = {
        join_stamp(m.header.stamp): m for m in received["debug/normalised_innovation_squared"]
    }
    assert len(squares) > 30
    for stamp_ns in sorted(set(squares) & set(stamped) & set(twists)):
        innovation = stamped[stamp_ns].twist
        assert squares[stamp_ns].name == ["v_x", "v_y", "yaw_rate", "all"]
        covariance = np.reshape(twists[stamp_ns].twist.covariance, (6, 6))
        expected = normalised_innovation_squared(
            np.array([innovation.linear.x, innovation.linear.y, innovation.angular.z]),
            covariance[np.ix_([0, 1, 5], [0, 1, 5])],
        )
        np.testing.assert_allclose(squares[stamp_ns].position, expected, rtol=1e-9)
    assert all(0.0 < m.position[0] < 1.0 for m in received["debug/tick_time"])
    assert any(m.accel.linear.x != 0.0 for m in received["debug/disturbance"])
    tables = [m.data.tolist() for m in received["predicted_horizon_covariance"]]
    for trajectory in received["predicted_horizon_covariance_stamped"][-5:]:
        assert [x for point in trajectory.points for x in point.positions] in tables
        # How far outside the training range.
        outside = [point.effort[0] for point in trajectory.points]
        assert all(0.0 < x < math.inf for x in outside), outside

    for curve in curves() + paths():
        assert has_field(topics, curve), curve


def test_layouts_are_complete() -> None:
    """Every panel is placed, every subscribed topic is plotted, and no curve is empty."""
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    assert panels_in(layout["layout"]) == set(layout["configById"])
    root = ET.parse(CONFIG / "plotjuggler.xml").getroot()
    subscribed = [topic.attrib["name"] for topic in root.iter("topic")]
    assert all(any(name.startswith(t + "/") for t in subscribed) for name in curves())
    assert len(curves()) == len(paths()) == len(set(paths()))


def test_normalised_innovation_squared() -> None:
    found = normalised_innovation_squared(np.array([2.0, 1.0, 3.0]), np.diag([4.0, 0.25, 1.0]))
    np.testing.assert_allclose(found, [1.0, 4.0, 9.0, 14.0])
    assert np.isnan(normalised_innovation_squared(np.ones(3), np.ones((3, 3)))[3])
