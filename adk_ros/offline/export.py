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
from adk_ros.plant.scenario.sensors import Sensors, Stream
from adk_ros.signals.channels import Source

TOPICS = {
    Source.IMU: ("/imu/data", IMU_TYPE),
    Source.ODOMETRY: ("/odometry", ODOMETRY_TYPE),
    Source.COMMAND: ("/vehicle/command", COMMAND_TYPES["joint_state"]),
}
"""Topic and message type of each stream."""
WHEELS_TOPIC = ("/vehicle/wheels", COMMAND_TYPES["joint_state"])
WHEEL_JOINTS = ("front_left", "front_right", "rear_left", "rear_right")
"""Joints of the wheels, whose velocities are their speeds of rotation."""

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
    """
    Return the factory of IMU messages, gravity on the z axis.

    Their values may end with roll and pitch; without, there is no orientation (REP-145: -1).
    """
    accel = gyro = _MIN_VARIANCE
    if sensors.imu is not None:
        accel, gyro = _variance(sensors.imu.accel_noise), _variance(sensors.imu.gyro_noise)
    attitude = None if sensors.imu is None else sensors.imu.attitude_noise
    covariance: FloatArray = np.array([-1.0] + [0.0] * 8)
    if attitude is not None:
        # The heading is not reported.
        variance = _variance(attitude)
        covariance = _diagonal(3, {0: variance, 1: variance, 2: _UNKNOWN_VARIANCE})
    msg = message(
        IMU_TYPE,
        header=_stamped("imu_link"),
        orientation_covariance=covariance,
        angular_velocity_covariance=_diagonal(3, {0: gyro, 1: gyro, 2: gyro}),
        linear_acceleration={"z": GRAVITY},
        linear_acceleration_covariance=_diagonal(3, {0: accel, 1: accel, 2: accel}),
    )

    def create(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.linear_acceleration.x, msg.linear_acceleration.y, msg.angular_velocity.z = values[:3]
        if attitude is not None:
            roll, pitch, q = 0.5 * values[3], 0.5 * values[4], msg.orientation
            q.x, q.w = math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch)
            q.y, q.z = math.cos(roll) * math.sin(pitch), -math.sin(roll) * math.sin(pitch)
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


def _wheels(_: Sensors) -> _MessageFactory:
    """Return the factory of wheel speeds: velocities of four joints."""
    msg = message(
        WHEELS_TOPIC[1],
        header=_stamped("base_link"),
        name=list(WHEEL_JOINTS),
        position=[math.nan] * 4,
        velocity=[math.nan] * 4,
        effort=[math.nan] * 4,
    )

    def create(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.velocity[:] = values
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
    topic: str, create: _MessageFactory, stream: Stream
) -> Iterator[tuple[int, str, Any]]:
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

    Topics `/imu/data`, `/odometry`, `/vehicle/command`, and `/vehicle/wheels` if the sensors of
    the scenario measure their speeds; frames `imu_link` and `odom -> base_link`,
    both at the centre of gravity. `progress` is called with (messages written, total messages)
    every 2000 messages.

    :param storage: "mcap" or "sqlite3".
    :param compression: None or "zstd".
    :raises UsageError: `path` exists or cannot be written, or an argument is unknown.
    """
    with BagWriter(path, storage, compression) as writer:
        topics = {source: (*TOPICS[source], _FACTORIES[source]) for source in drive.streams}
        contents = dict(drive.streams)
        if drive.attitude is not None:
            imu = contents[Source.IMU]
            values = np.hstack([imu.values, drive.attitude.values])
            contents[Source.IMU] = Stream(imu.stamp_ns, imu.log_ns, values)
        items = [(*topics[source], stream) for source, stream in contents.items()]
        if drive.wheels is not None:
            items.append((*WHEELS_TOPIC, _wheels, drive.wheels))
        for name, msgtype, _, _ in items:
            writer.add_topic(name, msgtype)
        streams = [_messages(name, of(drive.sensors), stream) for name, _, of, stream in items]
        total = sum(stream.log_ns.shape[0] for *_, stream in items)
        for done, (log_ns, topic, content) in enumerate(
            merge(*streams, key=lambda item: item[0]), start=1
        ):
            writer.write(topic, content, log_ns)
            if progress is not None and (done % 2000 == 0 or done == total):
                progress(done, total)
