# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages from the values of their channels.

Frames are those of simulated recordings (`offline.export`). A value that has no source, or none at
a stamp, is marked as not measured by its covariance (REP-145), never written as NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from adk_ros.bags import COMMAND_TYPES, IMU_TYPE, ODOMETRY_TYPE, message
from adk_ros.bags.auxiliary_topics import FIX, NUMBER, PRESSURE, TWIST
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.commands import ESTIMATED_TORQUE
from adk_ros.signals.decode import NOT_MEASURED

COMMAND_TYPE = COMMAND_TYPES["joint_state"]

Create = Callable[[int, Mapping[str, float], Collection[str]], Any]
"""Function (stamp in ns, values, channels that are unknown at this stamp) -> message; it returns
the same object each time."""


def imu(names: set[str]) -> Create:
    """Return the factory of IMU messages from the channels `names`."""
    rates, vertical = {0: "roll_rate", 4: "pitch_rate"}, {8: "a_z"}
    has_attitude = {"roll", "pitch"} <= names
    msg = message(
        IMU_TYPE,
        header=_stamped("imu_link"),
        orientation_covariance=(
            _diagonal(3, {8: NOT_MEASURED}) if has_attitude else [-1.0] + [0.0] * 8
        ),
        angular_velocity_covariance=_diagonal(3, _missing(rates, names)),
        linear_acceleration={"z": GRAVITY},
        linear_acceleration_covariance=_diagonal(3, _missing(vertical, names)),
    )
    force, rate, q = msg.linear_acceleration, msg.angular_velocity, msg.orientation

    def create(stamp_ns: int, values: Mapping[str, float], unknown: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        force.x, force.y, rate.z = values["a_x"], values["a_y"], values["yaw_rate"]
        force.z = values.get("a_z", GRAVITY)
        rate.x, rate.y = values.get("roll_rate", 0.0), values.get("pitch_rate", 0.0)
        if has_attitude:
            roll, pitch = 0.5 * values["roll"], 0.5 * values["pitch"]
            q.x, q.w = math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch)
            q.y, q.z = math.cos(roll) * math.sin(pitch), -math.sin(roll) * math.sin(pitch)
            is_unknown = "roll" in unknown or "pitch" in unknown
            msg.orientation_covariance[0] = -1.0 if is_unknown else 0.0
        _mark(msg.angular_velocity_covariance, rates, names, unknown)
        _mark(msg.linear_acceleration_covariance, vertical, names, unknown)
        return msg

    return create


def odometry(names: set[str]) -> Create:
    """Return the factory of odometry messages from the channels `names`."""
    position = {0: "x", 7: "y", 14: "z", 35: "heading"}
    velocity = {7: "v_y", 35: "odometry_yaw_rate"}
    never = {21: NOT_MEASURED, 28: NOT_MEASURED}
    msg = message(
        ODOMETRY_TYPE,
        header=_stamped("odom"),
        child_frame_id="base_link",
        pose={"covariance": _diagonal(6, _missing(position, names) | never)},
        twist={"covariance": _diagonal(6, _missing(velocity, names) | never | {14: NOT_MEASURED})},
    )
    point, q = msg.pose.pose.position, msg.pose.pose.orientation
    linear, angular = msg.twist.twist.linear, msg.twist.twist.angular

    def create(stamp_ns: int, values: Mapping[str, float], unknown: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        # An estimate is written, and marked as not measured.
        linear.x = values["v_x"]
        linear.y = values.get("v_y", values.get("v_y_estimated", 0.0))
        angular.z = values.get("odometry_yaw_rate", 0.0)
        point.x, point.y = values.get("x", 0.0), values.get("y", 0.0)
        point.z = values.get("z", 0.0)
        heading = values.get("heading", 0.0)
        q.z, q.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
        _mark(msg.pose.covariance, position, names, unknown)
        return msg

    return create


def command(names: set[str]) -> Create:
    """
    Return the factory of commands from the channels `names`.

    They have the effort of `drive` and the position of `steer`; one without a source is 0.
    """
    torque = "torque_estimated" if "torque_estimated" in names else "torque"
    msg = message(
        COMMAND_TYPE,
        header=_stamped(ESTIMATED_TORQUE if torque == "torque_estimated" else "base_link"),
        name=["drive", "steer"],
        position=[0.0, 0.0],
        velocity=[0.0, 0.0],
        effort=[0.0, 0.0],
    )

    def create(stamp_ns: int, values: Mapping[str, float], _: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.effort[0], msg.position[1] = values.get(torque, 0.0), values.get("delta", 0.0)
        return msg

    return create


def ground_velocity() -> Create:
    """Return the factory of velocities over ground: x east, y north."""
    msg = message(TWIST, header=_stamped("enu"))
    linear = msg.twist.linear

    def create(stamp_ns: int, values: Mapping[str, float], _: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        speed, course = values["gps_speed"], values["gps_course"]
        linear.x, linear.y = speed * math.sin(course), speed * math.cos(course)
        return msg

    return create


def fix() -> Create:
    """Return the factory of satellite fixes."""
    msg = message(FIX, header=_stamped("gps"))

    def create(stamp_ns: int, values: Mapping[str, float], unknown: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.latitude, msg.longitude = values["latitude"], values["longitude"]
        # The definition of NavSatFix asks for NaN where there is no altitude.
        msg.altitude = math.nan if "altitude" in unknown else values.get("altitude", math.nan)
        return msg

    return create


def rotation(name: str, frame: str) -> Create:
    """Return the factory of speeds of rotation about the y axis, forward positive (REP-103)."""
    msg = message(TWIST, header=_stamped(frame))

    def create(stamp_ns: int, values: Mapping[str, float], _: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.twist.angular.y = values[name]
        return msg

    return create


def pressures(name: str) -> Create:
    """Return the factory of pressures, from the channel `name`."""
    msg = message(PRESSURE, header=_stamped("brake"))

    def create(stamp_ns: int, values: Mapping[str, float], _: Collection[str]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.fluid_pressure = values[name]
        return msg

    return create


def numbers(name: str) -> Create:
    """Return the factory of numbers without a header, from the channel `name`."""
    msg = message(NUMBER)

    def create(_: int, values: Mapping[str, float], __: Collection[str]) -> Any:
        msg.data = values[name]
        return msg

    return create


def _missing(elements: Mapping[int, str], names: set[str]) -> dict[int, float]:
    return {index: NOT_MEASURED for index, name in elements.items() if name not in names}


def _mark(
    covariance: FloatArray, elements: Mapping[int, str], names: set[str], unknown: Collection[str]
) -> None:
    """Mark the elements of channels that are unknown, and no other of those in `names`."""
    for index, name in elements.items():
        if name in names:
            covariance[index] = NOT_MEASURED if name in unknown else 0.0


def _stamped(frame_id: str) -> dict[str, Any]:
    return {"stamp": 0, "frame_id": frame_id}


def _set_stamp(msg: Any, stamp_ns: int) -> None:
    stamp = msg.header.stamp
    stamp.sec, stamp.nanosec = divmod(stamp_ns, 10**9)


def _diagonal(size: int, entries: Mapping[int, float]) -> FloatArray:
    """Return a covariance as a flat array, with entries by their index in it."""
    matrix = np.zeros(size * size)
    for i, value in entries.items():
        matrix[i] = value
    return matrix
