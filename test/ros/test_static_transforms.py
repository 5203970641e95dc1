# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The pose of the IMU in a running node.

The package tf2_msgs is not among the wheels of the tests: another class is subscribed here, and
the transforms are given to the callback.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.node import Rig, write_model

from adk_ros.bags import message
from adk_ros.errors import UsageError
from adk_ros.model import artefact
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.ros import static_transforms
from adk_ros.ros.static_transforms import ImuExtrinsics
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> KoopmanModel:
    return artefact.load(write_model(tmp_path_factory.mktemp("model") / "model")).model


ROLL = math.pi
"""The IMU lies upside down."""


def transforms() -> Any:
    return message(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            message(
                "geometry_msgs/msg/TransformStamped",
                header={"frame_id": "base_link"},
                child_frame_id="imu_link",
                transform={
                    "translation": {"x": 0.5, "y": 0.0, "z": 0.3},
                    "rotation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0},
                },
            )
        ],
    )


def named(source: Source, msg: Any) -> Any:
    """A message with frames, of an IMU upside down."""
    if source is Source.IMU:
        msg.header.frame_id = "imu_link"
        msg.linear_acceleration.y *= -1.0
        msg.linear_acceleration.z *= -1.0
        msg.angular_velocity.z *= -1.0
    elif source is Source.ODOMETRY:
        msg.header.frame_id, msg.child_frame_id = "odom", "base_link"
    return msg


class Listening:
    """A node that keeps its subscription, and the notes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, rig: Rig) -> None:
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.notes: list[str] = []
        node = SimpleNamespace(create_subscription=self._subscribe)
        monkeypatch.setattr(static_transforms, "message_class", lambda *_: object)
        ImuExtrinsics(node, rig.core, self.notes.append)

    def _subscribe(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
        self.callbacks[topic] = callback


def rig(model: KoopmanModel, **sensors: Any) -> Rig:
    return Rig(model, PipelineSettings(sensors=SensorConfig(**sensors)))


@pytest.mark.parametrize("late", [False, True])
def test_the_pose_is_set_once_frames_and_transforms_are_known(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    driving = rig(model)
    listening = Listening(monkeypatch, driving)
    if late:
        driving.drive(1.0, named)
    listening.callbacks["/tf_static"](transforms())
    driving.drive(2.0, named)
    listening.callbacks["/tf_static"](transforms())
    driving.drive(1.0, named)
    sensors = driving.pipeline.settings.sensors
    assert sensors.imu_position == (0.5, 0.0)
    assert np.abs(sensors.imu_rotation) == pytest.approx([ROLL, 0.0, 0.0])
    assert listening.notes == [
        "IMU at (0.5, 0) m, rotated by (180, 0, 0)° (roll, pitch, yaw): /tf_static"
    ]
    assert driving.published
    assert not driving.errors


def test_predictions_are_those_of_an_imu_the_right_way_up(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned = rig(model)
    listening = Listening(monkeypatch, turned)
    listening.callbacks["/tf_static"](transforms())
    straight = rig(model, imu_position=(0.5, 0.0))
    for driving, change in ((turned, named), (straight, None)):
        driving.drive(3.0, change)
    # Until both frames were named, the pipeline had begun with an IMU upside down.
    last = [driving.published[-1] for driving in (turned, straight)]
    assert last[0].stamp_ns == last[1].stamp_ns
    a, b = (driving.pipeline.last_sample for driving in (turned, straight))
    assert a is not None
    assert b is not None
    assert a.x == pytest.approx(b.x, abs=1e-9)
    assert a.a == pytest.approx(b.a, abs=1e-6)


@pytest.mark.parametrize("sensors", [{"use_tf": False}, {"imu_rotation": (0.0, 0.0, 0.1)}])
def test_parameters_override_the_transforms(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch, sensors: dict[str, Any]
) -> None:
    assert not Listening(monkeypatch, rig(model, **sensors)).callbacks


def test_without_the_package_the_node_runs_as_it_is_configured(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: str) -> Any:
        raise UsageError("the ROS package tf2_msgs is not installed")

    driving = rig(model)
    monkeypatch.setattr(static_transforms, "message_class", missing)
    subscribed: list[Any] = []
    node = SimpleNamespace(create_subscription=lambda *x: subscribed.append(x))
    notes: list[str] = []
    ImuExtrinsics(node, driving.core, notes.append)
    driving.drive(1.0)
    assert not subscribed
    assert notes == ["the ROS package tf2_msgs is not installed: /tf_static is not read"]
    assert driving.published


def test_unusable_transforms_do_not_end_the_node(
    model: KoopmanModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    driving = rig(model)
    listening = Listening(monkeypatch, driving)
    listening.callbacks["/tf_static"](SimpleNamespace(transforms=[None]))
    driving.drive(1.0, named)
    assert driving.published
    assert len(driving.errors) == 1
