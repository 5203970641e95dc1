# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The topics of an import: which channels make up which message, and what is missing for it.

Topics and types of IMU, odometry and command are those of simulated recordings (`offline.export`),
the others those of `bags.auxiliary_topics`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adk_ros.bags import IMU_TYPE, ODOMETRY_TYPE
from adk_ros.bags.auxiliary_topics import (
    AUXILIARY_TOPICS,
    GPS_FIX,
    GPS_VELOCITY,
    PRESSURE,
    TWIST,
    topic_of,
)
from adk_ros.importing.channels import CHANNELS, COMMAND, IMU, ODOMETRY, is_wheel_speed
from adk_ros.importing.message_factories import (
    COMMAND_TYPE,
    Create,
    command,
    fix,
    ground_velocity,
    imu,
    numbers,
    odometry,
    pressures,
    rotation,
)
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import MessageStream, at_stamps, joined, with_optional

TOPICS = {
    IMU: ("/imu/data", IMU_TYPE),
    ODOMETRY: ("/odometry", ODOMETRY_TYPE),
    COMMAND: ("/vehicle/command", COMMAND_TYPE),
}
_IN_EVERY_IMU = ("a_x", "a_y", "yaw_rate")
_POSE = ("x", "y", "z", "heading")
"""Optional channels of odometry: training and replay read its velocities alone."""


@dataclass(frozen=True)
class Topic:
    """A topic of the import: its messages are `create` of each row of the stream."""

    name: str
    msgtype: str
    stream: MessageStream
    create: Create

    def messages(self) -> Iterator[tuple[int, str, Any]]:
        """Yield (stamp in ns, topic, message), in order of time."""
        names, gaps = list(self.stream.values), self.stream.unknown
        rows = np.column_stack([self.stream.values[name] for name in names]).tolist()
        for i, (stamp_ns, row) in enumerate(zip(self.stream.stamp_ns.tolist(), rows, strict=True)):
            unknown = [name for name, missing in gaps.items() if missing[i]]
            values = dict(zip(names, row, strict=True))
            yield stamp_ns, self.name, self.create(stamp_ns, values, unknown)


@dataclass
class Outcome:
    """The topics of an import, and by channel the reason why it is not imported."""

    topics: list[Topic]
    left_out: dict[str, str]


def topics_of(channels: Sequence[SourceChannel], notes: list[str]) -> Outcome:
    """Return the topics that the channels allow; lines on assumptions are added to `notes`."""
    by_name = {channel.name: channel for channel in channels}
    outcome = Outcome([], {})
    _add_imu(by_name, outcome, notes)
    _add_odometry(by_name, outcome, notes)
    _add_command(by_name, outcome, notes)
    _add_satellite(by_name, outcome, notes)
    for channel in channels:
        if not CHANNELS[channel.name].stream and channel.name not in _SATELLITE:
            stream = joined(channel.name, [channel], notes)
            outcome.topics.append(_single_topic(channel.name, stream))
    return outcome


def _add_imu(given: dict[str, SourceChannel], outcome: Outcome, notes: list[str]) -> None:
    names = [name for name in given if CHANNELS[name].stream == IMU]
    rate = given.get("yaw_rate") or given.get("odometry_yaw_rate")
    lacking = [name for name in ("a_x", "a_y") if name not in given]
    lacking += ["yaw_rate"] if rate is None else []
    if lacking:
        for name in set(names) - {"yaw_rate"}:
            outcome.left_out[name] = f"an IMU message also needs {', '.join(lacking)}"
        return
    if len({"roll", "pitch"} & set(names)) == 1:
        (single,) = {"roll", "pitch"} & set(names)
        outcome.left_out[single] = "an orientation needs roll and pitch"
        names.remove(single)
    order = [name for name in CHANNELS if name in names]
    stream = joined("imu", [given[name] for name in order if name in _IN_EVERY_IMU], notes)
    if "yaw_rate" not in given and rate is not None:
        stream = _with_channel("imu", stream, "yaw_rate", rate, "a_x", notes)
    optional = [given[name] for name in order if name not in _IN_EVERY_IMU]
    stream = with_optional("imu", stream, optional, "a_x", notes)
    outcome.topics.append(Topic(*TOPICS[IMU], stream, imu(set(stream.values))))


def _add_odometry(given: dict[str, SourceChannel], outcome: Outcome, notes: list[str]) -> None:
    names = [name for name in CHANNELS if name in given and CHANNELS[name].stream == ODOMETRY]
    has_imu = any(topic.msgtype == IMU_TYPE for topic in outcome.topics)
    if "v_x" not in given:
        for name in names:
            if name != "odometry_yaw_rate" or "a_x" not in given:
                outcome.left_out[name] = "an odometry message also needs v_x"
        if "yaw_rate" in given and not has_imu:
            outcome.left_out["yaw_rate"] = "needs v_x, or a_x and a_y"
        notes.append("no v_x: without odometry, nothing can be trained on or compared")
        return
    if len({"x", "y"} & set(names)) == 1:
        (single,) = {"x", "y"} & set(names)
        outcome.left_out[single] = "a position needs x and y"
        names.remove(single)
    stream = joined("odometry", [given[name] for name in names if name not in _POSE], notes)
    rate = given.get("odometry_yaw_rate")
    gyro = given.get("yaw_rate")
    measured = set(names)
    if rate is None and gyro is not None:
        stream = _with_channel("odometry", stream, "odometry_yaw_rate", gyro, "v_x", notes)
        if has_imu:
            # A copy that counts as measured would confirm every error of the gyro.
            notes.append("no yaw rate but the gyro's: marked as not measured in odometry")
        else:
            measured.add("odometry_yaw_rate")
    elif rate is None:
        notes.append("no yaw rate: written as 0 in odometry and marked as not measured")
    if not {"v_y", "v_y_estimated"} & set(given):
        notes.append("no v_y: written as 0 in odometry and marked as not measured")
    pose = [given[name] for name in names if name in _POSE]
    stream = with_optional("odometry", stream, pose, "v_x", notes)
    outcome.topics.append(Topic(*TOPICS[ODOMETRY], stream, odometry(measured)))


def _add_command(given: dict[str, SourceChannel], outcome: Outcome, notes: list[str]) -> None:
    names = [name for name in CHANNELS if name in given and CHANNELS[name].stream == COMMAND]
    if not names:
        notes.append(
            "no torque and no delta: without a command, predictions are in reduced scope, and "
            "nothing can be compared"
        )
        return
    if "delta" not in given:
        notes.append("no delta: written as 0 rad; nothing can be said about what steers the car")
    if names == ["delta"]:
        notes.append("no torque: written as 0 N m; nothing can be said about what drives the car")
    # Commands are held: at the stamps of the faster one, neither loses a value.
    names.sort(key=lambda name: -given[name].stamp_ns.shape[0])
    stream = joined("command", [given[name] for name in names], notes, hold=True)
    outcome.topics.append(Topic(*TOPICS[COMMAND], stream, command(set(names))))


_SATELLITE = tuple(x for at in (GPS_VELOCITY, GPS_FIX) for x in AUXILIARY_TOPICS[at].channels)


def _add_satellite(given: dict[str, SourceChannel], outcome: Outcome, notes: list[str]) -> None:
    if "gps_speed" in given and "gps_course" in given:
        names = ["gps_speed", "gps_course"]
        stream = joined("gps velocity", [given[name] for name in names], notes)
        outcome.topics.append(_auxiliary(GPS_VELOCITY, stream, ground_velocity()))
    elif "gps_speed" in given:
        stream = joined("gps_speed", [given["gps_speed"]], notes)
        outcome.topics.append(_single_topic("gps_speed", stream))
    elif "gps_course" in given:
        outcome.left_out["gps_course"] = "a velocity over ground also needs gps_speed"
    names = [name for name in ("latitude", "longitude", "altitude") if name in given]
    if {"latitude", "longitude"} <= set(names):
        stream = joined("gps fix", [given["latitude"], given["longitude"]], notes)
        altitude = [given["altitude"]] if "altitude" in given else []
        stream = with_optional("gps fix", stream, altitude, "latitude", notes)
        outcome.topics.append(_auxiliary(GPS_FIX, stream, fix()))
    else:
        for name in names:
            outcome.left_out[name] = "a fix needs latitude and longitude"


def _with_channel(
    name: str, stream: MessageStream, key: str, channel: SourceChannel, lead: str, notes: list[str]
) -> MessageStream:
    """Return a stream with one more channel, interpolated at its stamps; it is noted."""
    values, known = at_stamps(name, channel, stream.stamp_ns, lead, notes)
    if lost := int((~known).sum()):
        notes.append(f"{name}: {lost} of {len(stream)} stamps lie in gaps: skipped")
    columns = {other: column[known] for other, column in stream.values.items()}
    return MessageStream(stream.stamp_ns[known], columns | {key: values[known]})


def _single_topic(name: str, stream: MessageStream) -> Topic:
    """Return the topic of a channel that has a message of its own."""
    topic = topic_of(name)
    if topic.msgtype == TWIST:
        is_wheel = is_wheel_speed(name)
        frame = f"wheel_{name.removeprefix('wheel_speed_')}" if is_wheel else "motor"
        return _auxiliary(topic.name, stream, rotation(name, frame))
    if topic.msgtype == PRESSURE:
        return _auxiliary(topic.name, stream, pressures(name))
    return _auxiliary(topic.name, stream, numbers(name))


def _auxiliary(name: str, stream: MessageStream, create: Create) -> Topic:
    return Topic(name, AUXILIARY_TOPICS[name].msgtype, stream, create)
