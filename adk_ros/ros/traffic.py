# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensors of a car that is not there: IMU, odometry and commands at their rates, stamped now.

For measuring the node, not for judging its predictions: a gentle slalom at 54 km/h, with noise
so that no sensor seems frozen. Each stream keeps its own absolute schedule, out of step with the
others.
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
_SWAY = 0.5
"""rad/s of the slalom's own rhythm."""
_SETTLE_S = 0.5
_QOS: Any = qos_profile_sensor_data
KINDS: dict[Source, Any] = {Source.IMU: Imu, Source.ODOMETRY: Odometry, Source.COMMAND: JointState}


class Rates(NamedTuple):
    """Messages a second."""

    imu_hz: float = 200.0
    odometry_hz: float = 50.0
    command_hz: float = 40.0


class Sent(NamedTuple):
    """A message that went out: what it says, and the monotonic time right before publishing."""

    reading: Reading
    published_ns: int


class Due(NamedTuple):
    """A message to send, so many nanoseconds after the begin."""

    offset_ns: int
    source: Source


def motion(source: Source, time_s: float, noise: random.Random) -> tuple[float, ...]:
    """Return the values of a reading of `source`, as `Reading` has them."""
    yaw_rate = 0.2 * math.sin(_SWAY * time_s)
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
    """Return the ROS message that carries a reading."""
    made = KINDS[reading.source]()
    made.header.stamp.sec, made.header.stamp.nanosec = split_stamp(reading.stamp_ns)
    if reading.source is Source.IMU:
        made.linear_acceleration.x, made.linear_acceleration.y = reading.values[:2]
        made.linear_acceleration.z = GRAVITY
        made.angular_velocity.z = reading.values[2]
    elif reading.source is Source.ODOMETRY:
        twist = made.twist.twist
        twist.linear.x, twist.linear.y, twist.angular.z = reading.values
    else:
        torque, delta = reading.values
        made.name = ["drive", "steer"]
        made.effort = [torque, 0.0]
        made.position = [0.0, delta]
    return made


def schedule(rates: Rates, duration_s: float) -> Iterator[Due]:
    """Yield what is due when, in order of time; a rate of 0 leaves a stream out."""

    def ticks(source: Source, rate_hz: float) -> Iterator[Due]:
        # A share of a period apart, so that no stream is in step with the grid or another.
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
    on_start: Callable[[], None] | None = None,
) -> list[Sent]:
    """
    Publish imu, odometry and command for `duration_s`, or until a signal; return what was sent.

    :param wait_s: wait so long for a node that listens to all three.
    :param on_start: called right before the first message.
    :raises DataError: nobody listens.
    """
    noise = random.Random(0)
    sent: list[Sent] = []
    with Session("adk_traffic") as session, stopping() as stopped:
        publishers = {
            source: session.node.create_publisher(kind, source.name.lower(), _QOS)
            for source, kind in KINDS.items()
        }
        deadline_s = time.monotonic() + wait_s
        while not all(publisher.get_subscription_count() for publisher in publishers.values()):
            if time.monotonic() > deadline_s:
                raise DataError(f"nobody listens to imu, odometry and command after {wait_s:g} s")
            session.spin(0.05)
        time.sleep(_SETTLE_S)
        if on_start is not None:
            on_start()
        begin_ns = time.monotonic_ns()
        dues = schedule(rates or Rates(), duration_s)
        for due, _late_ns in paced(dues, begin_ns, 1.0, stopped):
            values = motion(due.source, due.offset_ns * 1e-9, noise)
            reading = Reading(due.source, time.time_ns(), values)
            content = serialize_message(message(reading))
            published_ns = time.monotonic_ns()
            publishers[due.source].publish(content)
            sent.append(Sent(reading, published_ns))
    return sent
