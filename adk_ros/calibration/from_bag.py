# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Read a bag into `Streams`: all axes, nothing refused for its sign, unit or joint names.

The decoder of the other verbs refuses messages that it cannot use, such as a hand-wheel angle in
degrees. Here they are what is to be found, so the fields are read as they stand; only the sensor
configuration that is already known (`--params`, `/tf_static`) is applied.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import COMMAND_TYPES, IMU_TYPE, Bag
from adk_ros.bags.auxiliary_topics import auxiliary_topics
from adk_ros.bags.axle_speed import AxleSpeed
from adk_ros.bags.recording import Progress, RecordingOptions
from adk_ros.bags.topics import ODOMETRY_TYPES
from adk_ros.calibration.attitude import attitude_row, recorded_attitude
from adk_ros.calibration.auxiliary_streams import READ_TOPICS, AuxiliaryRows, fix_topic
from adk_ros.calibration.joints import JointTable
from adk_ros.calibration.known_errors import without_known_errors
from adk_ros.calibration.messages import (
    height_row,
    imu_row,
    odometry_row,
    request_row,
    stamp_s,
    velocity_row,
)
from adk_ros.calibration.stream_table import stream_of, usable_rows
from adk_ros.calibration.streams import (
    COMMAND_COLUMNS,
    IMU_COLUMNS,
    ODOMETRY_COLUMNS,
    Stream,
    Streams,
)
from adk_ros.calibration.topics import command_topic, optional_topic
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import MAX_VARIANCE, SensorConfig
from adk_ros.signals.extrinsics import (
    MSGTYPE,
    StaticTransforms,
    extrinsics_text,
    frame_of,
    wants_extrinsics,
    with_extrinsics,
)
from adk_ros.signals.frames import rotation
from adk_ros.signals.velocity_messages import ODOMETRY

_AUXILIARY = "auxiliary"
"""Role of the topics of `bags.auxiliary_topics`."""
_PROGRESS_INTERVAL = 2000


@dataclass(frozen=True)
class BagContent:
    """
    What a bag holds for the checks.

    `topics`: name by role (imu, odometry, command), None where absent. `sensors`: configuration
    that the streams were read with. `joints`: the joints of the command, if it has any.
    `command_type`: key of `signals.commands.COMMAND_TYPES`, "" without a command.
    """

    streams: Streams
    topics: dict[str, str | None]
    sensors: SensorConfig
    joints: JointTable
    command_type: str
    warnings: list[str]


class StreamReader:
    """
    Collects the streams of a bag from its messages; those that it lacks are None.

    `topics`: those whose messages it takes. Topics of single wheels come as their axle
    (`bags.axle_speed`).

    :param bag: open bag, of which the topics are chosen.
    :raises UsageError: a named topic is absent.
    :raises DataError: the bag has neither IMU, odometry nor command.
    """

    def __init__(self, bag: Bag, options: RecordingOptions) -> None:
        self._bag = bag
        self._notes: list[str] = []
        notes, sensors = self._notes, options.sensors
        imu = optional_topic(bag, "imu", options.imu if options.use_imu else "", IMU_TYPE, notes)
        velocity = ODOMETRY_TYPES[sensors.odometry_type]
        wheels = sensors.wheel_joints[:1]
        odometry = optional_topic(
            bag, "odometry", options.odometry, velocity, notes, wheels[0] if wheels else None
        )
        command, self._kind = command_topic(bag, options, notes)
        self._names = {"imu": imu, "odometry": odometry, "command": command}
        if not any(self._names.values()):
            raise DataError(
                f"bag {bag.path}: no IMU, odometry or command to check; it has {bag.summary()}"
            )
        self._sensors = _with_transforms(bag, sensors, imu, odometry, notes)
        self._rows = _Rows(self._kind, self._sensors)
        role_of = {name: role for role, name in self._names.items() if name is not None}
        role_of |= {
            x.name: "wheels"
            for x in bag.topics
            if x.msgtype == COMMAND_TYPES["joint_state"]
            and x.count
            and x.name not in (command, odometry)
        }
        role_of |= {
            name: _AUXILIARY
            for name in auxiliary_topics(bag.topics)
            if name in READ_TOPICS and name != odometry
        }
        fix = fix_topic(bag.topics)
        role_of |= {} if fix is None else {fix: _AUXILIARY}
        self._role_of = role_of | dict.fromkeys(options.wheels, "odometry")

    @property
    def topics(self) -> Collection[str]:
        """Names of the topics whose messages it takes."""
        return self._role_of

    def add(self, topic: str, log_ns: int, msg: Any) -> None:
        """Take a message; those of other topics are ignored."""
        role = self._role_of.get(topic)
        if role is not None:
            self._rows.add(role, topic, msg, log_ns)

    def content(self) -> BagContent:
        """Return what the messages up to now hold."""
        name, rows = self._bag.path.name, self._rows
        warnings = list(self._bag.warnings)
        if rows.refused:
            warnings.append(f"{name}: {rows.refused} messages lack expected fields: skipped")
        streams = _streams(rows, name, self._bag.duration_s, self._sensors, self._notes)
        return BagContent(streams, self._names, self._sensors, rows.joints, self._kind, warnings)


def read_streams(
    path: Path | str, options: RecordingOptions, progress: Progress | None = None
) -> BagContent:
    """
    Read the streams of a bag; those that it lacks are None.

    :raises UsageError: the bag does not exist, or a named topic is absent.
    :raises DataError: the bag is unreadable or empty, or has neither IMU, odometry nor command.
    """
    with Bag(path) as bag:
        reader = StreamReader(bag, options)
        wheels = (options.odometry or "", *options.wheels) if options.wheels else ()
        axle = AxleSpeed(wheels)
        total = sum(x.count for x in bag.topics if x.name in reader.topics)
        for done, (topic, log_ns, msg) in enumerate(bag.messages(reader.topics), start=1):
            joined = axle.add(topic, log_ns, msg) if topic in wheels else msg
            if joined is not None:
                reader.add(topic, log_ns, joined)
            if progress is not None and (done % _PROGRESS_INTERVAL == 0 or done == total):
                progress(done, total)
        return reader.content()


@dataclass
class _Rows:
    """Rows of numbers by role, joints of the command and of other topics, refused messages."""

    kind: str
    sensors: SensorConfig
    rows: dict[str, list[list[float]]] = field(
        default_factory=lambda: {"imu": [], "odometry": [], "command": []}
    )
    orientations: dict[str, list[list[float]]] = field(
        default_factory=lambda: {"imu": [], "odometry": []}
    )
    heights: list[list[float]] = field(default_factory=list)
    auxiliary: AuxiliaryRows = field(default_factory=AuxiliaryRows)
    joints: JointTable = field(default_factory=JointTable)
    others: dict[str, JointTable] = field(default_factory=dict)
    refused: int = 0
    unmeasured_rates: int = 0
    """Messages of odometry that mark their yaw rate as not measured."""

    def add(self, role: str, topic: str, msg: Any, log_ns: int) -> None:
        """Take over a message; one that lacks a field is counted."""
        # Untrusted messages: a field of another type must not end in a traceback.
        try:
            if role == _AUXILIARY:
                self.auxiliary.add(topic, msg, log_ns)
            elif role == "wheels":
                self.others.setdefault(topic, JointTable()).add(stamp_s(msg), msg)
            elif role == "command" and self.kind == "joint_state":
                self.joints.add(stamp_s(msg), msg)
            elif role == "odometry" and self.sensors.odometry_type != ODOMETRY:
                self.rows[role].append(velocity_row(msg, self.sensors))
            else:
                self.rows[role].append(_ROWS[role](msg))
                if role in self.orientations:
                    self.orientations[role].append(attitude_row(msg))
                if role == "odometry":
                    self.heights.append(height_row(msg))
                    self.unmeasured_rates += float(msg.twist.covariance[35]) >= MAX_VARIANCE
        except (AttributeError, TypeError, ValueError, IndexError, OverflowError):
            self.refused += 1


_ROWS = {"imu": imu_row, "odometry": odometry_row, "command": request_row}


def _with_transforms(
    bag: Bag, sensors: SensorConfig, imu: str | None, odometry: str | None, notes: list[str]
) -> SensorConfig:
    """Return the configuration with the pose of the IMU that the bag's `/tf_static` gives."""
    names = [x.name for x in bag.topics if x.msgtype == MSGTYPE and x.name.endswith("tf_static")]
    if not names or imu is None or odometry is None or not wants_extrinsics(sensors):
        return sensors
    transforms = StaticTransforms()
    try:
        for _, _, msg in bag.messages(names):
            transforms.add(msg)
    except DataError as error:
        notes.append(f"the pose of the IMU is not read: {error}")
        return sensors
    vehicle, frame = (
        next((frame_of(msg) for _, _, msg in bag.messages([topic])), "")
        for topic in (odometry, imu)
    )
    out = with_extrinsics(sensors, transforms, vehicle, frame)
    if out != sensors:
        notes.append(extrinsics_text(out))
    return out


def _streams(
    content: _Rows, name: str, seconds: float, sensors: SensorConfig, notes: list[str]
) -> Streams:
    rows, joints = content.rows, content.joints
    if content.kind == "joint_state":
        torque, steering = joints.drive_and_steer(sensors)
        rows["command"] = np.column_stack([joints.at_s, torque, steering]).tolist()
    tables = {role: usable_rows(rows[role], seconds) for role in rows}
    present = [table for table, _ in tables.values() if table.size]
    first = min((float(table[0, 0]) for table in present), default=0.0)
    imu = stream_of("the IMU", tables["imu"], IMU_COLUMNS, first)
    odometry = stream_of("odometry", tables["odometry"], ODOMETRY_COLUMNS, first)
    command = stream_of("the command", tables["command"], COMMAND_COLUMNS, first)
    if imu is not None and any(sensors.imu_rotation):
        imu = turned(imu, rotation(*sensors.imu_rotation))
    if imu is not None:
        imu = without_known_errors(imu, "imu", sensors)
    if odometry is not None:
        odometry = odometry.having(heading=np.unwrap(odometry["heading"]))
        odometry = without_known_errors(odometry, "odometry", sensors)
        if imu is not None and 2 * content.unmeasured_rates > len(rows["odometry"]):
            # That of the gyro, as `adk import` repeats it, is no second witness.
            unknown = np.full(odometry.at_s.size, np.nan)
            odometry = odometry.having(yaw_rate=unknown)
    if command is not None:
        command = without_known_errors(command, "command", sensors)
    wheels = {}
    for table in (joints, *content.others.values()):
        for joint, values in table.velocities().items():
            rows_of = np.column_stack([table.at_s, values]).tolist()
            stream = stream_of(joint, usable_rows(rows_of, seconds), ("velocity",), first)
            if stream is not None:
                wheels[joint] = stream
    others = content.auxiliary
    return Streams(
        name,
        seconds,
        imu,
        odometry,
        command,
        wheels,
        tuple(notes),
        recorded_attitude(content.orientations, seconds, sensors, first),
        others.pedals(seconds, first),
        others.wheels(seconds, first),
        others.gps_speed(seconds, first),
        others.gps_fix(seconds, first),
        others.heights(content.heights, seconds, first),
    )


def turned(imu: Stream, matrix: FloatArray) -> Stream:
    """Return an IMU stream with its vectors multiplied by `matrix` (3, 3)."""
    out: dict[str, FloatArray] = {}
    for names in (IMU_COLUMNS[:3], IMU_COLUMNS[3:]):
        rows = np.vstack([imu[name] for name in names])
        # A single axis that is not reported must not take the others along.
        vectors = matrix @ (rows if np.isnan(rows).all() else np.nan_to_num(rows))
        out |= dict(zip(names, vectors, strict=True))
    return replace(imu, columns={**imu.columns, **out})
