# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed transforms on topics: their quality of service, and the pose of the IMU in a node."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Protocol

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from adk_ros.errors import UsageError
from adk_ros.ros.session import message_class
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.extrinsics import (
    MSGTYPE,
    TOPIC,
    StaticTransforms,
    extrinsics_text,
    wants_extrinsics,
    with_extrinsics,
)

_DEPTH = 100
"""Queue depth, messages: each publisher of static transforms keeps one."""


def has_static_transforms(topic: str) -> bool:
    """Whether a topic is `/tf_static`, or that of one of several cars."""
    return topic.endswith(TOPIC)


def static_transforms_qos(depth: int = _DEPTH) -> Any:
    """
    Return the quality of service of `/tf_static`, of publishers and subscribers.

    The latest `depth` messages of a publisher are kept, also for a subscriber that comes later.
    """
    profile: Any = QoSProfile
    return profile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class Receiver(Protocol):
    """
    What reads the messages of a car: the core of a predictor, or a watch.

    `frames`: of the values of IMU and odometry, once messages have named them; `on_frames` is then
    called. `guarded`: context in which an exception does not end the node.
    """

    frames: dict[Source, str]
    on_frames: Callable[[], None]

    @property
    def sensors(self) -> SensorConfig:
        """The configuration that messages are read with."""

    def set_sensors(self, sensors: SensorConfig) -> None:
        """Read all further messages with another configuration; begin afresh."""

    def guarded(self) -> AbstractContextManager[None]:
        """Return a context that catches exceptions."""


class ImuExtrinsics:
    """
    Sets the pose of the IMU as soon as transforms and messages have named the frames.

    Until then the IMU is read as if it were unrotated at the origin; the receiver then begins
    afresh, and `on_known` is called. Does nothing where a parameter gives the pose, or where the
    ROS package tf2_msgs is not installed.
    """

    def __init__(
        self,
        node: Any,
        receiver: Receiver,
        note: Callable[[str], None],
        on_known: Callable[[SensorConfig], None] | None = None,
    ) -> None:
        self._receiver, self._note, self._on_known = receiver, note, on_known
        self._transforms = StaticTransforms()
        self.subscription: Any = None
        if not wants_extrinsics(receiver.sensors):
            return
        try:
            kind = message_class(MSGTYPE, TOPIC)
        except UsageError:
            note(f"the ROS package tf2_msgs is not installed: {TOPIC} is not read")
            return
        self.subscription = node.create_subscription(
            kind, TOPIC, self.take, static_transforms_qos()
        )
        receiver.on_frames = self._apply

    def take(self, message: Any) -> None:
        """Add the transforms of a message."""
        with self._receiver.guarded():
            self._transforms.add(message)
            self._apply()

    def _apply(self) -> None:
        sensors, frames = self._receiver.sensors, self._receiver.frames
        known = with_extrinsics(
            sensors, self._transforms, frames.get(Source.ODOMETRY, ""), frames.get(Source.IMU, "")
        )
        if known != sensors:
            self._receiver.set_sensors(known)
            self._note(extrinsics_text(known))
            if self._on_known is not None:
                self._on_known(known)
