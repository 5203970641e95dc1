# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk watch` as a process over topics: a drive several times faster than real time."""

from __future__ import annotations

import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.watch import ONSET_S, changing_drive, surrogate
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from adk_ros.bags import Bag
from adk_ros.bench.mismatch.watch_drives import readings_of
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.ros.node import GRACE_S
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import KINDS, message
from adk_ros.signals.channels import Source

RATE = 6.0
"""Seconds of the drive in a second: the watch needs a few per cent of a core in real time."""
TOPICS = {
    Source.IMU: "/car1/imu",
    Source.ODOMETRY: "/car1/odometry",
    Source.COMMAND: "/car1/command",
}


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


class Received:
    """What the watch published."""

    def __init__(self, session: Session) -> None:
        self.changes: list[dict[str, Any]] = []
        self.status: list[Any] = []
        latched: Any = QoSProfile
        session.node.create_subscription(
            String,
            "/car1/watch/change",
            lambda m: self.changes.append(json.loads(m.data)),
            latched(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        )
        session.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.status.extend(m.status), 100
        )


def publish_drive(session: Session, **changes: float) -> None:
    """Publish a drive with its poses, `RATE` times faster than real time."""
    node = session.node
    publishers: dict[Source, Any] = {}
    for source, topic in TOPICS.items():
        publishers[source] = node.create_publisher(KINDS[source], topic, 4000)
    until_s = time.monotonic() + 30.0
    while any(not p.get_subscription_count() for p in publishers.values()):
        assert time.monotonic() < until_s, "the watch does not subscribe"
        session.spin(0.1)
    time.sleep(0.5)
    begin_s = time.monotonic()
    for reading, pose in readings_of(changing_drive(**changes)):
        due_s = begin_s + (1e-9 * reading.stamp_ns - 1.0) / RATE
        while time.monotonic() < due_s:
            session.spin(0.001)
        sent = message(reading)
        if pose is not None:
            sent.pose.pose.position.x, sent.pose.pose.position.y = pose[:2]
            sent.pose.pose.orientation.z = math.sin(0.5 * pose[2])
            sent.pose.pose.orientation.w = math.cos(0.5 * pose[2])
        publishers[reading.source].publish(sent)


@pytest.mark.slow(seconds=75)
def test_a_change_is_published_and_its_evidence_written(domain: None, tmp_path: Path) -> None:
    model = tmp_path / "simulation.yaml"
    model.write_text(simulation_yaml(surrogate()))
    out = tmp_path / "changes"
    arguments = ["--model", str(model), "--out", str(out), "--namespace", "/car1"]
    for source, topic in TOPICS.items():
        arguments += [f"--{source.name.lower()}", topic]
    process = subprocess.Popen(
        [sys.executable, "-m", "adk_ros.cli.main", "watch", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        with Session("car") as session:
            received = Received(session)
            publish_drive(session, mass=200.0, yaw_inertia=220.0)
            until_s = time.monotonic() + 30.0
            final = out / "change_1" / "change.json"
            while not final.exists() and time.monotonic() < until_s:
                session.spin(0.1)
            session.spin(0.5)
        begin_s = time.monotonic()
        process.send_signal(signal.SIGINT)
        code = process.wait(10.0)
        ended_s = time.monotonic() - begin_s
    finally:
        if process.poll() is None:
            process.kill()
        _, errors = process.communicate()
    assert code == 0, errors
    assert ended_s < 2.0
    last = received.changes[-1]
    assert last["state"] == "final", errors
    assert last["node"] == "car1/watch"
    assert last["effects"][0]["name"] == "payload"
    assert last["onset"]["stamp_ns"] == pytest.approx((ONSET_S + 1.0) * 1e9, abs=2e9)
    mass = last["effects"][0]["parameters"]["mass"]
    assert mass["low"] < 200.0 < mass["high"]
    named = [s for s in received.status if s.name == "car1/watch: watch"]
    assert named
    assert {s.hardware_id for s in named} == {"car1/watch"}
    assert any("more mass" in s.message and s.level == b"\x01" for s in named)
    # The evidence can be read as a recording, and the stated command names it.
    log = read_sensor_log(out / "change_1" / "evidence")
    assert log.imu_s.size > 15_000
    assert json.loads(final.read_text())["number"] == 1
    command = next(line for line in errors.splitlines() if "adk mismatch" in line)
    words = shlex.split(command.partition("evidence: ")[2])
    assert Path(words[words.index("--simulation") + 1]).is_file()
    with Bag(Path(words[words.index("--recording") + 1])) as bag:
        assert {topic.name for topic in bag.topics} == set(TOPICS.values())


@pytest.mark.slow(seconds=10)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_in_a_thread_of_a_library_ends_the_watch(
    domain: None, tmp_path: Path, number: signal.Signals
) -> None:
    model = tmp_path / "simulation.yaml"
    model.write_text(simulation_yaml(surrogate()))
    # The linear algebra library then has a thread before signals are blocked.
    process = subprocess.Popen(
        [sys.executable, "-m", "adk_ros.cli.main", "watch", "--model", str(model)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
    )
    try:
        with Session("listener") as session:
            received = Received(session)
            until_s = time.monotonic() + 60.0
            while not received.status and time.monotonic() < until_s:
                session.spin(0.1)
        begin_s = time.monotonic()
        process.send_signal(number)
        _, errors = process.communicate(timeout=10.0)
        ended_s = time.monotonic() - begin_s
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    assert process.returncode == 0
    # A machine that is too slow for an orderly end within the grace period cuts it short. The
    # middleware may add a line.
    if ended_s < GRACE_S:
        assert "received messages: 0 imu, 0 odometry, 0 command" in errors.splitlines()
