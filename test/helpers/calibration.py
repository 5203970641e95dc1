# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives as streams, and the faults of sensors and steering to inject into them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bags import COMMAND_TYPES, IMU_TYPE, ODOMETRY_TYPE, BagWriter, message
from adk_ros.calibration.check import CheckResult, check
from adk_ros.calibration.from_bag import BagContent, turned
from adk_ros.calibration.joints import JointTable
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, load_vehicle
from adk_ros.signals.channels import Source
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.frames import rotation
from helpers.bags import START_NS

VEHICLE: Dimensions = load_vehicle("imdv")
WHEELBASE = VEHICLE.cg_to_front_axle + VEHICLE.cg_to_rear_axle
Fault = Callable[[Streams], Streams]


@lru_cache(maxsize=8)
def driven(scenario: str = "handling", seed: int = 1, seconds: float = 200.0) -> Streams:
    """Return the streams of a simulated drive; gravity and noise on the IMU's other axes."""
    drive = simulate(load_scenario(scenario), seed, seconds)
    start = min(int(stream.stamp_ns[0]) for stream in drive.streams.values())
    imu, odometry, command = (
        drive.streams[source] for source in (Source.IMU, Source.ODOMETRY, Source.COMMAND)
    )

    def at(stamps: np.ndarray) -> FloatArray:
        return np.asarray((stamps - start) * 1e-9)

    rng = np.random.default_rng(seed)
    n = imu.stamp_ns.size
    a_z = GRAVITY + 0.05 * rng.standard_normal(n)
    w_x, w_y = 0.002 * rng.standard_normal((2, n))
    a_x, a_y, w_z = imu.values.T
    return Streams(
        "drive",
        seconds,
        Stream(
            "the IMU",
            at(imu.stamp_ns),
            {"a_x": a_x, "a_y": a_y, "a_z": a_z, "w_x": w_x, "w_y": w_y, "w_z": w_z},
        ),
        Stream(
            "odometry",
            at(odometry.stamp_ns),
            dict(
                zip(
                    ("v_x", "v_y", "yaw_rate", "x", "y", "heading"),
                    (*odometry.values.T[:5], np.unwrap(odometry.values[:, 5])),
                    strict=True,
                )
            ),
        ),
        Stream(
            "the command",
            at(command.stamp_ns),
            {"torque": command.values[:, 0], "steering": command.values[:, 1]},
        ),
    )


def checked(
    streams: Streams,
    vehicle: Dimensions | None = VEHICLE,
    sensors: SensorConfig | None = None,
    command_type: str = "joint_state",
) -> CheckResult:
    """Return the result of all checks on streams."""
    topics: dict[str, str | None] = {"imu": None, "odometry": None, "command": None}
    sensors = sensors or SensorConfig()
    kind = command_type if streams.command is not None else ""
    joints = JointTable()
    names = {"name": ["drive", "steer"], "position": [0.0, 0.0], "effort": [0.0, 0.0]}
    joints.add(0.0, message(COMMAND_TYPES["joint_state"], **names))
    content = BagContent(streams, topics, sensors, joints, kind, [])
    return check(content, vehicle)


def existing(streams: Streams, name: str) -> Stream:
    stream = streams.of(name)
    assert stream is not None
    return stream


def scaled(stream: str, factor: float, *columns: str) -> Fault:
    """Return the fault of channels with another unit, scale or sign."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        new = old.having(**{name: factor * old[name] for name in columns})
        return streams.with_stream(stream, new)

    return apply


def added(stream: str, **offsets: float) -> Fault:
    """Return the fault of constant offsets."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        new = old.having(**{name: old[name] + value for name, value in offsets.items()})
        return streams.with_stream(stream, new)

    return apply


def late(stream: str, by_s: float) -> Fault:
    """Return the fault of stamps that are late by a constant time."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        return streams.with_stream(stream, replace(old, at_s=old.at_s + by_s))

    return apply


def low_passed(stream: str, tau_s: float, *columns: str) -> Fault:
    """Return the fault of a first-order low-pass filter."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        out = {}
        for name in columns:
            values = np.array(old[name])
            for i in range(1, values.size):
                keep = math.exp(-(old.at_s[i] - old.at_s[i - 1]) / tau_s)
                # The mean of both samples: half a period of lag less would come with the last.
                level = 0.5 * (old[name][i] + old[name][i - 1])
                values[i] = level + keep * (values[i - 1] - level)
            out[name] = values
        return streams.with_stream(stream, old.having(**out))

    return apply


def mounted(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Fault:
    """Return the fault of an IMU whose axes have this attitude in the vehicle."""

    def apply(streams: Streams) -> Streams:
        matrix = rotation(*np.radians([roll_deg, pitch_deg, yaw_deg]))
        assert streams.imu is not None
        return replace(streams, imu=turned(streams.imu, matrix.T))

    return apply


def displaced(x: float, y: float) -> Fault:
    """Return the fault of an IMU at (x, y) m from the reference point of odometry."""

    def apply(streams: Streams) -> Streams:
        imu = streams.imu
        assert imu is not None
        # The derivative of a noisy gyro would be noise alone: a smooth one is taken.
        w = np.convolve(imu["w_z"], np.ones(21) / 21.0, mode="same")
        rate = np.gradient(w, imu.at_s)
        return replace(
            streams,
            imu=imu.having(
                a_x=imu["a_x"] - rate * y - w**2 * x, a_y=imu["a_y"] + rate * x - w**2 * y
            ),
        )

    return apply


def at_rear_axle(streams: Streams) -> Streams:
    """Return streams whose odometry is that of the middle of the rear axle."""
    o = streams.odometry
    assert o is not None
    l_r = VEHICLE.cg_to_rear_axle
    return replace(
        streams,
        odometry=o.having(
            v_y=o["v_y"] - l_r * o["yaw_rate"],
            x=o["x"] - l_r * np.cos(o["heading"]),
            y=o["y"] - l_r * np.sin(o["heading"]),
        ),
    )


def turned_odometry(angle: float) -> Fault:
    """Return the fault of odometry whose axes are turned to the left, in twist and pose."""

    def apply(streams: Streams) -> Streams:
        o = streams.odometry
        assert o is not None
        c, s = np.cos(angle), np.sin(angle)
        return replace(
            streams,
            odometry=o.having(
                v_x=c * o["v_x"] + s * o["v_y"],
                v_y=c * o["v_y"] - s * o["v_x"],
                heading=o["heading"] + angle,
            ),
        )

    return apply


def without(stream: str, begin_s: float, end_s: float) -> Fault:
    """Return the fault of a stream without messages for a time."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        kept = (old.at_s < begin_s) | (old.at_s > end_s)
        columns = {name: values[kept] for name, values in old.columns.items()}
        return streams.with_stream(stream, Stream(old.name, old.at_s[kept], columns))

    return apply


def frozen(stream: str, begin_s: float, end_s: float) -> Fault:
    """Return the fault of a stream that repeats its last reading for a time."""

    def apply(streams: Streams) -> Streams:
        old = existing(streams, stream)
        latest = np.arange(old.at_s.size)
        inside = (old.at_s > begin_s) & (old.at_s < end_s)
        latest[inside] = np.flatnonzero(inside)[0]
        columns = {name: values[latest] for name, values in old.columns.items()}
        return streams.with_stream(stream, Stream(old.name, old.at_s, columns))

    return apply


def jumped(at_s: float, x: float, angle_rad: float = 0.0) -> Fault:
    """Return the fault of a pose that jumps once."""

    def apply(streams: Streams) -> Streams:
        o = streams.odometry
        assert o is not None
        after = o.at_s > at_s
        return replace(
            streams,
            odometry=o.having(x=o["x"] + x * after, heading=o["heading"] + angle_rad * after),
        )

    return apply


def write_streams(
    streams: Streams, path: Path, joints: tuple[str, str] = ("drive", "steer")
) -> Path:
    """Write streams as a bag of IMU, odometry and JointState; return its path."""
    messages = [
        *_imu_messages(streams.imu),
        *_odometry_messages(streams.odometry),
        *_command_messages(streams.command, joints),
    ]
    return write_messages(path, messages)


def write_messages(path: Path, messages: Sequence[tuple[int, str, Any]]) -> Path:
    """Write (stamp in ns, topic, message), in any order, as a bag; return its path."""
    topics = {topic: msg.__msgtype__ for _, topic, msg in messages}
    with BagWriter(path) as writer:
        for topic, msgtype in topics.items():
            writer.add_topic(topic, msgtype)
        for stamp_ns, topic, msg in sorted(messages, key=lambda each: each[0]):
            writer.write(topic, msg, stamp_ns)
    return path


Messages = Iterator[tuple[int, str, Any]]


def _stamps(stream: Stream) -> list[int]:
    return [START_NS + round(at * 1e9) for at in stream.at_s.tolist()]


def _imu_messages(stream: Stream | None) -> Messages:
    if stream is None:
        return
    for i, stamp in enumerate(_stamps(stream)):
        a, w = (
            {axis: float(stream[f"{kind}_{axis}"][i]) for axis in "xyz"} for kind in ("a", "w")
        )
        header = {"stamp": stamp, "frame_id": "imu_link"}
        msg = message(IMU_TYPE, header=header, linear_acceleration=a, angular_velocity=w)
        yield stamp, "/imu", msg


def _odometry_messages(stream: Stream | None) -> Messages:
    if stream is None:
        return
    for i, stamp in enumerate(_stamps(stream)):
        values = {name: float(column[i]) for name, column in stream.columns.items()}
        half = 0.5 * values["heading"]
        pose = {
            "position": {"x": values["x"], "y": values["y"]},
            "orientation": {"z": math.sin(half), "w": math.cos(half)},
        }
        twist = {
            "linear": {"x": values["v_x"], "y": values["v_y"]},
            "angular": {"z": values["yaw_rate"]},
        }
        msg = message(
            ODOMETRY_TYPE,
            header={"stamp": stamp, "frame_id": "odom"},
            child_frame_id="base_link",
            pose={"pose": pose},
            twist={"twist": twist},
        )
        yield stamp, "/odometry", msg


def _command_messages(stream: Stream | None, joints: tuple[str, str]) -> Messages:
    if stream is None:
        return
    for i, stamp in enumerate(_stamps(stream)):
        msg = message(
            COMMAND_TYPES["joint_state"],
            header={"stamp": stamp, "frame_id": "base_link"},
            name=list(joints),
            position=[math.nan, stream["steering"][i]],
            effort=[stream["torque"][i], math.nan],
        )
        yield stamp, "/command", msg
