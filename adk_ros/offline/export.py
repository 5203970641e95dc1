# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write a simulated recording as a bag with the messages of the vehicle's sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import COMMAND_TYPES, IMU_TYPE, ODOMETRY_TYPE, BagWriter, message
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.sensors import Sensors
from adk_ros.signals.channels import Source

TOPICS = {
    Source.IMU: ("/imu/data", IMU_TYPE),
    Source.ODOMETRY: ("/odometry", ODOMETRY_TYPE),
    Source.COMMAND: ("/vehicle/command", COMMAND_TYPES["joint_state"]),
}
"""Topic and message type of each stream."""

_UNKNOWN_VARIANCE = 1e6
"""Variance of the axes that a planar sensor does not measure, SI units squared."""

_MIN_VARIANCE = 1e-9
"""Variance of a sensor without noise, SI units squared: all-zero means unknown (REP-145)."""

Progress = Callable[[int, int], None]

_MessageFactory = Callable[[int, list[float]], Any]
"""Function (stamp, values) -> message; it returns the same object each time, with new values."""


def _variance(noise: float) -> float:
    return max(noise * noise, _MIN_VARIANCE)


def _stamped(frame_id: str) -> dict[str, Any]:
    return {"stamp": 0, "frame_id": frame_id}


def _set_stamp(msg: Any, stamp_ns: int) -> None:
    stamp = msg.header.stamp
    stamp.sec, stamp.nanosec = divmod(stamp_ns, 10**9)


def _imu(sensors: Sensors) -> _MessageFactory:
    """Return the factory of IMU messages: no orientation (REP-145: -1), gravity on the z axis."""
    accel = gyro = _MIN_VARIANCE
    if sensors.imu is not None:
        accel, gyro = _variance(sensors.imu.accel_noise), _variance(sensors.imu.gyro_noise)
    msg = message(
        IMU_TYPE,
        header=_stamped("imu_link"),
        orientation_covariance=[-1.0] + [0.0] * 8,
        angular_velocity_covariance=_diagonal(3, {0: gyro, 1: gyro, 2: gyro}),
        linear_acceleration={"z": GRAVITY},
        linear_acceleration_covariance=_diagonal(3, {0: accel, 1: accel, 2: accel}),
    )

    def create(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.linear_acceleration.x, msg.linear_acceleration.y, msg.angular_velocity.z = values
        return msg

    return create


def _odometry(sensors: Sensors) -> _MessageFactory:
    """Return the factory of odometry messages."""
    o = sensors.odometry
    position, velocity = _variance(o.position_noise), _variance(o.velocity_noise)
    msg = message(
        ODOMETRY_TYPE,
        header=_stamped("odom"),
        child_frame_id="base_link",
        pose={"covariance": _planar(position, _variance(o.heading_noise))},
        twist={"covariance": _planar(velocity, _variance(o.yaw_rate_noise))},
    )
    point, orientation = msg.pose.pose.position, msg.pose.pose.orientation
    linear, angular = msg.twist.twist.linear, msg.twist.twist.angular
    orientation.x = orientation.y = 0.0

    def create(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        linear.x, linear.y, angular.z, point.x, point.y, heading = values
        orientation.z, orientation.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
        return msg

    return create


def _command(_: Sensors) -> _MessageFactory:
    """Return the factory of commands: effort of `drive` (net torque), position of `steer`."""
    msg = message(
        COMMAND_TYPES["joint_state"],
        header=_stamped("base_link"),
        name=["drive", "steer"],
        position=[math.nan, math.nan],
        velocity=[math.nan, math.nan],
        effort=[math.nan, math.nan],
    )

    def create(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.effort[0], msg.position[1] = values
        return msg

    return create


def _diagonal(size: int, entries: dict[int, float]) -> FloatArray:
    matrix = np.zeros(size * size)
    for i, value in entries.items():
        matrix[i * (size + 1)] = value
    return matrix


def _planar(linear: float, yaw: float) -> FloatArray:
    """Return the (36,) covariance of x, y and yaw; the other axes are unknown."""
    unknown = dict.fromkeys((2, 3, 4), _UNKNOWN_VARIANCE)
    return _diagonal(6, {0: linear, 1: linear, 5: yaw, **unknown})


_FACTORIES = {Source.IMU: _imu, Source.ODOMETRY: _odometry, Source.COMMAND: _command}


def _messages(
    drive: SimulatedDrive, source: Source, sensors: Sensors
) -> Iterator[tuple[int, str, Any]]:
    create = _FACTORIES[source](sensors)
    topic = TOPICS[source][0]
    stream = drive.streams[source]
    order = np.argsort(stream.log_ns, kind="stable")
    for log_ns, stamp_ns, values in zip(
        stream.log_ns[order].tolist(),
        stream.stamp_ns[order].tolist(),
        stream.values[order].tolist(),
        strict=True,
    ):
        yield log_ns, topic, create(stamp_ns, values)


def write_bag(
    drive: SimulatedDrive,
    path: Path | str,
    storage: str = "mcap",
    compression: str | None = None,
    progress: Progress | None = None,
) -> None:
    """
    Write the sensor messages of a simulated recording, in order of arrival, as a rosbag2 folder.

    Topics `/imu/data`, `/odometry`, `/vehicle/command`; frames `imu_link` and `odom -> base_link`,
    both at the centre of gravity. `progress` is called with (messages written, total messages)
    every 2000 messages.

    :param storage: "mcap" or "sqlite3".
    :param compression: None or "zstd".
    :raises UsageError: `path` exists or cannot be written, or an argument is unknown.
    """
    with BagWriter(path, storage, compression) as writer:
        for source in drive.streams:
            writer.add_topic(*TOPICS[source])
        streams = [_messages(drive, source, drive.sensors) for source in drive.streams]
        total = len(drive.readings)
        for done, (log_ns, topic, content) in enumerate(
            merge(*streams, key=lambda item: item[0]), start=1
        ):
            writer.write(topic, content, log_ns)
            if progress is not None and (done % 2000 == 0 or done == total):
                progress(done, total)
