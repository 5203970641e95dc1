# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read the channels of a bag at the stamps of their messages."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adk_ros.bags import Bag
from adk_ros.bags.auxiliary_topics import auxiliary_topics, stamp_ns_of
from adk_ros.bags.recording import Progress, RecordingOptions, RecordingReader
from adk_ros.importing.absent_command import with_absent_command
from adk_ros.importing.channels import CHANNELS, COMMAND, IMU, ODOMETRY
from adk_ros.importing.map_file import ChannelMap
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.signals.channels import Source
from adk_ros.signals.commands import is_torque_estimated
from adk_ros.signals.decode import MAX_VARIANCE, SensorConfig
from adk_ros.signals.frames import pose_of, rotation
from adk_ros.signals.velocity_messages import ODOMETRY as ODOMETRY_MESSAGE

_OF_SOURCE = {
    Source.IMU: (IMU, ("a_x", "a_y", "yaw_rate")),
    Source.ODOMETRY: (ODOMETRY, ("v_x", "v_y", "odometry_yaw_rate")),
    Source.COMMAND: (COMMAND, ("torque", "delta")),
    Source.STEERING: ("steering", ("delta",)),
}


class BagChannels(NamedTuple):
    """
    The channels of a bag, by stream; `warnings` of the bag; `start_ns`: its first log time.

    The channels of a stream share their stamps, apart from values that a message does not report.
    """

    streams: dict[str, list[SourceChannel]]
    warnings: list[str]
    start_ns: int

    @property
    def channels(self) -> list[SourceChannel]:
        """The channels of all streams."""
        return [channel for stream in self.streams.values() for channel in stream]


def read_bag_channels(
    path: Path, options: RecordingOptions | None = None, progress: Progress | None = None
) -> BagChannels:
    """
    Return the channels of IMU, odometry and command, and those that `adk import` stores.

    IMU, odometry and command are decoded as training and replay do. Values that a message marks
    as not measured are absent, and so are commands that the bag lacks.

    :raises UsageError, DataError: the bag cannot be read, or lacks odometry.
    """
    rows: dict[str, list[tuple[int, dict[str, float]]]] = {}
    with Bag(path) as bag:
        chosen = with_absent_command(bag, options or RecordingOptions())
        reader = RecordingReader(bag, chosen, progress)
        for reading, msg in reader.readings_with_messages():
            stream, names = _OF_SOURCE[reading.source]
            values = dict(zip(names, reading.values, strict=True))
            if (
                reading.source is Source.ODOMETRY
                and chosen.sensors.odometry_type != ODOMETRY_MESSAGE
            ):
                # Wheel speeds or a velocity over ground: the yaw rate is the gyro's.
                values = {"v_x": values["v_x"]}
            elif reading.source is Source.ODOMETRY:
                values = _without_unmeasured(values, msg) | _pose(msg, reader.sensors)
            elif reading.source is Source.IMU:
                values |= _imu_rest(msg, reader.sensors)
            elif reading.source is Source.COMMAND and is_torque_estimated(msg):
                values["torque_estimated"] = values.pop("torque")
            rows.setdefault(stream, []).append((reading.stamp_ns, values))
        others = auxiliary_topics(bag.topics)
        for topic, log_ns, msg in bag.messages(others) if others else ():
            names = others[topic].channels
            stream = names[0] if len(names) == 1 else topic.strip("/").replace("/", "_")
            values = dict(zip(names, others[topic].values(msg), strict=True))
            rows.setdefault(stream, []).append((stamp_ns_of(msg, log_ns), values))
        warnings, start_ns = reader.warnings(), bag.start_ns
    streams = {stream: _channels(path, stream, found) for stream, found in rows.items()}
    return BagChannels({k: v for k, v in streams.items() if v}, warnings, start_ns)


def _channels(
    path: Path, stream: str, rows: list[tuple[int, dict[str, float]]]
) -> list[SourceChannel]:
    """Return the columns of a stream; of equal stamps the first is kept."""
    stamps, first = np.unique(np.array([stamp for stamp, _ in rows]), return_index=True)
    kept = [rows[i][1] for i in first.tolist()]
    names = [name for name in CHANNELS if any(name in values for values in kept)]
    out = []
    for name in names:
        column = np.array([values.get(name, math.nan) for values in kept], dtype=np.float64)
        known = np.isfinite(column)
        if known.any():
            entry = ChannelMap(column=name, unit=CHANNELS[name].unit)
            out.append(
                SourceChannel(
                    name,
                    f"{path.name}: {stream}",
                    name,
                    entry,
                    1.0,
                    stamps[known],
                    column[known],
                    0,
                    0,
                    len(rows) - stamps.shape[0],
                )
            )
    return out


def _without_unmeasured(values: dict[str, float], msg: Any) -> dict[str, float]:
    covariance = msg.twist.covariance
    index = {"v_x": 0, "v_y": 7, "odometry_yaw_rate": 35}
    return {name: x for name, x in values.items() if covariance[index[name]] < MAX_VARIANCE}


def _pose(msg: Any, sensors: SensorConfig) -> dict[str, float]:
    """Return the position that an odometry message reports, and the heading of the vehicle."""
    x, y, heading = pose_of(msg, sensors.odometry_rotation)
    values = {"x": (x, 0), "y": (y, 7), "z": (msg.pose.pose.position.z, 14)}
    values["heading"] = (heading, 35)
    covariance = msg.pose.covariance
    found = {name: float(x) for name, (x, i) in values.items() if covariance[i] < MAX_VARIANCE}
    # Planar odometry has no height, whatever its covariance says.
    return {name: x for name, x in found.items() if name != "z" or x != 0.0}


def _imu_rest(msg: Any, sensors: SensorConfig) -> dict[str, float]:
    """
    Return what an IMU message reports besides the channels of training and replay.

    In the axes of the vehicle and in SI units, as those are decoded.
    """
    forces, rates = msg.linear_acceleration_covariance, msg.angular_velocity_covariance
    turn = rotation(*sensors.imu_rotation)
    force, rate = (
        (float(v.x), float(v.y), float(v.z))
        for v in (msg.linear_acceleration, msg.angular_velocity)
    )
    values = {}
    if forces[0] != -1.0 and forces[8] < MAX_VARIANCE:
        values["a_z"] = float(turn[2] @ force) / sensors.accelerometer_scale
    turned = turn @ rate / sensors.gyro_scale
    for name, x, variance in (
        ("roll_rate", turned[0], rates[0]),
        ("pitch_rate", turned[1], rates[4]),
    ):
        # Planar simulations write zeros.
        if variance < MAX_VARIANCE and any(rate[:2]):
            values[name] = float(x)
    q = msg.orientation
    if msg.orientation_covariance[0] != -1.0:
        # The world's vertical in the axes of the vehicle.
        up = turn @ (
            2.0 * (q.x * q.z - q.w * q.y),
            2.0 * (q.y * q.z + q.w * q.x),
            1.0 - 2.0 * (q.x**2 + q.y**2),
        )
        values["roll"] = math.atan2(up[1], up[2])
        values["pitch"] = -math.asin(max(-1.0, min(1.0, up[0])))
    return values
