# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Choose what the velocity of a bag is read from, where its odometry does not report one.

Wheel speeds come first: their radius is given, or identified against the speed or the positions
of a satellite receiver. Of two axles it is the undriven one, or the rear one where that is not
clear: its wheels do not steer. Driven wheels slip by more than the steering angle costs. Topics
of single wheels count as the mean of their axle. Without a radius, the speed over ground of the
receiver takes the place of wheel speeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import IMU_TYPE, ODOMETRY_TYPE, Bag
from adk_ros.bags.auxiliary_topics import AXLES, FIX, TWIST, WHEEL_POSITIONS
from adk_ros.bags.recording import RecordingOptions
from adk_ros.importing.channels import is_wheel_speed
from adk_ros.importing.column_names import wheel_position
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import MessageStream
from adk_ros.importing.velocity_choice import undriven_axle
from adk_ros.importing.wheel_radius import fit_radius, reference_of
from adk_ros.importing.wheel_velocity import axle_speed, computed_channel
from adk_ros.numerics.arrays import IntArray
from adk_ros.signals.frames import pose_of
from adk_ros.signals.velocity_messages import ODOMETRY, ODOMETRY_TYPES

_JOINTS = ODOMETRY_TYPES["wheel_joints"].msgtype
WHEEL_SPEED = "wheel_speed"
_WHEEL_TOPIC = f"/{WHEEL_SPEED}/"
"""Part of the name of a topic with the speed of a wheel or axle, as `adk import` writes it; a
namespace may come before it."""
_MIN_MESSAGES = 10
_MAX_SPEED = 1e3
"""rad/s or m/s; above the speed of any wheel or car."""


def with_velocity_source(
    path: Path | str, options: RecordingOptions
) -> tuple[RecordingOptions, str]:
    """
    Return the options with a source of v_x where odometry reports none, and a line on it.

    Unchanged, with an empty line, where odometry reports a velocity, where the options name
    another type than odometry, or where the bag has neither wheel speeds nor a satellite receiver.
    With the type `wheel_speed` and without a topic, as a model that was trained so stores it, the
    topics of the axle are chosen.

    :raises UsageError, DataError: the bag cannot be read.
    """
    sensors = options.sensors
    is_axle = sensors.odometry_type == WHEEL_SPEED and options.odometry is None
    if sensors.odometry_type != ODOMETRY and not is_axle:
        return options, ""
    with Bag(path) as bag:
        kinds = {topic.name: topic.msgtype for topic in bag.topics if topic.count}
        alternatives = [name for name, kind in kinds.items() if kind in (TWIST, _JOINTS)]
        if not alternatives:
            return options, ""
        if not is_axle and _has_velocity(bag, options.odometry, kinds):
            return options, ""
        others = [name for name, kind in kinds.items() if kind in (IMU_TYPE, ODOMETRY_TYPE, FIX)]
        found = _read(bag, [*alternatives, *others], kinds, sensors.steer_joint)
    chosen = _of_wheels(found, options) or _of_receiver(found, options)
    if chosen is None or (is_axle and chosen[0].sensors.odometry_type != WHEEL_SPEED):
        return options, ""
    changed, line = chosen
    reason = "" if is_axle else "odometry reports no velocity: "
    return changed, f"{Path(path).name}: {reason}{line}"


def _has_velocity(bag: Bag, odometry: str | None, kinds: dict[str, str]) -> bool:
    """Return whether a message of odometry has a velocity other than zero."""
    names = [
        name for name, kind in kinds.items() if kind == ODOMETRY_TYPE and odometry in (None, name)
    ]
    for _, _, msg in bag.messages(names) if names else ():
        v_x = float(msg.twist.twist.linear.x)
        if math.isfinite(v_x) and v_x != 0.0:
            return True
    return False


@dataclass
class _Found:
    """Channels by the names of `importing.channels`; topic and joint of each wheel; a receiver."""

    channels: dict[str, SourceChannel] = field(default_factory=dict)
    topic_of: dict[str, str] = field(default_factory=dict)
    joint_of: dict[str, str] = field(default_factory=dict)
    receiver: str = ""

    def add(self, name: str, source: str, rows: Iterable[tuple[int, float]]) -> bool:
        """Add a channel from (stamp, value), if it is measured and varies."""
        table = {at: value for at, value in rows if at > 0 and abs(value) < _MAX_SPEED * 1e6}
        stamps: IntArray = np.array(sorted(table), dtype=np.int64)
        values = np.array([table[at] for at in stamps.tolist()])
        if stamps.size < _MIN_MESSAGES or float(np.ptp(values)) == 0.0 or name in self.channels:
            return False
        self.channels[name] = computed_channel(name, source, MessageStream(stamps, {}), values)
        return True


def _read(bag: Bag, names: list[str], kinds: dict[str, str], steer_joint: str) -> _Found:
    joints: dict[tuple[str, str], list[tuple[int, float]]] = {}
    twists: dict[str, list[tuple[int, float, float]]] = {}
    rows: dict[str, list[tuple[int, float]]] = {}
    for topic, _, msg in bag.messages(names):
        try:
            _take(topic, kinds[topic], msg, (joints, twists, rows))
        except (AttributeError, TypeError, ValueError, IndexError):
            # A message of a stranger that lacks a field says nothing.
            continue
    found = _Found()
    for (topic, joint), values in joints.items():
        wheel = wheel_position(joint)
        name = f"wheel_speed_{wheel}"
        if wheel and joint != steer_joint and found.add(name, joint, values):
            found.topic_of[name], found.joint_of[name] = topic, joint
    for topic, pairs in twists.items():
        if _WHEEL_TOPIC in topic:
            position = topic.rsplit("/", 1)[-1]
            name = f"wheel_speed_{position}"
            speeds = [(at, spin) for at, _, spin in pairs]
            if position in WHEEL_POSITIONS and found.add(name, topic, speeds):
                found.topic_of[name] = topic
        elif found.add("gps_speed", topic, [(at, speed) for at, speed, _ in pairs]):
            found.receiver = topic
    for name, values in rows.items():
        found.add(name, name, values)
    return found


def _take(topic: str, kind: str, msg: Any, into: tuple[Any, Any, Any]) -> None:
    """Add the values of a message to the rows of joints, twists and other channels."""
    joints, twists, rows = into
    stamp_ns = int(msg.header.stamp.sec) * 10**9 + int(msg.header.stamp.nanosec)
    if kind == _JOINTS:
        for joint, velocity in zip(msg.name, msg.velocity, strict=False):
            if math.isfinite(velocity):
                joints.setdefault((topic, str(joint)), []).append((stamp_ns, float(velocity)))
    elif kind == TWIST:
        linear = msg.twist.linear
        speed = math.hypot(float(linear.x), float(linear.y))
        spin = float(msg.twist.angular.y)
        twists.setdefault(topic, []).append((stamp_ns, speed, spin))
    elif kind == FIX:
        rows.setdefault("latitude", []).append((stamp_ns, float(msg.latitude)))
        rows.setdefault("longitude", []).append((stamp_ns, float(msg.longitude)))
    elif kind == IMU_TYPE:
        rows.setdefault("yaw_rate", []).append((stamp_ns, float(msg.angular_velocity.z)))
    else:
        for name, value in zip(("x", "y", "heading"), pose_of(msg), strict=True):
            rows.setdefault(name, []).append((stamp_ns, value))


def _of_wheels(found: _Found, options: RecordingOptions) -> tuple[RecordingOptions, str] | None:
    """Return the options for wheel speeds; None without them, or without their radius."""
    given = found.channels
    wheels = [name for name in given if is_wheel_speed(name)]
    if not wheels:
        return None
    axle, reason = undriven_axle(given)
    if axle == "all":
        # The steering angle of front wheels is not removed when a message is read.
        axle = "rear"
    rolling = axle_speed(given, axle, [])
    radius, text = options.sensors.wheel_radius, ""
    if radius > 0.0:
        text = f"wheel radius {radius:g} m"
    else:
        reference = reference_of(given)
        fit = None
        if reference is not None:
            fit = fit_radius(rolling.stream.stamp_ns, rolling.rate, reference)
        if fit is None:
            return None
        radius, text = float(round(fit.radius.value, 5)), f"wheel radius {fit.text}"
    names = rolling.names
    joints = tuple(found.joint_of[name] for name in names if name in found.joint_of)
    kind = "wheel_joints" if joints else WHEEL_SPEED
    changes: dict[str, Any] = {"odometry_type": kind, "wheel_radius": radius}
    if joints:
        changes["wheel_joints"] = joints
    topics = [found.topic_of[name] for name in names if not joints or name in found.joint_of]
    source = f"{', '.join(joints)} of {topics[0]}" if joints else ", ".join(topics)
    if not joints and len(names) == 1 and not names[0].endswith(tuple(AXLES)):
        text += "; of one wheel: in bends v_x is off by half the track times the yaw rate"
    line = f"v_x from {source} ({reason}); {text}"
    sensors = replace(options.sensors, **changes)
    further = () if joints else tuple(topics[1:])
    return replace(options, odometry=topics[0], sensors=sensors, wheels=further), line


def _of_receiver(found: _Found, options: RecordingOptions) -> tuple[RecordingOptions, str] | None:
    if not found.receiver:
        return None
    sensors = replace(options.sensors, odometry_type="ground_velocity")
    line = f"v_x is the speed over ground of {found.receiver}"
    return replace(options, odometry=found.receiver, sensors=sensors), line
