# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Undamaged bags: storage, compression and format, choice of topics, refusals, writing."""

import re
import sqlite3
import struct
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.bags import (
    ACKERMANN,
    JAZZY,
    START_NS,
    TYPES,
    drive,
    imu,
    mcap_file,
    same,
    text,
    write,
    write_ros1,
)
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from adk_ros.bags import Bag, BagWriter, TopicInfo, Topics, find_topics, message, open_bag, opening
from adk_ros.bags.indexed import Indexed, NoIndex
from adk_ros.errors import DataError, UsageError

IMU, ODOMETRY, COMMAND = "/imu/data", "/odometry", "/vehicle/command"


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        ("mcap", CompressionMode.NONE),
        ("mcap", CompressionMode.STORAGE),
        ("mcap", CompressionMode.FILE),
        ("mcap", CompressionMode.MESSAGE),
        ("sqlite3", CompressionMode.NONE),
        ("sqlite3", CompressionMode.FILE),
        ("sqlite3", CompressionMode.MESSAGE),
    ],
)
@pytest.mark.parametrize("given", ["folder", "metadata", "file"])
def test_every_rosbag2_variant_reads_the_same(tmp_path, storage, mode, given):
    expected = drive(200)
    folder = write(tmp_path / "bag", expected, storage, mode)
    (file,) = (x for x in folder.iterdir() if x.name != "metadata.yaml")
    path = {"folder": folder, "metadata": folder / "metadata.yaml", "file": file}[given]
    with open_bag(path) as bag:
        assert bag.topics == [
            TopicInfo(IMU, TYPES[IMU], 100),
            TopicInfo(ODOMETRY, TYPES[ODOMETRY], 50),
            TopicInfo(COMMAND, TYPES[COMMAND], 50),
        ]
        assert (bag.start_ns, bag.end_ns) == (expected[0][1], expected[-1][1])
        assert bag.duration_s == pytest.approx(1.99)
        assert bag.message_count == 200
        same(bag.messages(), expected)
        same(bag.messages({ODOMETRY}), [x for x in expected if x[0] == ODOMETRY])
        same(bag.messages(), expected)
        assert bag.warnings == []


@pytest.mark.parametrize(
    "compression", [None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4]
)
def test_ros1_reads_as_ros2(tmp_path, compression):
    expected = drive(200)
    path = write_ros1(tmp_path / "drive.bag", expected, compression)
    with Bag(path) as bag:
        assert {x.name: x.msgtype for x in bag.topics} == TYPES
        same(bag.messages(), expected)
        raw = [(n, k, t, JAZZY.deserialize_cdr(d, k)) for n, k, t, d in bag.raw()]
        assert [k for _, k, _, _ in raw] == [TYPES[n] for n, _, _ in expected]
        same(((n, t, m) for n, _, t, m in raw), expected)
        assert (bag.start_ns, bag.end_ns) == (expected[0][1], expected[-1][1])
        assert bag.warnings == []


@pytest.mark.parametrize("compression", [None, "", "lz4"])
@pytest.mark.parametrize("profile", ["ros2", ""])
def test_mcap_of_other_writers(tmp_path, compression, profile):
    """No index, no profile, with and without chunks, unsorted: all messages are read."""
    expected = drive(200)
    shuffled = expected[:40] + expected[120:160] + expected[40:120] + expected[160:]
    path = mcap_file(tmp_path / "x.mcap", shuffled, compression, profile=profile)
    with Bag(path) as bag:
        same(bag.messages(), expected)
        assert bag.message_count == 200
        assert bag.warnings == []


def test_an_index_that_fails_in_an_unknown_way_is_reported(tmp_path, monkeypatch):
    """All messages are read by a scan, and nobody has to wonder why it takes longer."""

    def fail(*_):
        raise KeyError("statistics")

    path = write(tmp_path / "bag", drive(200), "mcap")
    monkeypatch.setattr(opening, "Indexed", fail)
    with Bag(path) as bag:
        assert bag.message_count == 200
        (warning,) = bag.warnings
    assert "its index is not readable (KeyError: 'statistics')" in warning


def test_an_index_without_counts_by_channel_is_not_used():
    """They are optional in MCAP; rosbags then says that each channel has no message."""
    reader = SimpleNamespace(
        open=lambda: None, close=lambda: None, chunks=[1],
        metadata=SimpleNamespace(message_count=5, start_time=0, end_time=1),
        connections=[SimpleNamespace(id=1, msgcount=0)],
    )  # fmt: skip
    with pytest.raises(NoIndex):
        Indexed(reader)


def test_messages_that_contradict_their_index_are_skipped(tmp_path, monkeypatch):
    """A damaged chunk that still unpacks holds other times than the index says."""
    read = Indexed.messages

    def damaged(storage, ids):
        for i, found in enumerate(read(storage, ids)):
            yield found._replace(log_ns=found.log_ns - 10**9) if i == 120 else found

    path = write(tmp_path / "bag", drive(200), "mcap")
    monkeypatch.setattr(Indexed, "messages", damaged)
    with Bag(path) as bag:
        times = [log_ns for _, log_ns, _ in bag.messages()]
        (warning,) = bag.warnings
    assert times == sorted(times)
    assert len(times) == 199
    assert "1 messages cannot be decoded and are skipped" in warning
    assert warning.endswith("logged before the message before it")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_log_order_not_header_order(tmp_path, storage):
    messages = [(IMU, START_NS + t, imu(START_NS - t, t)) for t in (5, 3, 9, 1)]
    with Bag(write(tmp_path / "bag", messages, storage)) as bag:
        assert [t - START_NS for _, t, _ in bag.messages()] == [1, 3, 5, 9]


def test_split_bag(tmp_path):
    """Twelve files of a split recording, numbered without leading zeros."""
    expected = drive(240)
    folder = tmp_path / "bag"
    folder.mkdir()
    for i in range(12):
        part = expected[20 * i : 20 * i + 20]
        with BagWriter(tmp_path / f"part_{i}") as writer:
            for topic, log_ns, msg in part:
                writer.add_topic(topic, TYPES[topic])
                writer.write(topic, msg, log_ns)
        (tmp_path / f"part_{i}" / f"part_{i}.mcap").rename(folder / f"bag_{i}.mcap")
    with Bag(folder) as bag:
        same(bag.messages(), expected)
        assert bag.warnings == ["metadata.yaml is missing: the recording was not closed"]


def test_raw_bytes_equal_the_written_ones(tmp_path):
    expected = drive(20)
    for mode in (CompressionMode.NONE, CompressionMode.MESSAGE):
        with Bag(write(tmp_path / mode.name, expected, "sqlite3", mode)) as bag:
            assert list(bag.raw([IMU, COMMAND])) == [
                (topic, TYPES[topic], log_ns, bytes(JAZZY.serialize_cdr(msg, TYPES[topic])))
                for topic, log_ns, msg in expected
                if topic != ODOMETRY
            ]


def test_unknown_types_do_not_affect_others(tmp_path):
    """A definition that cannot be parsed, one with a missing type, and an empty one."""

    def extra(writer):
        for i, definition in enumerate(["this is ( no definition", "lost_msgs/Gone gone\n", ""]):
            topic = writer.add_connection(
                f"/odd{i}", f"odd_msgs/msg/Odd{i}", msgdef=definition, rihs01="RIHS01_0"
            )
            writer.write(topic, START_NS, b"\x00\x01\x00\x00\x07")

    expected = drive(40)
    for storage in ("mcap", "sqlite3"):
        path = write(tmp_path / storage, expected, storage, extra=extra)
        with Bag(path) as bag:
            same(bag.messages(), expected)
            assert [re.sub(r"\d", "#", x) for x in bag.warnings] == [
                "/odd#: type odd_msgs/msg/Odd# is not defined in the bag: # messages skipped"
            ] * 3
            assert find_topics(bag) == Topics(IMU, ODOMETRY, COMMAND)
            assert len(list(bag.raw(["/odd0"]))) == 1
            with pytest.raises(DataError, match="/odd1: type odd_msgs/msg/Odd1 is not defined"):
                bag.messages(["/odd1", IMU])


def test_types_defined_in_idl(tmp_path):
    """An IDL definition that uses a type in IDL and a type in MSG."""
    line = "=" * 80 + "\n"
    definition = (
        f'{line}IDL: my_msgs/msg/Speed\n#include "my_msgs/msg/Wheel.idl"\nmodule my_msgs '
        "{ module msg { struct Speed { my_msgs::msg::Wheel wheel; my_msgs::msg::Body body; "
        "double v_x; }; }; };\n"
        f"{line}IDL: my_msgs/msg/Wheel\nmodule my_msgs {{ module msg {{ "
        "struct Wheel { double rate; }; }; };\n"
        f"{line}MSG: my_msgs/Body\nfloat64 mass\n"
    )

    def extra(writer):
        kind = "my_msgs/msg/Speed"
        topic = writer.add_connection("/speed", kind, msgdef=definition, rihs01="RIHS01_0")
        raw = b"\x00\x01\x00\x00" + struct.pack("<ddd", 30.5, 790.0, 12.5)
        writer.write(topic, START_NS, raw)

    for storage in ("mcap", "sqlite3"):
        with Bag(write(tmp_path / storage, drive(4), storage, extra=extra)) as bag:
            ((_, _, found),) = bag.messages("/speed")
            assert (found.wheel.rate, found.body.mass, found.v_x) == (30.5, 790.0, 12.5)
            assert bag.warnings == []


def test_mcap_without_message_index(tmp_path):
    """Chunks are indexed, their messages are not, so rosbags finds no message."""
    expected = drive(200)
    file = write(tmp_path / "bag", expected) / "bag.mcap"
    content = bytearray(file.read_bytes())
    summary = int.from_bytes(content[-28:-20], "little")
    at = content.index(b"\x08", content.index(text("/vehicle/command"), summary))
    assert int.from_bytes(content[at + 1 : at + 9], "little") < 200
    offsets = at + 9 + 32
    size = int.from_bytes(content[offsets : offsets + 4], "little")
    assert size == 3 * 10
    for i in range(3):
        entry = offsets + 4 + 10 * i
        content[entry : entry + 2] = (900 + i).to_bytes(2, "little")
    file.write_bytes(content)
    with Bag(file) as bag:
        same(bag.messages(), expected)
        assert bag.warnings == []


def test_unsupported_encoding_is_reported(tmp_path):
    path = mcap_file(tmp_path / "x.mcap", drive(8), encoding="json")
    with Bag(path) as bag:
        assert list(bag.messages()) == []
        assert "/imu/data is encoded as 'json', not CDR: 4 messages skipped" in bag.warnings


def test_bag_definition_has_priority(tmp_path):
    """A JointState with an additional field, as in another distribution."""
    kind = TYPES[COMMAND]
    definition, _ = JAZZY.generate_msgdef(kind, ros_version=2)
    definition = definition.replace("float64[] effort", "float64[] effort\nfloat64 grip", 1)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, kind))
    header = drive(1)[0][2].header
    none = np.zeros(0)
    msg = store.types[kind](header, ["steer"], np.array([0.1]), none, none, 0.5)

    def extra(writer):
        topic = writer.add_connection(COMMAND, kind, typestore=store)
        writer.write(topic, START_NS, store.serialize_cdr(msg, kind))

    with Bag(write(tmp_path / "bag", drive(2), extra=extra)) as bag:
        ((_, _, found),) = bag.messages([COMMAND])
        assert (found.position[0], found.grip) == (0.1, 0.5)
        assert bag.warnings == []


def test_old_sqlite_without_definitions(tmp_path):
    """Bags of ROS 2 Humble and earlier define no types: those of Jazzy are used."""
    expected = drive(40)
    folder = write(tmp_path / "bag", expected, "sqlite3")
    with sqlite3.connect(folder / "bag.db3") as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
    with Bag(folder) as bag:
        same(bag.messages(), expected)
        assert bag.warnings == []


def test_undecodable_messages_are_counted(tmp_path):
    expected = drive(40)

    def extra(writer):
        topic = writer.connections[0]
        for i, raw in enumerate(
            [b"", b"\x00\x01\x00\x00\xff\xff", b"\x00\x09\x00\x00" + bytes(400)]
        ):
            writer.write(topic, START_NS + 100_000_000 + i, raw)

    for mode in (CompressionMode.NONE, CompressionMode.MESSAGE):
        with Bag(write(tmp_path / mode.name, expected, extra=extra, mode=mode)) as bag:
            for _ in range(2):
                same(bag.messages(), expected)
            (warning,) = bag.warnings
            assert warning.startswith(
                "/imu/data: 3 messages cannot be decoded and are skipped, the first at 0.1 s: "
            )


def test_trailing_bytes_of_rclpy(tmp_path):
    """Four additional bytes after a trailing empty sequence, as rclpy serialises it."""
    msg = message(TYPES[COMMAND], name=["steer"], position=[0.1])
    raw = bytes(JAZZY.serialize_cdr(msg, TYPES[COMMAND])) + bytes(4)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(COMMAND, TYPES[COMMAND])
        writer.write(COMMAND, raw, START_NS)
    with Bag(tmp_path / "bag") as bag:
        ((_, _, found),) = bag.messages()
        assert (found.name, found.position[0], len(found.effort)) == (["steer"], 0.1, 0)
        assert bag.warnings == []


def test_find_topics_reports_missing_topics(tmp_path):
    messages = [x for x in drive(40) if x[0] != ODOMETRY]
    with Bag(write(tmp_path / "bag", messages)) as bag:
        with pytest.raises(DataError) as refusal:
            find_topics(bag)
        assert str(refusal.value) == (
            f"bag {tmp_path / 'bag'}: no odometry: no topic of type nav_msgs/msg/Odometry with "
            "messages; it has /imu/data (sensor_msgs/msg/Imu, 20), "
            "/vehicle/command (sensor_msgs/msg/JointState, 10)"
        )


def test_find_topics_by_type_and_by_name(tmp_path):
    twice = [("/other" + n, t + 1, m) for n, t, m in drive(40) if n in {IMU, ODOMETRY}]
    messages = sorted(drive(40) + twice, key=lambda x: x[1])

    def extra(writer):
        writer.add_connection("/unused", TYPES[COMMAND], typestore=JAZZY)

    with Bag(write(tmp_path / "one", drive(40), extra=extra)) as bag:
        assert find_topics(bag) == Topics(IMU, ODOMETRY, COMMAND, None)
        assert find_topics(bag, imu="") == Topics(None, ODOMETRY, COMMAND, None)
        with pytest.raises(DataError, match="no command: no topic of type ackermann_msgs/msg/"):
            find_topics(bag, command_type="ackermann")
        with pytest.raises(DataError, match="--command /unused has no messages"):
            find_topics(bag, command="/unused")
        with pytest.raises(UsageError, match=r"has no topic /imu \(--imu\); it has /imu/data"):
            find_topics(bag, imu="/imu")
        with pytest.raises(UsageError, match="/odometry is nav_msgs/msg/Odometry, but sensor_msg"):
            find_topics(bag, command=ODOMETRY)
        with pytest.raises(UsageError, match="choose one of joint_state, ackermann, autoware_con"):
            find_topics(bag, command_type="pedal")
        with pytest.raises(UsageError, match="has no topic /gone, /lost; it has /imu/data"):
            bag.messages([IMU, "/lost", "/gone"])
    with Bag(write(tmp_path / "two", messages)) as bag:
        with pytest.raises(DataError) as refusal:
            find_topics(bag, imu=IMU)
        assert str(refusal.value) == (
            f"bag {tmp_path / 'two'}: 2 topics of type nav_msgs/msg/Odometry: /odometry, "
            "/other/odometry; choose one with --odometry NAME"
        )
        with pytest.raises(DataError, match="/imu/data, /other/imu/data; choose one with --imu"):
            find_topics(bag, odometry=ODOMETRY)
        chosen = find_topics(bag, imu="/other/imu/data", odometry=ODOMETRY)
        assert chosen == Topics("/other/imu/data", ODOMETRY, COMMAND)


def test_imu_is_optional(tmp_path):
    with Bag(write(tmp_path / "bag", [x for x in drive(40) if x[0] != IMU])) as bag:
        assert find_topics(bag) == Topics(None, ODOMETRY, COMMAND)


@pytest.mark.parametrize("ros1", [False, True])
def test_commands_by_the_definition_in_the_bag(tmp_path, ros1):
    kind = "ackermann_msgs/msg/AckermannDriveStamped"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(ACKERMANN, kind))
    stamp = store.types["builtin_interfaces/msg/Time"](7, 5)
    sequence = {"seq": 3} if ros1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link", **sequence)
    inner = store.types["ackermann_msgs/msg/AckermannDrive"](0.1, 0.0, 12.0, 0.5, 0.0)
    msg = store.types[kind](header, inner)
    messages = [x for x in drive(8) if x[0] != COMMAND]
    if ros1:
        path = tmp_path / "x.bag"
        with Ros1Writer(path) as writer:
            topic = writer.add_connection("/drive", kind, typestore=store)
            writer.write(topic, START_NS, store.serialize_ros1(msg, kind))
    else:
        path = write(
            tmp_path / "bag",
            messages,
            extra=lambda writer: writer.write(
                writer.add_connection("/drive", kind, typestore=store),
                START_NS,
                store.serialize_cdr(msg, kind),
            ),
        )
    with Bag(path) as bag:
        ((_, _, found),) = bag.messages(["/drive"])
        assert found.drive.steering_angle == pytest.approx(0.1)
        assert (found.drive.speed, found.header.stamp.nanosec) == (12.0, 5)
        assert next(x.msgtype for x in bag.topics if x.name == "/drive") == kind
        if not ros1:
            assert find_topics(bag, command_type="ackermann") == Topics(IMU, ODOMETRY, "/drive")


def test_autoware_steering_is_optional(tmp_path):
    control, steering = (
        "autoware_control_msgs/msg/Control",
        "autoware_vehicle_msgs/msg/SteeringReport",
    )
    definition = "builtin_interfaces/Time stamp\nfloat32 value\n"

    def extra(*topics):
        def add(writer):
            for name, kind in topics:
                topic = writer.add_connection(name, kind, msgdef=definition, rihs01="RIHS01_0")
                writer.write(topic, START_NS, b"\x00\x01\x00\x00" + bytes(12))

        return add

    def bag_with(name, *topics):
        return Bag(write(tmp_path / name, drive(4), extra=extra(("/control", control), *topics)))

    with bag_with("none") as bag:
        chosen = Topics(IMU, ODOMETRY, "/control", None)
        assert find_topics(bag, command_type="autoware_control") == chosen
        assert [m.value for _, _, m in bag.messages("/control")] == [0.0]
    with bag_with("one", ("/steering", steering)) as bag:
        chosen = Topics(IMU, ODOMETRY, "/control", "/steering")
        assert find_topics(bag, command_type="autoware_control") == chosen
        assert find_topics(bag).steering is None
    with bag_with("two", ("/s1", steering), ("/s2", steering)) as bag:
        with pytest.raises(DataError, match="/s1, /s2; choose one with --steering NAME"):
            find_topics(bag, command_type="autoware_control")
        chosen = find_topics(bag, command_type="autoware_control", steering="/s2")
        assert chosen.steering == "/s2"


def refusal(path):
    with pytest.raises((UsageError, DataError)) as caught:
        Bag(path)
    assert "\n" not in str(caught.value)
    return type(caught.value), str(caught.value).replace(str(path), "PATH")


def test_paths_that_are_not_bags(tmp_path):
    assert refusal(tmp_path / "gone") == (UsageError, "bag PATH does not exist")
    (tmp_path / "empty").mkdir()
    assert refusal(tmp_path / "empty") == (
        UsageError,
        "PATH is not a rosbag2 folder: no .mcap or .db3 in it",
    )
    (tmp_path / "ros1").mkdir()
    (tmp_path / "ros1" / "a.bag").touch()
    assert refusal(tmp_path / "ros1") == (
        UsageError,
        "PATH is not a rosbag2 folder: name a bag in it: a.bag",
    )
    write(tmp_path / "recordings" / "monday", drive(4))
    assert refusal(tmp_path / "recordings") == (
        UsageError,
        "PATH is not a rosbag2 folder: name a bag in it: monday",
    )
    (tmp_path / "loose").mkdir()
    for name in ("monday_0.mcap", "monday_1.mcap", "friday_0.mcap"):
        (tmp_path / "loose" / name).touch()
    assert refusal(tmp_path / "loose") == (
        UsageError,
        "PATH contains several recordings: name one of "
        "friday_0.mcap, monday_0.mcap, monday_1.mcap",
    )
    (tmp_path / "x.mcap").touch()
    assert refusal(tmp_path / "x.mcap") == (DataError, "bag PATH: x.mcap is empty")
    (tmp_path / "y.mcap").write_text("speed;torque\n1;2\n")
    assert refusal(tmp_path / "y.mcap") == (
        DataError,
        "bag PATH: y.mcap is neither MCAP, SQLite nor a ROS 1 bag (CSV is not read)",
    )
    with sqlite3.connect(tmp_path / "z.db3") as database:
        database.execute("CREATE TABLE songs(title TEXT)")
    assert refusal(tmp_path / "z.db3") == (
        DataError,
        "bag PATH contains no messages: no such table: topics",
    )
    assert refusal("/dev/null")[0] is UsageError


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_without_messages(tmp_path, storage):
    with BagWriter(tmp_path / "bag", storage) as writer:
        writer.add_topic(IMU, TYPES[IMU])
    assert refusal(tmp_path / "bag") == (DataError, "bag PATH contains no messages")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("compression", [None, "zstd"])
def test_writer(tmp_path, storage, compression):
    expected = drive(400)
    path = tmp_path / "new" / "bag"
    with BagWriter(path, storage, compression) as writer:
        for topic, log_ns, msg in expected:
            writer.add_topic(topic, TYPES[topic])
            raw = JAZZY.serialize_cdr(msg, TYPES[topic])
            writer.write(topic, msg if topic == IMU else bytes(raw), log_ns)
    with Bag(path) as bag:
        same(bag.messages(), expected)
        assert bag.warnings == []
    size = sum(x.stat().st_size for x in path.iterdir())
    assert (size < 40_000) == (compression == "zstd")


def test_writer_refusals(tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(UsageError, match="there exists already: choose another --out or remove"):
        BagWriter(tmp_path / "there")
    with pytest.raises(UsageError, match="storage 'db' is unknown: choose mcap or sqlite3"):
        BagWriter(tmp_path / "new", "db")
    with pytest.raises(UsageError, match="compression 'lz4' is unknown"):
        BagWriter(tmp_path / "new", compression="lz4")
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"cannot be written: .*Not a directory"):
        BagWriter(tmp_path / "file" / "bag")
    assert not (tmp_path / "new").exists()
    with BagWriter(tmp_path / "new") as writer:
        with pytest.raises(UsageError, match="message type no_msgs/msg/No is unknown"):
            writer.add_topic("/a", "no_msgs/msg/No")
        with pytest.raises(UsageError, match="topic /a was not declared"):
            writer.write("/a", b"", 0)
        writer.add_topic(IMU, TYPES[IMU])
        with pytest.raises(UsageError, match="/imu/data is declared as sensor_msgs/msg/Imu"):
            writer.add_topic(IMU, TYPES[COMMAND])
        with pytest.raises(UsageError, match="log time -1 ns"):
            writer.write(IMU, imu(0, 0.0), -1)
    writer.close()
    with pytest.raises(UsageError, match="is closed"):
        writer.write(IMU, imu(0, 0.0), 0)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("compression", [None, "zstd"])
def test_writer_closes_the_bag_after_an_exception(tmp_path, storage, compression):
    expected = drive(40)

    def interrupted():
        with BagWriter(tmp_path / "bag", storage, compression) as writer:
            for i, (topic, log_ns, msg) in enumerate(expected):
                if i == 30:
                    raise KeyboardInterrupt
                writer.add_topic(topic, TYPES[topic])
                writer.write(topic, msg, log_ns)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with Bag(tmp_path / "bag") as bag:
        same(bag.messages(), expected[:30])
        assert bag.warnings == []


def test_message_defaults_and_conversions():
    msg = message(
        TYPES[ODOMETRY],
        header={"stamp": 3_000_000_007},
        pose={"covariance": range(36)},
        twist={"twist": {"angular": {"z": 1}}},
    )
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec, msg.header.frame_id) == (3, 7, "")
    assert msg.pose.covariance.dtype == np.float64
    assert msg.pose.covariance[35] == 35.0
    assert msg.pose.pose.orientation.w == 1.0
    assert isinstance(msg.twist.twist.angular.z, float)
    assert Counter(msg.twist.covariance) == {0.0: 36}
    header = message("std_msgs/msg/Header", stamp=np.int64(5_000_000_001))
    assert message(TYPES[IMU], header=header).header.stamp.nanosec == 1
    tf = message("tf2_msgs/msg/TFMessage", transforms=[{"child_frame_id": "base_link"}])
    assert tf.transforms[0].transform.rotation.w == 1.0
    assert message(TYPES[COMMAND]).name == []
    with pytest.raises(TypeError, match="no field pitch"):
        message("geometry_msgs/msg/Vector3", pitch=1.0)
    with pytest.raises(TypeError, match="message type sensor_msgs/Imu is unknown"):
        message("sensor_msgs/Imu")
