# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What each kind of command message says of wheel torque and road-wheel angle.

A kind is a row of `COMMAND_TYPES`: its ROS type and a function message -> (torque, delta). To add
one, write the function and the row; the node, the replay and the trainer then know it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

MAX_DRIVE = 1e6
"""N m; a larger net wheel torque is a fault of the message."""
MAX_DELTA = math.pi / 2
"""rad at the road wheel."""


class RefusedMessage(Exception):
    """A message cannot be used; the text is the reason, the same for the same fault."""


class CommandConfig(Protocol):
    """What of the sensors' configuration the decoders below need, see `decode.SensorConfig`."""

    @property
    def drive_joints(self) -> tuple[str, ...]:
        """Joints whose efforts add up to the wheel torque."""

    @property
    def steer_joint(self) -> str:
        """Joint whose position is the steering angle."""

    @property
    def steering_ratio(self) -> float:
        """Its angle over the road wheel's."""

    @property
    def mass(self) -> float:
        """Of the vehicle, kg."""

    @property
    def wheel_radius(self) -> float:
        """In m."""


@dataclass(frozen=True)
class CommandType:
    """
    One kind of command message.

    `inferred_torque` marks a torque computed from a wanted acceleration (mass times acceleration
    times wheel radius): good enough as an input to a learned model, no evidence of drive physics.
    `steering_msgtype`: type of the message that reports the measured road-wheel angle, where the
    command itself carries only the wished one.
    """

    msgtype: str
    decode: Callable[[Any, CommandConfig], tuple[float, float]]
    inferred_torque: bool = False
    steering_msgtype: str | None = None


def _checked(torque: float, delta: float) -> tuple[float, float]:
    if not abs(torque) <= MAX_DRIVE:
        raise RefusedMessage("drive torque is not finite or absurd")
    if not abs(delta) <= MAX_DELTA:
        raise RefusedMessage(
            "steering angle is not finite or beyond a quarter turn of the road wheel"
        )
    return torque, delta


def _joint_state(msg: Any, config: CommandConfig) -> tuple[float, float]:
    names, efforts, positions = list(msg.name), msg.effort, msg.position
    torque = 0.0
    for joint in config.drive_joints:
        if joint not in names:
            raise RefusedMessage(f"joint '{joint}' is missing")
        index = names.index(joint)
        if index >= len(efforts):
            raise RefusedMessage(f"joint '{joint}' has no effort")
        torque += float(efforts[index])
    joint = config.steer_joint
    if joint not in names:
        raise RefusedMessage(f"joint '{joint}' is missing")
    index = names.index(joint)
    if index >= len(positions):
        raise RefusedMessage(f"joint '{joint}' has no position")
    return _checked(torque, float(positions[index]) / config.steering_ratio)


def _ackermann(msg: Any, config: CommandConfig) -> tuple[float, float]:
    drive = msg.drive
    torque = float(drive.acceleration) * config.mass * config.wheel_radius
    return _checked(torque, float(drive.steering_angle))


def _autoware_control(msg: Any, config: CommandConfig) -> tuple[float, float]:
    torque = float(msg.longitudinal.acceleration) * config.mass * config.wheel_radius
    return _checked(torque, float(msg.lateral.steering_tire_angle))


def steering_report(msg: Any) -> float:
    """
    Return the measured road-wheel angle (rad) of an Autoware SteeringReport.

    :raises Refused: it is not finite or absurd.
    """
    return _checked(0.0, float(msg.steering_tire_angle))[1]


COMMAND_TYPES: dict[str, CommandType] = {
    "joint_state": CommandType("sensor_msgs/msg/JointState", _joint_state),
    "ackermann": CommandType(
        "ackermann_msgs/msg/AckermannDriveStamped", _ackermann, inferred_torque=True
    ),
    "autoware_control": CommandType(
        "autoware_control_msgs/msg/Control",
        _autoware_control,
        inferred_torque=True,
        steering_msgtype="autoware_vehicle_msgs/msg/SteeringReport",
    ),
}
