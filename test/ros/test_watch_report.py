# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The watch's diagnostics and evidence, without topics."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from helpers.watch import changing_drive, surrogate, watched
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from adk_ros.bags import Bag
from adk_ros.errors import UsageError
from adk_ros.mismatch.watch.watch import Watch
from adk_ros.ros.diagnostics import Level
from adk_ros.ros.evidence import MAX_BYTES, SPAN_S, Evidence, StampedMessage
from adk_ros.ros.session import Session
from adk_ros.ros.traffic import message
from adk_ros.ros.watch_node import WatchNode, WatchOptions, source_topics
from adk_ros.ros.watch_report import WatchInputs, watch_report
from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.decode import SensorConfig

ALL = WatchInputs({"imu": 5, "odometry": 5}, {"imu": 0.01, "odometry": 0.02}, {}, {}, [])


def test_a_stream_that_never_came_or_stopped_is_an_error_with_its_name() -> None:
    watch = Watch(surrogate(), lambda change: None)
    never = ALL._replace(age_s={"imu": 0.01, "odometry": math.inf})
    assert watch_report(watch, never, 0.0)[:2] == (Level.ERROR, "waiting for odometry")
    stopped = ALL._replace(age_s={"imu": 3.0, "odometry": 0.1})
    level, text, values = watch_report(watch, stopped, 0.031)
    assert (level, text) == (Level.ERROR, "no message of imu for 1 s")
    assert dict(values)["cpu_percent"] == "3.1"
    assert dict(values)["imu.age_s"] == "3.0"


def test_learning_states_its_progress_and_refusals_are_named() -> None:
    watch, _ = watched(changing_drive(), until_s=65.0)
    refused = ALL._replace(refused={"imu: no time stamp": 3})
    level, text, values = watch_report(watch, refused, 0.0)
    assert level is Level.OK
    assert text.startswith("learning the car: ")
    assert 0.3 < float(dict(values)["reference_share"]) < 0.6
    assert dict(values)["refused: imu: no time stamp"] == "3"


def test_wrong_stamps_are_a_warning_while_they_come() -> None:
    watch = Watch(surrogate(), lambda change: None)
    wrong = ALL._replace(strays={"imu": 7}, fresh_strays=["imu"])
    level, text, values = watch_report(watch, wrong, 0.0)
    assert level is Level.WARN
    assert text.startswith("imu: messages are left out, whose stamps differ")
    assert dict(values)["imu.stray_stamps"] == "7"
    assert dict(values)["odometry.stray_stamps"] == "0"
    assert watch_report(watch, wrong._replace(fresh_strays=[]), 0.0)[0] is Level.OK


@pytest.mark.slow(seconds=6)
def test_a_change_is_a_warning_with_its_sentence_and_size() -> None:
    watch, changes = watched(changing_drive(mass=200.0, yaw_inertia=220.0), until_s=185.0)
    level, text, values = watch_report(watch, ALL, 0.0)
    assert level is Level.WARN
    assert text == changes[-1].sentence()
    shown = dict(values)
    assert shown["change.effect"] == "payload"
    assert shown["change.mass"].endswith(") kg")
    assert shown["state"] == "changed"


def test_a_wrong_stamp_loses_no_evidence_and_a_clock_that_jumps_back_all(tmp_path: Path) -> None:
    sources = (Source.IMU, Source.ODOMETRY, Source.COMMAND)
    options = WatchOptions(
        source_topics("imu", "odometry", "command"), SensorConfig(), out=tmp_path / "out"
    )
    with Session("watch", polled=True) as session:
        node = WatchNode(session, surrogate(), options, lambda line: None)

        def take(source: Source, at_s: float) -> None:
            stamp_ns = 1_760_000_000_000_000_000 + round(1e9 * at_s)
            values = (0.1 * at_s, 0.0, 0.0)[: 2 if source is Source.COMMAND else 3]
            node._take(source, serialize_message(message(Reading(source, stamp_ns, values))))

        kept = node._evidence._kept
        for i in range(500):
            for source in sources:
                take(source, 0.02 * i)
            if i % 100 == 50:
                take(sources[i // 100 % 3], 0.02 * i + (3600.0 if i < 250 else -100.0))
        assert len(kept) == 3 * 500
        assert node.watch.restarts == 0
        assert node.watch.buffer.newest_s == pytest.approx(9.98)
        for i in range(2):
            for source in sources:
                take(source, 0.02 * i - 50.0)
        assert node.watch.restarts == 1
        assert len(kept) == 6


def imu_bytes(stamp_s: float) -> bytes:
    message = Imu()
    message.header.stamp.sec = int(stamp_s)
    return bytes(serialize_message(message))


def test_evidence_is_a_bag_of_the_time_span(tmp_path: Path) -> None:
    evidence = Evidence({"/imu": "sensor_msgs/msg/Imu", "/odometry": "nav_msgs/msg/Odometry"})
    for i in range(4000):
        evidence.add(StampedMessage("/imu", i * 100_000_000, imu_bytes(0.1 * i)))
    pauses = sum(1 for _ in evidence.write(tmp_path / "bag", 250_000_000_000, 380_000_000_000))
    assert pauses == 1
    with Bag(tmp_path / "bag") as bag:
        stamps = [log_ns for _, log_ns, _ in bag.messages(["/imu"])]
    assert stamps[0] == 250_000_000_000
    assert stamps[-1] == 380_000_000_000
    assert len(stamps) == 1301
    with pytest.raises(UsageError, match="exists already"):
        list(evidence.write(tmp_path / "bag", 0, 1))


def test_evidence_is_bounded_in_time_and_memory() -> None:
    evidence = Evidence({"/imu": "sensor_msgs/msg/Imu"})
    for i in range(1000):
        evidence.add(StampedMessage("/imu", i * 1_000_000_000, b"x"))
    assert len(evidence._kept) == SPAN_S + 1
    large = bytes(MAX_BYTES // 10)
    for _ in range(50):
        evidence.add(StampedMessage("/imu", 999_000_000_000, large))
    assert sum(len(item.content) for item in evidence._kept) <= MAX_BYTES
    assert evidence._kept
