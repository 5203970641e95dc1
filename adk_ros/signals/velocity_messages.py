# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages that a velocity is read from: odometry, wheel speeds, or a velocity over ground.

Each type is a row of `ODOMETRY_TYPES`: its ROS type and a function message -> (v_x, v_y, yaw
rate), NaN where the message reports none. Wheels roll at v_x = R omega: name those that neither
steer nor drive, if there are such, since slip and steering angle are not removed. A velocity over
ground is unsigned, and includes sideslip: at 5° it is 0.4 % too high.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from adk_ros.signals.commands import RefusedMessage

ODOMETRY = "odometry"
"""The type whose messages report all velocities."""


class VelocityConfig(Protocol):
    """The part of `decode.SensorConfig` that the functions below need."""

    @property
    def wheel_joints(self) -> tuple[str, ...]:
        """Joints of the wheels whose mean velocity counts."""

    @property
    def wheel_radius(self) -> float:
        """Rolling radius, m."""


Velocity = tuple[float, float, float]
"""v_x, v_y (m/s) and yaw rate (rad/s); NaN where they are not reported."""


@dataclass(frozen=True)
class OdometryType:
    """
    One type of message with a velocity.

    `needs_radius`: it is the speed of rotation of wheels.
    """

    msgtype: str
    decode: Callable[[Any, VelocityConfig], Velocity]
    needs_radius: bool = False


def estimated_lateral_velocity(
    v_x: float, yaw_rate: float, cg_to_rear_axle: float, slip_per_acceleration: float
) -> float:
    """
    Return v_y at the centre of gravity, m/s, as the steady state of a single-track model has it.

    v_y = l_r r - kappa r v_x², where the rear axle has the slip angle kappa per lateral
    acceleration (rad s²/m). M. Mitschke, H. Wallentowitz, Dynamik der Kraftfahrzeuge, chapter
    "Einspurmodell". No bank, no transients, no sliding tyre.
    """
    return yaw_rate * (cg_to_rear_axle - slip_per_acceleration * v_x * v_x)


def _odometry(msg: Any, _: VelocityConfig) -> Velocity:
    twist = msg.twist.twist
    return float(twist.linear.x), float(twist.linear.y), float(twist.angular.z)


def _wheel_joints(msg: Any, config: VelocityConfig) -> Velocity:
    names, velocities = list(msg.name), msg.velocity
    total = 0.0
    for joint in config.wheel_joints:
        if joint not in names:
            raise RefusedMessage(f"joint '{joint}' is missing")
        index = names.index(joint)
        if index >= len(velocities):
            raise RefusedMessage(f"joint '{joint}' has no velocity")
        total += float(velocities[index])
    return config.wheel_radius * total / len(config.wheel_joints), math.nan, math.nan


def _wheel_speed(msg: Any, config: VelocityConfig) -> Velocity:
    # About the y axis, forward positive (REP-103), as `adk import` writes it.
    return config.wheel_radius * float(msg.twist.angular.y), math.nan, math.nan


def _ground_velocity(msg: Any, _: VelocityConfig) -> Velocity:
    linear = msg.twist.linear
    return math.hypot(float(linear.x), float(linear.y)), math.nan, math.nan


ODOMETRY_TYPES: dict[str, OdometryType] = {
    ODOMETRY: OdometryType("nav_msgs/msg/Odometry", _odometry),
    "wheel_joints": OdometryType("sensor_msgs/msg/JointState", _wheel_joints, needs_radius=True),
    "wheel_speed": OdometryType("geometry_msgs/msg/TwistStamped", _wheel_speed, needs_radius=True),
    "ground_velocity": OdometryType("geometry_msgs/msg/TwistStamped", _ground_velocity),
}
"""Type of the odometry stream by the parameter `odometry_type`."""
