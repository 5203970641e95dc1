# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read a bag into a `SensorLog`: each stream decoded at its native rate, without alignment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import Bag
from adk_ros.bags.recording import Progress, RecordingOptions, RecordingReader
from adk_ros.calibration.attitude import attitude_of, attitude_row
from adk_ros.errors import DataError
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import STANDARD_SOURCES, Source
from adk_ros.signals.commands import COMMAND_TYPES, is_torque_estimated
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.frames import pose_of, rotation

_MIN_MESSAGES = 10
"""Usable messages that each required stream must have: enough to estimate its rate and noise."""


def read_sensor_log(
    path: Path | str,
    options: RecordingOptions | None = None,
    progress: Progress | None = None,
    needs_imu: bool = True,
) -> SensorLog:
    """
    Read a bag into a sensor log.

    Topics, decoding and refusals are those of `bags.recording.read_recording`. A measured
    road-wheel angle replaces the commanded one, as in a record. Without an IMU its arrays are
    empty; where no command is read, it is zeros at the stamps of odometry, as in a record.

    :raises UsageError: the bag cannot be read, or a named topic does not fit.
    :raises DataError: a required stream has too few usable messages, or there is no IMU although
        `needs_imu`.
    """
    options = options or RecordingOptions()
    stamps: dict[Source, list[int]] = {source: [] for source in Source}
    rows: dict[Source, list[tuple[float, ...]]] = {source: [] for source in Source}
    poses: list[tuple[float, float, float]] = []
    attitudes: dict[Source, list[list[float]]] = {Source.IMU: [], Source.ODOMETRY: []}
    is_inferred = COMMAND_TYPES[options.sensors.command_type].inferred_torque
    with Bag(path) as bag:
        reader = RecordingReader(bag, options, progress)
        if reader.topics.imu is None and needs_imu:
            raise DataError(
                f"bag {bag.path}: no IMU: forces cannot be distinguished from gravity without "
                "accelerations; record sensor_msgs/msg/Imu as well, or analyse the recording from "
                "odometry alone with --without-imu"
            )
        for reading, msg in reader.readings_with_messages():
            if reading.source in attitudes and _has_attitude(msg):
                attitudes[reading.source].append(attitude_row(msg))
            stamps[reading.source].append(reading.stamp_ns)
            rows[reading.source].append(reading.values)
            if reading.source is Source.ODOMETRY:
                poses.append(pose_of(msg, options.sensors.odometry_rotation))
            elif reading.source is Source.COMMAND:
                is_inferred = is_inferred or is_torque_estimated(msg)
        start_ns = bag.start_ns
        warnings = tuple(reader.warnings())
        measures_v_y, sensors = reader.measures_v_y, reader.sensors
    has_command = reader.topics.command is not None
    if not has_command:
        stamps[Source.COMMAND] = stamps[Source.ODOMETRY]
        rows[Source.COMMAND] = [(0.0, 0.0)] * len(stamps[Source.ODOMETRY])
    for source in STANDARD_SOURCES:
        if len(stamps[source]) < _MIN_MESSAGES and (source is not Source.IMU or needs_imu):
            reasons = "; ".join(reader.refusals(source))
            raise DataError(
                f"bag {path}: {len(stamps[source])} usable {source.name.lower()} messages"
                f"{f' ({reasons})' if reasons else ''}: at least {_MIN_MESSAGES} are needed; "
                "record the topic for the whole recording"
            )
    imu_s, imu_values = _by_time(stamps[Source.IMU], rows[Source.IMU], start_ns)
    odometry_s, velocities = _by_time(stamps[Source.ODOMETRY], rows[Source.ODOMETRY], start_ns)
    _, pose = _by_time(stamps[Source.ODOMETRY], poses, start_ns)
    command_s, commands = _with_measured_steering(
        _by_time(stamps[Source.COMMAND], rows[Source.COMMAND], start_ns),
        _by_time(stamps[Source.STEERING], rows[Source.STEERING], start_ns),
    )
    pose[:, 2] = np.unwrap(pose[:, 2])
    if not np.isfinite(imu_values).all():
        raise DataError(f"bag {path}: {reader.topics.imu} reports no accelerations")
    attitude_s, attitude = _attitude(attitudes, sensors, start_ns)
    duration = max(odometry_s[-1], command_s[-1], *imu_s[-1:])
    return SensorLog(
        name=Path(path).name,
        duration_s=float(duration),
        imu_s=imu_s,
        imu=imu_values,
        odometry_s=odometry_s,
        odometry=velocities,
        pose=pose,
        command_s=command_s,
        command=commands,
        start_ns=start_ns,
        torque_is_inferred=is_inferred,
        warnings=warnings,
        extrinsics=reader.extrinsics,
        sensors=sensors,
        measures_v_y=measures_v_y,
        has_command=has_command,
        attitude_s=attitude_s,
        attitude=attitude,
    )


def _has_attitude(msg: Any) -> bool:
    return hasattr(msg, "orientation") or hasattr(msg, "pose")


def _attitude(
    rows: dict[Source, list[list[float]]], sensors: SensorConfig, start_ns: int
) -> tuple[FloatArray, FloatArray]:
    """Return roll and pitch (a, 2) by the IMU, else by odometry, at times (a,); empty without."""
    mountings = {
        Source.IMU: rotation(*sensors.imu_rotation),
        Source.ODOMETRY: rotation(0.0, 0.0, sensors.odometry_rotation),
    }
    for source, mounting in mountings.items():
        table = np.array(rows[source], dtype=np.float64)
        if table.shape[0] < _MIN_MESSAGES or not np.isfinite(table).all(axis=1).any():
            continue
        table = table[np.unique(table[:, 0], return_index=True)[1]]
        found = attitude_of(table[:, 0] - 1e-9 * start_ns, table[:, 1:], mounting)
        if found is not None:
            return found.at_s, np.column_stack([found["roll"], found["pitch"]])
    return np.empty(0), np.empty((0, 2))


def _by_time(stamps: list[int], rows: list[Any], start_ns: int) -> tuple[FloatArray, FloatArray]:
    """Return times in s from `start_ns` and values, sorted; of equal stamps the first is kept."""
    if not stamps:
        return np.empty(0), np.empty((0, 3))
    unique, first = np.unique(np.array(stamps, dtype=np.int64), return_index=True)
    seconds = np.asarray((unique - start_ns) * 1e-9, dtype=np.float64)
    return seconds, np.array(rows, dtype=np.float64)[first]


def _with_measured_steering(
    commands: tuple[FloatArray, FloatArray], steering: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """
    Return the command stream with the measured road-wheel angle in place of the commanded one.

    Both streams are zero-order holds, so the result has a row at each stamp of either from the
    first command on. Before the first measurement the commanded angle stays (`signals.align`).
    """
    command_s, command = commands
    steering_s, angle = steering
    if not steering_s.size:
        return commands
    times = np.union1d(command_s, steering_s[steering_s >= command_s[0]])
    merged = command[np.searchsorted(command_s, times, side="right") - 1]
    latest = np.searchsorted(steering_s, times, side="right") - 1
    merged[latest >= 0, 1] = angle[latest[latest >= 0], 0]
    return times, merged
