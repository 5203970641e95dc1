# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Command messages: net wheel torque and road-wheel angle by message type.

Each type is a row of `COMMAND_TYPES`: its ROS type and a function message -> (torque, delta). To
support another type, write the function and the row; node, replay and training then use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

MAX_DRIVE = 1e6
"""N·m; a larger net wheel torque is a faulty message. Ten times that of a loaded truck."""
MAX_DELTA = math.pi / 2
"""rad; a larger road-wheel angle is a faulty message, such as an unscaled hand-wheel angle."""


class RefusedMessage(Exception):
    """A message cannot be used. The text is the reason, equal for equal faults."""


class CommandConfig(Protocol):
    """The part of `decode.SensorConfig` that the functions below need."""

    @property
    def drive_joints(self) -> tuple[str, ...]:
        """Joints whose efforts add up to the net wheel torque."""

    @property
    def steer_joint(self) -> str:
        """Joint whose position is the steering angle."""

    @property
    def steering_ratio(self) -> float:
        """Angle of the steer joint divided by the road-wheel angle."""

    @property
    def mass(self) -> float:
        """Vehicle mass, kg."""

    @property
    def wheel_radius(self) -> float:
        """Wheel radius, m."""


ESTIMATED_TORQUE = "torque_estimated_from_motion"
"""
Frame of a command whose torque was estimated from pedals by a map fitted to the motion: as of a
type with `inferred_torque`, it is no evidence about longitudinal forces.
"""


def is_torque_estimated(msg: Any) -> bool:
    """Return whether a command says that its torque was estimated from the motion."""
    return str(getattr(getattr(msg, "header", None), "frame_id", "")) == ESTIMATED_TORQUE


@dataclass(frozen=True)
class CommandType:
    """
    One type of command message.

    `inferred_torque` marks a torque computed from a requested acceleration (mass * acceleration *
    wheel radius): suitable as the input of a learned model, but no evidence about longitudinal
    forces. `steering_msgtype`: type of the message with the measured road-wheel angle, if the
    command itself carries only the requested one.
    """

    msgtype: str
    decode: Callable[[Any, CommandConfig], tuple[float, float]]
    inferred_torque: bool = False
    steering_msgtype: str | None = None


def checked_command(torque: float, delta: float) -> tuple[float, float]:
    """
    Return a net wheel torque (N·m) and a road-wheel angle (rad).

    :raises RefusedMessage: one is not finite, or larger than `MAX_DRIVE` or `MAX_DELTA`.
    """
    if not abs(torque) <= MAX_DRIVE:
        raise RefusedMessage(f"drive torque is not finite or above {MAX_DRIVE:g} N·m")
    if not abs(delta) <= MAX_DELTA:
        raise RefusedMessage(
            "steering angle is not finite or beyond 90 deg at the road wheel: if it is a "
            "hand-wheel angle, set steering_ratio"
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
    return checked_command(torque, float(positions[index]) / config.steering_ratio)


def _ackermann(msg: Any, config: CommandConfig) -> tuple[float, float]:
    drive = msg.drive
    torque = float(drive.acceleration) * config.mass * config.wheel_radius
    return checked_command(torque, float(drive.steering_angle))


def _autoware_control(msg: Any, config: CommandConfig) -> tuple[float, float]:
    torque = float(msg.longitudinal.acceleration) * config.mass * config.wheel_radius
    return checked_command(torque, float(msg.lateral.steering_tire_angle))


def steering_report(msg: Any) -> float:
    """
    Return the measured road-wheel angle (rad) of an Autoware SteeringReport.

    :raises RefusedMessage: it is not finite or beyond `MAX_DELTA`.
    """
    return checked_command(0.0, float(msg.steering_tire_angle))[1]


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
