# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers that write bags in every format, with rosbags and byte by byte."""

import struct
import zlib
from functools import lru_cache

import lz4.frame
import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from adk_ros.bags import message

IMU, ODOMETRY, COMMAND = "/imu/data", "/odometry", "/vehicle/command"
TYPES = {
    IMU: "sensor_msgs/msg/Imu",
    ODOMETRY: "nav_msgs/msg/Odometry",
    COMMAND: "sensor_msgs/msg/JointState",
}
START_NS = 1_700_000_000_000_000_000
JAZZY = get_typestore(Stores.ROS2_JAZZY)
ACKERMANN = (
    "std_msgs/Header header\nAckermannDrive drive\n" + "=" * 80 + "\nMSG: "
    "ackermann_msgs/AckermannDrive\nfloat32 steering_angle\nfloat32 steering_angle_velocity\n"
    "float32 speed\nfloat32 acceleration\nfloat32 jerk\n"
)


def imu(stamp_ns, a_y):
    return message(
        TYPES[IMU],
        header={"stamp": stamp_ns, "frame_id": "imu_link"},
        linear_acceleration={"y": a_y, "z": 9.81},
    )


def drive(count):
    """Return `count` (topic, log_ns, message), 10 ms apart, logged 1 ms after the stamp."""
    return list(_drive(count))


@lru_cache(maxsize=4)
def _drive(count):
    messages = []
    for i in range(count):
        stamp_ns = START_NS + i * 10_000_000
        header = {"stamp": stamp_ns, "frame_id": "odom"}
        if i % 4 == 1:
            msg = message(
                TYPES[ODOMETRY],
                header=header,
                child_frame_id="base_link",
                twist={"twist": {"linear": {"x": 20.0 + 1e-3 * i}}},
            )
            messages.append((ODOMETRY, stamp_ns + 1_000_000, msg))
        elif i % 4 == 3:
            msg = message(
                TYPES[COMMAND],
                header=header,
                name=["drive", "steer"],
                position=[np.nan, 1e-4 * i],
                effort=[2.0 * i, np.nan],
            )
            messages.append((COMMAND, stamp_ns + 1_000_000, msg))
        else:
            messages.append((IMU, stamp_ns + 1_000_000, imu(stamp_ns, 0.01 * i)))
    return messages


def write(path, messages, storage="mcap", mode=CompressionMode.NONE, extra=None, store=JAZZY):
    """Write a rosbag2 bag with rosbags itself; `extra(writer)` may add further topics."""
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, log_ns, msg in messages:
            if topic not in connections:
                kind = msg.__msgtype__
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            raw = store.serialize_cdr(msg, msg.__msgtype__)
            writer.write(connections[topic], log_ns, raw)
        if extra is not None:
            extra(writer)
    return path


def write_ros1(path, messages, compression=None):
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for i, (topic, log_ns, msg) in enumerate(messages):
            kind = msg.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            raw = JAZZY.serialize_cdr(msg, kind)
            ros1 = bytearray(JAZZY.cdr_to_ros1(raw, kind))
            ros1[:4] = struct.pack("<I", i)  # the sequence number, which ROS 2 does not have
            writer.write(connections[topic], log_ns, bytes(ros1))
    return path


def same(found, expected):
    """Require equal topics, log times and contents, in the same order."""
    found = list(found)
    assert [x[:2] for x in found] == [x[:2] for x in expected]
    for (topic, _, have), (_, _, want) in zip(found, expected, strict=True):
        assert have.header.stamp.sec == want.header.stamp.sec
        assert have.header.stamp.nanosec == want.header.stamp.nanosec
        assert have.header.frame_id == want.header.frame_id
        if topic == IMU:
            assert have.linear_acceleration.y == want.linear_acceleration.y
            assert have.orientation.w == 1.0
        elif topic == ODOMETRY:
            assert have.child_frame_id == "base_link"
            assert have.twist.twist.linear.x == want.twist.twist.linear.x
        else:
            assert have.name == ["drive", "steer"]
            np.testing.assert_array_equal(have.position, want.position)
            np.testing.assert_array_equal(have.effort, want.effort)


def record(op, body):
    return struct.pack("<BQ", op, len(body)) + body


def text(value):
    return struct.pack("<I", len(value.encode())) + value.encode()


def mcap_chunk(content, compression=""):
    compressed = lz4.frame.compress(content) if compression == "lz4" else content
    head = struct.pack("<QQQI", 0, 0, len(content), zlib.crc32(content)) + text(compression)
    return record(0x06, head + struct.pack("<Q", len(compressed)) + compressed)


def mcap_file(
    path, messages, compression=None, encoding="cdr", profile="ros2", closed=True, raw=None
):
    """
    Write an MCAP file without a summary: one chunk per 50 messages, or no chunks.

    `raw`: bytes to write in place of messages, by their number.
    """
    parts = []
    channels: dict[str, int] = {}
    for i, (topic, log_ns, msg) in enumerate(messages):
        kind = msg.__msgtype__
        part = b""
        if topic not in channels:
            key = channels[topic] = len(channels) + 1
            definition, _ = JAZZY.generate_msgdef(kind, ros_version=2)
            schema = struct.pack("<H", key) + text(kind) + text("ros2msg") + text(definition)
            channel = struct.pack("<HH", key, key) + text(topic) + text(encoding) + text("")
            part += record(0x03, schema) + record(0x04, channel)
        head = struct.pack("<HIQQ", channels[topic], 0, log_ns, log_ns)
        content = (raw or {}).get(i, JAZZY.serialize_cdr(msg, kind))
        parts.append(part + record(0x05, head + bytes(content)))
    out = b"\x89MCAP0\r\n" + record(0x01, text(profile) + text("by hand"))
    if compression is None:
        out += b"".join(parts)
    else:
        for i in range(0, len(parts), 50):
            out += mcap_chunk(b"".join(parts[i : i + 50]), compression)
    if closed:
        out += record(0x0F, bytes(4)) + record(0x02, bytes(20)) + b"\x89MCAP0\r\n"
    path.write_bytes(out)
    return path
