# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics beside IMU, odometry and command: wheel speeds, pedals, gear and satellite receiver.

`adk import` writes them, `adk export` and `adk check` read them: one table says which topic has
which channels, and where in its messages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from adk_ros.bags.reader import TopicInfo

TWIST, PRESSURE = "geometry_msgs/msg/TwistStamped", "sensor_msgs/msg/FluidPressure"
FIX, NUMBER = "sensor_msgs/msg/NavSatFix", "std_msgs/msg/Float64"

AXLES = {"front": ("front_left", "front_right"), "rear": ("rear_left", "rear_right")}
"""Wheels of each axle, left and right; a wheel speed may also be that of a whole axle."""
WHEEL_POSITIONS = (*AXLES["front"], *AXLES["rear"], *AXLES)
PEDALS = ("throttle", "brake_pedal", "brake_pressure", "gear")
"""Channels that drive and brake the car where no torque is recorded."""


@dataclass(frozen=True)
class AuxiliaryTopic:
    """
    A topic and its channels.

    `name` of the topic, `msgtype` of its messages. `channels`: names as in `importing.channels`,
    `values`: function message -> their values in that order, SI units, latitude and longitude in
    degrees.
    """

    name: str
    msgtype: str
    channels: tuple[str, ...]
    values: Callable[[Any], tuple[float, ...]]


def _rotation(msg: Any) -> tuple[float, ...]:
    # About the y axis, forward positive (REP-103).
    return (float(msg.twist.angular.y),)


def _pressure(msg: Any) -> tuple[float, ...]:
    return (float(msg.fluid_pressure),)


def _number(msg: Any) -> tuple[float, ...]:
    return (float(msg.data),)


def _ground_velocity(msg: Any) -> tuple[float, ...]:
    east, north = float(msg.twist.linear.x), float(msg.twist.linear.y)
    return math.hypot(east, north), math.atan2(east, north)


def _fix(msg: Any) -> tuple[float, ...]:
    return float(msg.latitude), float(msg.longitude), float(msg.altitude)


WHEEL_TOPICS = {at: f"/vehicle/wheel_speed/{at}" for at in WHEEL_POSITIONS}
"""Topic of the speed of rotation by the position of a wheel or axle."""
GPS_SPEED, GPS_VELOCITY, GPS_FIX = "/gps/speed", "/gps/velocity", "/gps/fix"

AUXILIARY_TOPICS: dict[str, AuxiliaryTopic] = {
    topic.name: topic
    for topic in (
        *(
            AuxiliaryTopic(name, TWIST, (f"wheel_speed_{at}",), _rotation)
            for at, name in WHEEL_TOPICS.items()
        ),
        AuxiliaryTopic("/vehicle/motor_speed", TWIST, ("motor_speed",), _rotation),
        AuxiliaryTopic("/vehicle/brake_pressure", PRESSURE, ("brake_pressure",), _pressure),
        AuxiliaryTopic("/vehicle/throttle", NUMBER, ("throttle",), _number),
        AuxiliaryTopic("/vehicle/brake_pedal", NUMBER, ("brake_pedal",), _number),
        AuxiliaryTopic("/vehicle/gear", NUMBER, ("gear",), _number),
        AuxiliaryTopic(GPS_SPEED, NUMBER, ("gps_speed",), _number),
        AuxiliaryTopic(GPS_VELOCITY, TWIST, ("gps_speed", "gps_course"), _ground_velocity),
        AuxiliaryTopic(GPS_FIX, FIX, ("latitude", "longitude", "altitude"), _fix),
    )
}
"""Auxiliary topic by its name."""


def auxiliary_topics(topics: Iterable[TopicInfo]) -> dict[str, AuxiliaryTopic]:
    """Return the auxiliary topics of a bag that have messages of the right type, by name."""
    return {
        x.name: AUXILIARY_TOPICS[x.name]
        for x in topics
        if x.count and x.name in AUXILIARY_TOPICS and x.msgtype == AUXILIARY_TOPICS[x.name].msgtype
    }


def topic_of(channel: str) -> AuxiliaryTopic:
    """Return the topic that has a channel alone."""
    return next(x for x in AUXILIARY_TOPICS.values() if x.channels == (channel,))


def stamp_ns_of(msg: Any, log_ns: int) -> int:
    """Return the stamp of a message, ns; a number without a header has the time of its log."""
    stamp = getattr(getattr(msg, "header", None), "stamp", None)
    return log_ns if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
