# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive as a bag: the messages that a vehicle's own sensors would have published."""

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
"""Topic and type of each stream."""

_UNKNOWN = 1e6
"""Variance of what a planar sensor does not measure."""

_EXACT = 1e-9
"""Variance reported for a sensor without noise: all-zero would mean unknown (REP-145)."""

Progress = Callable[[int, int], None]

_Maker = Callable[[int, list[float]], Any]
"""From a stamp and values to a message: one and the same object, filled in anew each time."""


def _variance(noise: float) -> float:
    return max(noise * noise, _EXACT)


def _stamped(frame_id: str) -> dict[str, Any]:
    return {"stamp": 0, "frame_id": frame_id}


def _set_stamp(msg: Any, stamp_ns: int) -> None:
    stamp = msg.header.stamp
    stamp.sec, stamp.nanosec = divmod(stamp_ns, 10**9)


def _imu(sensors: Sensors) -> _Maker:
    """Orientation is not reported (REP-145: -1); gravity is on the axis that points up."""
    accel = gyro = _EXACT
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

    def make(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.linear_acceleration.x, msg.linear_acceleration.y, msg.angular_velocity.z = values
        return msg

    return make


def _odometry(sensors: Sensors) -> _Maker:
    o = sensors.odometry
    position, velocity = _variance(o.position_noise), _variance(o.velocity_noise)
    msg = message(
        ODOMETRY_TYPE,
        header=_stamped("odom"),
        child_frame_id="base_link",
        pose={"covariance": _planar(position, _variance(o.heading_noise))},
        twist={"covariance": _planar(velocity, _variance(o.yaw_rate_noise))},
    )
    place, turn = msg.pose.pose.position, msg.pose.pose.orientation
    linear, angular = msg.twist.twist.linear, msg.twist.twist.angular
    turn.x = turn.y = 0.0

    def make(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        linear.x, linear.y, angular.z, place.x, place.y, heading = values
        turn.z, turn.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
        return msg

    return make


def _command(_: Sensors) -> _Maker:
    """Joint `drive`: effort, the torque of all wheels; joint `steer`: position, their angle."""
    msg = message(
        COMMAND_TYPES["joint_state"],
        header=_stamped("base_link"),
        name=["drive", "steer"],
        position=[math.nan, math.nan],
        velocity=[math.nan, math.nan],
        effort=[math.nan, math.nan],
    )

    def make(stamp_ns: int, values: list[float]) -> Any:
        _set_stamp(msg, stamp_ns)
        msg.effort[0], msg.position[1] = values
        return msg

    return make


def _diagonal(size: int, entries: dict[int, float]) -> FloatArray:
    matrix = np.zeros(size * size)
    for i, value in entries.items():
        matrix[i * (size + 1)] = value
    return matrix


def _planar(linear: float, yaw: float) -> FloatArray:
    """Return the (36,) covariance of x, y and yaw; the other axes are not estimated."""
    unknown = dict.fromkeys((2, 3, 4), _UNKNOWN)
    return _diagonal(6, {0: linear, 1: linear, 5: yaw, **unknown})


_MAKERS = {Source.IMU: _imu, Source.ODOMETRY: _odometry, Source.COMMAND: _command}


def _messages(
    drive: SimulatedDrive, source: Source, sensors: Sensors
) -> Iterator[tuple[int, str, Any]]:
    make = _MAKERS[source](sensors)
    topic = TOPICS[source][0]
    stream = drive.streams[source]
    order = np.argsort(stream.log_ns, kind="stable")
    for log_ns, stamp_ns, values in zip(
        stream.log_ns[order].tolist(),
        stream.stamp_ns[order].tolist(),
        stream.values[order].tolist(),
        strict=True,
    ):
        yield log_ns, topic, make(stamp_ns, values)


def write_bag(
    drive: SimulatedDrive,
    path: Path | str,
    storage: str = "mcap",
    compression: str | None = None,
    progress: Progress | None = None,
) -> None:
    """
    Write what the sensors of `drive` sent, in order of arrival, as a rosbag2 folder at `path`.

    Topics `/imu/data`, `/odometry`, `/vehicle/command`; frames `imu_link` and `odom -> base_link`,
    both at the centre of gravity. `progress` is called with (messages written, messages in all)
    every 2000 messages. `storage` and `compression` as in `BagWriter`, which also says
    what raises `UsageError`.
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
