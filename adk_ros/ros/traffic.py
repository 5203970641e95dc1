# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Publish synthetic sensor messages: IMU, odometry and commands at their rates, stamped now.

For measuring the node, not its predictions: a gentle slalom at 54 km/h, with noise so that no
sensor seems frozen. Each stream has its own absolute schedule, out of phase with the others.
"""

from __future__ import annotations

import heapq
import math
import random
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState

from adk_ros.errors import DataError
from adk_ros.numerics.constants import GRAVITY
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.pacing import paced
from adk_ros.ros.session import Session, stopping
from adk_ros.signals.channels import STANDARD_SOURCES, Reading, Source

_SPEED = 15.0
"""m/s; mean speed."""
_SLALOM_RATE = 0.5
"""rad/s; angular frequency of the slalom."""
_SETTLE_S = 0.5
"""s to wait after discovery: right after the endpoints match, messages are still lost."""
_QOS: Any = qos_profile_sensor_data
KINDS: dict[Source, Any] = {Source.IMU: Imu, Source.ODOMETRY: Odometry, Source.COMMAND: JointState}


class Rates(NamedTuple):
    """Message rates, Hz; 0 omits the stream."""

    imu_hz: float = 200.0
    odometry_hz: float = 50.0
    command_hz: float = 40.0


class Sent(NamedTuple):
    """A published message: its reading, and the monotonic time right before publishing."""

    reading: Reading
    published_ns: int


class Due(NamedTuple):
    """A message to publish, `offset_ns` after the start."""

    offset_ns: int
    source: Source


def motion(source: Source, time_s: float, noise: random.Random) -> tuple[float, ...]:
    """Return the values of a `Reading` of `source` at `time_s`, with noise."""
    yaw_rate = 0.2 * math.sin(_SLALOM_RATE * time_s)
    v_x = _SPEED + math.sin(0.3 * time_s)
    if source is Source.IMU:
        a_x = 0.3 * math.cos(0.3 * time_s)
        exact: tuple[float, ...] = (a_x, v_x * yaw_rate, yaw_rate)
    elif source is Source.ODOMETRY:
        exact = (v_x, -0.5 * yaw_rate, yaw_rate)
    else:
        exact = (120.0 * math.cos(0.3 * time_s), 0.18 * yaw_rate)
    return tuple(value + noise.gauss(0.0, 1e-3) for value in exact)


def message(reading: Reading) -> Any:
    """Return the ROS message for a reading."""
    msg = KINDS[reading.source]()
    msg.header.stamp.sec, msg.header.stamp.nanosec = split_stamp(reading.stamp_ns)
    if reading.source is Source.IMU:
        msg.linear_acceleration.x, msg.linear_acceleration.y = reading.values[:2]
        msg.linear_acceleration.z = GRAVITY
        msg.angular_velocity.z = reading.values[2]
    elif reading.source is Source.ODOMETRY:
        twist = msg.twist.twist
        twist.linear.x, twist.linear.y, twist.angular.z = reading.values
    else:
        torque, delta = reading.values
        msg.name = ["drive", "steer"]
        msg.effort = [torque, 0.0]
        msg.position = [0.0, delta]
    return msg


def schedule(rates: Rates, duration_s: float) -> Iterator[Due]:
    """Yield the messages to publish, in order of time."""

    def ticks(source: Source, rate_hz: float) -> Iterator[Due]:
        # Phases differ, so that no stream is in phase with the 25 ms grid or another stream.
        first_ns = round((0.3 + 0.17 * source) * 1e9 / rate_hz)
        period_ns = round(1e9 / rate_hz)
        for offset_ns in range(first_ns, round(duration_s * 1e9), period_ns):
            yield Due(offset_ns, source)

    streams = [
        ticks(source, rate) for source, rate in zip(STANDARD_SOURCES, rates, strict=True) if rate
    ]
    return heapq.merge(*streams)


def publish_synthetic_sensors(
    duration_s: float,
    rates: Rates | None = None,
    *,
    wait_s: float = 30.0,
    subscribers: int = 1,
    on_start: Callable[[], None] | None = None,
) -> list[Sent]:
    """
    Publish imu, odometry and command for `duration_s`, or until a signal; return what was sent.

    :param wait_s: longest wait for the nodes that subscribe to all three, s.
    :param subscribers: number of nodes to wait for.
    :param on_start: called right before the first message.
    :raises DataError: no node subscribes within `wait_s`.
    """
    noise = random.Random(0)
    sent: list[Sent] = []
    with Session("adk_traffic") as session, stopping() as stopped:
        publishers = {
            source: session.node.create_publisher(kind, source.name.lower(), _QOS)
            for source, kind in KINDS.items()
        }
        deadline_s = time.monotonic() + wait_s
        while any(p.get_subscription_count() < subscribers for p in publishers.values()):
            if time.monotonic() > deadline_s:
                raise DataError(
                    f"no node subscribes to imu, odometry and command after {wait_s:g} s"
                )
            session.spin(0.05)
        time.sleep(_SETTLE_S)
        if on_start is not None:
            on_start()
        begin_ns = time.monotonic_ns()
        due_messages = schedule(rates or Rates(), duration_s)
        for due, _late_ns in paced(due_messages, begin_ns, 1.0, stopped):
            values = motion(due.source, due.offset_ns * 1e-9, noise)
            reading = Reading(due.source, time.time_ns(), values)
            content = serialize_message(message(reading))
            published_ns = time.monotonic_ns()
            publishers[due.source].publish(content)
            sent.append(Sent(reading, published_ns))
    return sent
