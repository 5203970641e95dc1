# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the topics of a bag to read, by name or by message type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from adk_ros.bags.reader import Bag
from adk_ros.errors import DataError, UsageError
from adk_ros.signals import commands, velocity_messages

IMU_TYPE = "sensor_msgs/msg/Imu"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
STEERING_TYPE = commands.COMMAND_TYPES["autoware_control"].steering_msgtype or ""
COMMAND_TYPES = {name: kind.msgtype for name, kind in commands.COMMAND_TYPES.items()}
ODOMETRY_TYPES = {name: x.msgtype for name, x in velocity_messages.ODOMETRY_TYPES.items()}
_VELOCITIES = set(ODOMETRY_TYPES.values()) - {ODOMETRY_TYPE}


@dataclass(frozen=True)
class Topics:
    """
    The topics to read; `imu`, `command` and `steering` are None if there is none.

    `wheels`: further wheels, whose mean with `odometry` is the speed of their axle.
    """

    imu: str | None
    odometry: str
    command: str | None
    steering: str | None = None
    wheels: tuple[str, ...] = ()


def find_topics(
    bag: Bag,
    imu: str | None = None,
    odometry: str | None = None,
    command: str | None = None,
    command_type: str = "joint_state",
    steering: str | None = None,
    odometry_type: str = velocity_messages.ODOMETRY,
    steer_joint: str = "steer",
    wheel_joints: Sequence[str] = (),
    wheels: Sequence[str] = (),
) -> Topics:
    """
    Return the topics to read: those named, else the only one of the message type.

    Topics without messages are ignored. Of several topics of joint states the command is that with
    the joint `steer_joint`, the wheels' that with all `wheel_joints`. The IMU is optional, as is
    the steering report, which is used only with `command_type` "autoware_control"; the empty
    string as name excludes either, or the command.

    :param wheels: topics of the further wheels of an axle, of the type of `odometry`.
    :raises UsageError: a named topic is absent or of another type; unknown `command_type`.
    :raises DataError: a required topic is missing, or several have the message type.
    """
    if command_type not in COMMAND_TYPES:
        known = ", ".join(COMMAND_TYPES)
        raise UsageError(f"command type {command_type!r} is unknown: choose one of {known}")
    wants_steering = commands.COMMAND_TYPES[command_type].steering_msgtype is not None
    velocity = ODOMETRY_TYPES[odometry_type]
    return Topics(
        imu=_optional(bag, "imu", imu, IMU_TYPE),
        odometry=_required(bag, "odometry", odometry, velocity, wheel_joints),
        command=(
            None
            if command == ""
            else _required(bag, "command", command, COMMAND_TYPES[command_type], [steer_joint])
        ),
        steering=_optional(bag, "steering", steering, STEERING_TYPE) if wants_steering else None,
        wheels=tuple(_required(bag, "odometry", name, velocity) for name in wheels),
    )


def _required(
    bag: Bag, role: str, name: str | None, msgtype: str, joints: Sequence[str] = ()
) -> str:
    found = _optional(bag, role, name, msgtype, joints)
    if found is None:
        hint = ""
        joints_or_twists = [x for x in bag.topics if x.count and x.msgtype in _VELOCITIES]
        if role == "odometry" and len(joints_or_twists) > 1:
            hint = (
                " (for wheel speeds or a GPS velocity set odometry_type in --params, and "
                "wheel_radius unless it can be identified by GPS)"
            )
        if role == "command" and msgtype == COMMAND_TYPES["joint_state"]:
            hint = " (for Ackermann or Autoware commands set command_type in --params)"
        raise DataError(
            f"bag {bag.path}: no {role}: no topic of type {msgtype} with messages{hint}; "
            f"it has {bag.summary()}"
        )
    return found


def _optional(
    bag: Bag, role: str, name: str | None, msgtype: str, joints: Sequence[str] = ()
) -> str | None:
    if name == "":
        return None
    if name is not None:
        types = [x.msgtype for x in bag.topics if x.name == name]
        if not types:
            raise UsageError(
                f"bag {bag.path} has no topic {name} (--{role}); it has {bag.summary()}"
            )
        if msgtype not in types:
            raise UsageError(
                f"bag {bag.path}: --{role} {name} is {types[0]}, but {msgtype} is required"
            )
        if not any(x.count for x in bag.topics if x.name == name and x.msgtype == msgtype):
            raise DataError(f"bag {bag.path}: --{role} {name} has no messages")
        return name
    found = [x.name for x in bag.topics if x.msgtype == msgtype and x.count]
    if len(found) > 1 and joints and msgtype == COMMAND_TYPES["joint_state"]:
        # Wheel speeds are joint states as well as the command.
        having = [x for x in found if set(joints) <= joints_of(bag, x)]
        found = having if len(having) == 1 else found
    if len(found) > 1:
        raise DataError(
            f"bag {bag.path}: {len(found)} topics of type {msgtype}: {', '.join(found)}; "
            f"choose one with --{role} NAME"
        )
    return found[0] if found else None


def joints_of(bag: Bag, topic: str) -> set[str]:
    """Return the joints in a topic's first message."""
    first = next((msg for _, _, msg in bag.messages([topic])), None)
    return {str(name) for name in getattr(first, "name", [])}
