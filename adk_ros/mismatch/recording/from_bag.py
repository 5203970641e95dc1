# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as evidence: its streams decoded at their own rates, none of them aligned."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import Bag, find_topics
from adk_ros.errors import DataError
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STANDARD_SOURCES, Source
from adk_ros.signals.decode import Decoder, RefusedMessage, SensorConfig

Progress = Callable[[int, int], None]


def _pose(msg: Any) -> tuple[float, float, float]:
    place, turn = msg.pose.pose.position, msg.pose.pose.orientation
    heading = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)
    )
    return float(place.x), float(place.y), heading


def _ordered(stamps: list[int], rows: list[Any], start_ns: int) -> tuple[FloatArray, FloatArray]:
    """Times in s and values, by stamp; of those with the same stamp the first."""
    if not stamps:
        return np.empty(0), np.empty((0, 3))
    at, first = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
    seconds = np.asarray((at - start_ns) * 1e-9, dtype=np.float64)
    return seconds, np.array(rows, dtype=np.float64)[first]


def read_sensor_log(
    path: Path | str,
    imu: str | None = None,
    odometry: str | None = None,
    command: str | None = None,
    sensors: SensorConfig | None = None,
    progress: Progress | None = None,
    needs_imu: bool = True,
) -> SensorLog:
    """
    Read a bag.

    Topics are found by type unless named. Raises `UsageError` and `DataError` as the bag reader
    does, and `DataError` where a stream has nothing that can be used, or where there is no IMU but
    one is needed; without one its streams are empty.
    """
    decoder = Decoder(sensors or SensorConfig())
    with Bag(path) as bag:
        topics = find_topics(bag, imu, odometry, command)
        if topics.imu is None and needs_imu:
            raise DataError(
                f"bag {bag.path}: no IMU: forces cannot be told from gravity without its "
                "accelerations; record sensor_msgs/msg/Imu as well, or have a recording judged by "
                "odometry alone with --without-imu"
            )
        source_of = {topics.odometry: Source.ODOMETRY, topics.command: Source.COMMAND}
        if topics.imu is not None:
            source_of[topics.imu] = Source.IMU
        total = sum(info.count for info in bag.topics if info.name in source_of)
        stamps: dict[Source, list[int]] = {source: [] for source in STANDARD_SOURCES}
        rows: dict[Source, list[Any]] = {source: [] for source in STANDARD_SOURCES}
        poses: list[tuple[float, float, float]] = []
        for done, (topic, _, msg) in enumerate(bag.messages(source_of), start=1):
            if progress is not None and (done % 2000 == 0 or done == total):
                progress(done, total)
            source = source_of[topic]
            try:
                reading = decoder.decode(source, msg)
            except RefusedMessage:
                continue
            stamps[source].append(reading.stamp_ns)
            rows[source].append(reading.values)
            if source is Source.ODOMETRY:
                poses.append(_pose(msg))
        start_ns = bag.start_ns
    for source, found in stamps.items():
        if len(found) < 10 and (source is not Source.IMU or needs_imu):
            why = "; ".join(f"{n} times {text}" for (_, text), n in decoder.refused.items())
            raise DataError(
                f"bag {path}: {len(found)} usable {source.name.lower()} messages"
                f"{f' ({why})' if why else ''}: record all of the drive"
            )
    imu_s, imu_values = _ordered(stamps[Source.IMU], rows[Source.IMU], start_ns)
    odometry_s, velocities = _ordered(stamps[Source.ODOMETRY], rows[Source.ODOMETRY], start_ns)
    _, pose = _ordered(stamps[Source.ODOMETRY], poses, start_ns)
    command_s, commands = _ordered(stamps[Source.COMMAND], rows[Source.COMMAND], start_ns)
    pose[:, 2] = np.unwrap(pose[:, 2])
    if not np.isfinite(imu_values).all():
        raise DataError(f"bag {path}: {topics.imu} reports no accelerations")
    duration = max(odometry_s[-1], command_s[-1], *imu_s[-1:])
    return SensorLog(
        Path(path).name,
        float(duration),
        imu_s,
        imu_values,
        odometry_s,
        velocities,
        pose,
        command_s,
        commands,
        start_ns,
    )
