# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints of the command, wheel speeds, and the choice among several topics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.bags import START_NS
from helpers.calibration import VEHICLE, checked, driven, existing

from adk_ros.bags import BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.calibration.finding import Verdict
from adk_ros.calibration.from_bag import read_streams
from adk_ros.calibration.streams import Stream

JOINTS = "sensor_msgs/msg/JointState"


def wheel_streams(radius: float) -> dict[str, Stream]:
    odometry = existing(driven(), "odometry")
    noise = 0.05 * np.random.default_rng(0).standard_normal(odometry.at_s.size)
    return {
        "wheel": Stream("wheel", odometry.at_s, {"velocity": odometry["v_x"] / radius + noise})
    }


def test_a_worn_wheel_is_found() -> None:
    radius = 0.96 * VEHICLE.wheel_radius
    result = checked(replace(driven(), wheels=wheel_streams(radius)))
    (found,) = result.of(Verdict.FINDING)
    assert found.name == "wheel_radius"
    assert found.low is not None
    assert found.high is not None
    assert found.low - 0.002 <= 0.96 <= found.high + 0.002
    assert result.parameters["wheel_radius"] == pytest.approx(radius, rel=0.005)


def test_a_wheel_of_the_nominal_radius_is_ok() -> None:
    result = checked(replace(driven(), wheels=wheel_streams(VEHICLE.wheel_radius)))
    assert not result.of(Verdict.FINDING)
    assert "wheel_radius" in {x.name for x in result.of(Verdict.OK)}


def test_the_command_is_the_topic_that_steers(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/command", "/wheels"):
            writer.add_topic(topic, JOINTS)
        for i in range(60):
            header = {"stamp": START_NS + i * 20_000_000, "frame_id": "base_link"}
            wheels = message(JOINTS, header=header, name=["left"], velocity=[30.0 + 0.01 * i])
            writer.write("/wheels", wheels, START_NS + i * 20_000_000)
            if i % 2:
                command = message(
                    JOINTS,
                    header=header,
                    name=["drive", "steer"],
                    position=[0.0, 0.001 * i],
                    effort=[1.0 * i, 0.0],
                )
                writer.write("/command", command, START_NS + i * 20_000_000)
    content = read_streams(tmp_path / "bag", RecordingOptions())
    assert content.topics["command"] == "/command"
    assert content.streams.command is not None
    assert content.streams.command["torque"][:2].tolist() == [1.0, 3.0]
    assert set(content.streams.wheels) == {"left"}


def test_a_stray_stamp_does_not_stretch_the_recording(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/imu", "sensor_msgs/msg/Imu")
        for i in range(50):
            stamp = START_NS + i * 10_000_000
            wrong = 10**18 if i == 20 else stamp
            header = {"stamp": wrong, "frame_id": "imu_link"}
            msg = message("sensor_msgs/msg/Imu", header=header, angular_velocity={"z": 0.001 * i})
            writer.write("/imu", msg, stamp)
    imu = read_streams(tmp_path / "bag", RecordingOptions()).streams.imu
    assert imu is not None
    assert imu.at_s.size == 49
    assert imu.disordered >= 1
    assert imu.at_s[-1] == pytest.approx(0.49)
