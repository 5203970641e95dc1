# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The channels that a map may name: what they are, their SI unit, and where they are stored.

IMU, odometry and command are what training, replay and mismatch read. The other channels are
stored as well, each in a topic of its own with the stamps of its source.
"""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.bags.auxiliary_topics import AXLES

IMU, ODOMETRY, COMMAND = "imu", "odometry", "command"
"""Streams of several channels in one message."""

ACCELERATION = "m/s^2"
SPEED, RATE, ANGLE, LENGTH = "m/s", "rad/s", "rad", "m"
TORQUE, PRESSURE, SHARE, DEGREE, CURVATURE = "N m", "Pa", "1", "deg", "1/m"

QUANTITIES = {
    ACCELERATION: "an acceleration, such as m/s^2 or g",
    SPEED: "a velocity, such as m/s or km/h",
    RATE: "an angular velocity, such as rad/s, deg/s or rpm",
    ANGLE: "an angle, such as rad or deg",
    LENGTH: "a length, such as m",
    TORQUE: "a torque, such as N m; 1 or % for a pedal position in its place",
    PRESSURE: "a pressure, such as bar",
    SHARE: "a share or number, such as 1 or %",
    DEGREE: "an angle, such as deg",
    CURVATURE: "a curvature, such as 1/m",
}
"""SI unit -> what the unit of a source must measure, for messages."""


@dataclass(frozen=True)
class Channel:
    """
    A channel of the vehicle.

    `unit`: of the stored values. `stream`: `IMU`, `ODOMETRY` or `COMMAND`; empty for a channel
    that has a topic of its own.
    """

    name: str
    unit: str
    stream: str
    meaning: str


_WHEEL = "speed of rotation of the wheel, forward positive"
_AXLE = "mean speed of rotation of the wheels of the axle, forward positive"

CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("a_x", ACCELERATION, IMU, "longitudinal specific force, forward positive"),
        Channel("a_y", ACCELERATION, IMU, "lateral specific force, left positive"),
        Channel("a_z", ACCELERATION, IMU, "vertical specific force, +9.81 at rest"),
        Channel("yaw_rate", RATE, IMU, "yaw rate of the gyro, left turn positive"),
        Channel("roll_rate", RATE, IMU, "roll rate, right side down positive"),
        Channel("pitch_rate", RATE, IMU, "pitch rate, nose down positive"),
        Channel("roll", ANGLE, IMU, "roll angle of the INS, right side down positive"),
        Channel("pitch", ANGLE, IMU, "pitch angle of the INS, nose down positive"),
        Channel("v_x", SPEED, ODOMETRY, "longitudinal velocity, forward positive"),
        Channel("v_y", SPEED, ODOMETRY, "lateral velocity, left positive"),
        Channel("v_y_estimated", SPEED, ODOMETRY, "the same, estimated from v_x and yaw rate"),
        Channel("odometry_yaw_rate", RATE, ODOMETRY, "yaw rate of another source than the gyro"),
        Channel("x", LENGTH, ODOMETRY, "position, to the east or forward at the start"),
        Channel("y", LENGTH, ODOMETRY, "position, to the north or left at the start"),
        Channel("z", LENGTH, ODOMETRY, "height"),
        Channel("heading", ANGLE, ODOMETRY, "direction of the x axis, from x towards y positive"),
        Channel("torque", TORQUE, COMMAND, "net wheel torque, sum of all wheels"),
        Channel("torque_estimated", TORQUE, COMMAND, "the same, estimated from the motion"),
        Channel("delta", ANGLE, COMMAND, "road-wheel angle, left positive"),
        *(
            Channel(f"wheel_speed_{at}", RATE, "", _WHEEL)
            for pair in AXLES.values()
            for at in pair
        ),
        *(Channel(f"wheel_speed_{axle}", RATE, "", _AXLE) for axle in AXLES),
        Channel("curvature", CURVATURE, "", "of the path, left positive; for computed.yaw_rate"),
        Channel("motor_speed", RATE, "", "speed of rotation of the engine or motor"),
        Channel("brake_pressure", PRESSURE, "", "brake pressure"),
        Channel("throttle", SHARE, "", "position of the accelerator pedal, 0 to 1"),
        Channel("brake_pedal", SHARE, "", "position of the brake pedal, 0 to 1"),
        Channel("gear", SHARE, "", "gear, reverse negative"),
        Channel("gps_speed", SPEED, "", "speed over ground"),
        Channel("gps_course", ANGLE, "", "course over ground, clockwise from north"),
        Channel("latitude", DEGREE, "", "latitude, WGS 84"),
        Channel("longitude", DEGREE, "", "longitude, WGS 84"),
        Channel("altitude", LENGTH, "", "height above the ellipsoid"),
    )
}
"""Channel by its name in a map."""


def is_wheel_speed(name: str) -> bool:
    """Return whether a channel is the speed of a wheel, which may also be given in m/s."""
    return name.startswith("wheel_speed_")
