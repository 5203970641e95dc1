# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of simulated drives with the auxiliary topics that `adk import` writes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.auxiliary_topics import (
    AUXILIARY_TOPICS,
    GPS_VELOCITY,
    NUMBER,
    TWIST,
    WHEEL_TOPICS,
)
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.scenario.sensors import Sensors, Wheels
from adk_ros.plant.scenario.simulate import simulate

JOINTS = "/vehicle/wheels"
"""Topic of the simulated wheel speeds, joint states."""


@lru_cache
def drive_with_wheels(scenario: str = "town", seconds: float = 60.0) -> SimulatedDrive:
    """Return a drive with the sensors of the four wheels."""
    loaded = load_scenario(scenario)
    sensors = Sensors(wheels=Wheels())
    return simulate(loaded.model_copy(update={"sensors": sensors}), duration_s=seconds)


def with_auxiliary_topics(
    drive: SimulatedDrive,
    path: Path,
    *,
    without: Collection[str] = (),
    wheels: Mapping[str, float] | None = None,
    gps_factor: float = 0.0,
    gps_delay_s: float = 0.0,
    gps_noise: float = 0.05,
    v_x_factor: float = 1.0,
    has_pedals: bool = False,
    keeps_joints: bool = False,
) -> Path:
    """
    Write a drive as a bag and return its path.

    :param without: topics to leave out. :param wheels: factor of the speed of each wheel, each in
        a separate topic in place of the joints; default: all, with factor 1.
    :param gps_factor: of the speed of a receiver at 10 Hz, east and north; 0: no receiver.
    :param gps_delay_s: by which it is late. :param v_x_factor: of odometry's velocity.
    :param has_pedals: throttle and brake pressure in proportion to the torque, in its place.
    :param keeps_joints: leave the wheel speeds joints.
    """
    factors = dict.fromkeys(("front_left", "front_right", "rear_left", "rear_right"), 1.0)
    factors = factors if wheels is None else dict(wheels)
    whole = path.parent / f"{path.name}_whole"
    write_bag(drive, whole)
    events: list[tuple[int, str, Any]] = []
    with Bag(whole) as bag:
        kinds = {topic.name: topic.msgtype for topic in bag.topics}
        for topic, log_ns, msg in bag.messages(list(kinds)):
            if topic == JOINTS and not keeps_joints:
                speeds = dict(zip(msg.name, msg.velocity, strict=True))
                for wheel, factor in factors.items():
                    header = {"stamp": log_ns, "frame_id": f"wheel_{wheel}"}
                    turning = {"angular": {"y": factor * float(speeds[wheel])}}
                    events.append((log_ns, wheel, message(TWIST, header=header, twist=turning)))
                    events[-1][2].header.stamp = msg.header.stamp
                continue
            if topic == "/odometry":
                twist = msg.twist.twist
                twist.linear.x, twist.linear.y = (
                    v_x_factor * v for v in (twist.linear.x, twist.linear.y)
                )
            if topic == "/vehicle/command" and has_pedals:
                events += _pedals(log_ns, float(msg.effort[0]))
                msg.effort = np.zeros_like(msg.effort)
            if topic not in without:
                events.append((log_ns, topic, msg))
    if gps_factor:
        events += _receiver(drive, gps_factor, gps_delay_s, gps_noise)
    named = {at: name for at, name in WHEEL_TOPICS.items() if at in factors}
    with BagWriter(path) as writer:
        for name in {named.get(topic, topic) for _, topic, _ in events}:
            known = AUXILIARY_TOPICS.get(name)
            writer.add_topic(name, kinds[name] if known is None else known.msgtype)
        for log_ns, topic, msg in sorted(events, key=lambda event: event[0]):
            writer.write(named.get(topic, topic), msg, log_ns)
    return path


def _receiver(
    drive: SimulatedDrive, factor: float, delay_s: float, noise: float
) -> list[tuple[int, str, Any]]:
    random = np.random.default_rng(3)
    at_s = drive.stamp_ns * 1e-9
    speed = np.hypot(drive.x[:, 0], drive.x[:, 1])
    out = []
    for stamp_ns in range(int(drive.stamp_ns[0]), int(drive.stamp_ns[-1]), 100_000_000):
        now = float(np.interp(stamp_ns * 1e-9 - delay_s, at_s, speed))
        value = factor * now + noise * random.standard_normal()
        header = {"stamp": stamp_ns, "frame_id": "enu"}
        msg = message(TWIST, header=header, twist={"linear": {"x": 0.6 * value, "y": 0.8 * value}})
        out.append((stamp_ns, GPS_VELOCITY, msg))
    return out


def _pedals(log_ns: int, torque: float) -> list[tuple[int, str, Any]]:
    throttle = message(NUMBER, data=max(torque, 0.0) / 3000.0)
    pressure = AUXILIARY_TOPICS["/vehicle/brake_pressure"]
    header = {"stamp": log_ns, "frame_id": "brake"}
    brake = message(pressure.msgtype, header=header, fluid_pressure=max(-torque, 0.0) * 1e3)
    return [(log_ns, "/vehicle/throttle", throttle), (log_ns, pressure.name, brake)]
