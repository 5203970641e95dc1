# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Playing a bag: published messages, their times, and the refusal of wrong options."""

import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from helpers.node import START_NS, write_bag
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from adk_ros.bags import Bag, BagWriter
from adk_ros.bags import message as bag_message
from adk_ros.errors import UsageError
from adk_ros.ros.messages import join_stamp
from adk_ros.ros.pacing import ReadAhead, paced
from adk_ros.ros.play import play
from adk_ros.ros.restamp import Restamper
from adk_ros.ros.session import Session
from adk_ros.ros.static_transforms import has_static_transforms, static_transforms_qos

TF_STATIC = "/tf_static"
TYPES = {"/imu/data": Imu, "/odometry": Odometry, "/vehicle/command": JointState, "/clock": Clock}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "bag", 2.0)


class Received(NamedTuple):
    """A message as received on a topic."""

    topic: str
    content: bytes
    arrival_ns: int


@contextmanager
def listening(*topics: str) -> Iterator[list[Received]]:
    """Collect the raw messages of topics in a thread."""
    received: list[Received] = []
    ended, ready = threading.Event(), threading.Event()

    def listen() -> None:
        with Session("listener") as session:
            for topic in topics:

                def take(content: bytes, topic: str = topic) -> None:
                    received.append(Received(topic, bytes(content), time.monotonic_ns()))

                # tf2_msgs is not among the wheels of the tests: the name alone says what it is.
                kind = String if topic == TF_STATIC else TYPES.get(topic, JointState)
                qos = static_transforms_qos() if has_static_transforms(topic) else 1000
                session.node.create_subscription(kind, topic, take, qos, raw=True)
            ready.set()
            while not ended.is_set():
                session.spin(0.05)

    thread = threading.Thread(target=listen)
    thread.start()
    ready.wait(10.0)
    try:
        yield received
    finally:
        ended.set()
        thread.join()


def test_byte_for_byte_and_in_time(bag: Path) -> None:
    progress: list[tuple[float, float]] = []
    with listening(*TYPES) as received:
        stats = play(bag, progress=lambda *done: progress.append(done))
        time.sleep(0.5)
    with Bag(bag) as opened:
        written = list(opened.raw())
    assert stats.messages == len(written) == sum(stats.by_topic.values())
    assert stats.loops == 1
    assert not stats.interrupted
    assert stats.unheard == ()
    for topic in stats.by_topic:
        sent = [content for name, _kind, _ns, content in written if name == topic]
        assert [item.content for item in received if item.topic == topic] == sent
    # Arrival times follow the log times: no drift, and little jitter even on a busy machine.
    log_ns = np.array([ns for name, _kind, ns, _content in written if name == "/odometry"])
    arrival_ns = np.array([item.arrival_ns for item in received if item.topic == "/odometry"])
    lag_s = (arrival_ns - log_ns - (arrival_ns[0] - log_ns[0])) * 1e-9
    assert abs(np.median(lag_s)) < 0.05
    clocks = [
        join_stamp(deserialize_message(x.content, Clock).clock)
        for x in received
        if x.topic == "/clock"
    ]
    assert len(clocks) >= 195
    assert np.all(np.diff(clocks) == 10_000_000)
    assert clocks[0] == written[0][2]
    assert len(progress) >= 10
    assert all(0.0 <= done <= whole for done, whole in progress)


def test_rate_part_topics_and_remapping_without_clock(bag: Path) -> None:
    with listening("/clock", "/elsewhere/command", "/odometry") as received:
        begin_s = time.monotonic()
        stats = play(
            bag,
            4.0,
            clock=False,
            remap={"/vehicle/command": "elsewhere/command"},
            topics=["/vehicle/command"],
            start_s=0.5,
            duration_s=1.0,
        )
        elapsed_s = time.monotonic() - begin_s
        time.sleep(0.3)
    assert {item.topic for item in received} == {"/elsewhere/command"}
    assert len(received) == stats.messages == 40
    stamps = [
        join_stamp(deserialize_message(x.content, JointState).header.stamp) for x in received
    ]
    assert min(stamps) >= START_NS + 500_000_000
    assert max(stamps) <= START_NS + 1_520_000_000
    assert elapsed_s < 6.0


def test_fixed_transforms_are_kept_and_precede_all_messages(bag: Path, tmp_path: Path) -> None:
    """As a node asks for them (transient local), wherever in the bag they were logged."""
    with Bag(bag) as opened, BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(TF_STATIC, "std_msgs/msg/String")
        writer.add_topic("/odometry", "nav_msgs/msg/Odometry")
        writer.write(TF_STATIC, bag_message("std_msgs/msg/String", data="imu"), opened.start_ns)
        for topic, _kind, log_ns, content in opened.raw(["/odometry"]):
            writer.write(topic, content, log_ns)
        late = bag_message("std_msgs/msg/String", data="lidar")
        writer.write(TF_STATIC, late, opened.end_ns)
    with listening(TF_STATIC, "/odometry") as received:
        stats = play(tmp_path / "bag", 4.0, start_s=0.5, duration_s=1.0)
        time.sleep(0.3)
    assert [item.topic for item in received[:2]] == [TF_STATIC] * 2
    assert {item.topic for item in received[2:]} == {"/odometry"}
    transforms = [deserialize_message(item.content, String).data for item in received[:2]]
    assert transforms == ["imu", "lidar"]
    assert stats.by_topic[TF_STATIC] == 2


def test_stamps_shifted_to_the_present(bag: Path) -> None:
    with listening("/clock", "/odometry") as received:
        begin_ns = time.time_ns()
        play(bag, stamps="now", duration_s=0.5, topics=["/odometry"])
        end_ns = time.time_ns()
        time.sleep(0.3)
    with Bag(bag) as opened:
        originals = [content for *_, content in opened.raw(["/odometry"])]
    shifted = [item.content for item in received if item.topic == "/odometry"]
    stamps = [
        join_stamp(deserialize_message(content, Odometry).header.stamp) for content in shifted
    ]
    assert begin_ns < stamps[0] < stamps[-1] < end_ns
    assert np.all(np.diff(stamps) == 20_000_000)
    assert [content[12:] for content in shifted] == [x[12:] for x in originals[: len(shifted)]]
    clocks = [
        join_stamp(deserialize_message(x.content, Clock).clock)
        for x in received
        if x.topic == "/clock"
    ]
    assert begin_ns < clocks[0] < clocks[-1] < end_ns + 100_000_000


def test_no_subscriber(bag: Path) -> None:
    notices: list[str] = []
    stats = play(bag, duration_s=0.1, wait_for_subscribers_s=0.2, notice=notices.append)
    assert stats.unheard == ("/imu/data", "/odometry", "/vehicle/command")
    # How long it has waited is measured: a busy machine wakes it later.
    (said,) = notices
    topics = "/imu/data, /odometry, /vehicle/command"
    found = re.fullmatch(rf"no subscriber to {topics} after ([\d.]+) s: playing anyway", said)
    assert found is not None
    assert float(found[1]) >= 0.2
    with listening("/odometry"):
        begin_s = time.monotonic()
        stats = play(bag, duration_s=0.1, wait_for_subscribers_s=60.0)
        assert 4.0 < time.monotonic() - begin_s < 15.0
    assert stats.unheard == ("/imu/data", "/vehicle/command")
    assert stats.messages > 10


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "--rate 0 is out of range"),
        ({"rate": float("nan")}, "--rate nan is out of range"),
        ({"stamps": "later"}, "--stamps later is unknown"),
        ({"stamps": "now", "rate": 2.0}, "--stamps now needs --rate 1"),
        ({"topics": ["/nope"]}, "has no topic /nope"),
        ({"remap": {"/nope": "imu"}}, "has no topic /nope"),
        ({"remap": {"/odometry": "not a name"}}, "not a name"),
        ({"start_s": 100.0}, "--start 100 s is outside"),
        ({"duration_s": 0.0}, "--duration 0 s"),
    ],
)
def test_wrong_options(bag: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError) as refused:
        play(bag, **options)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_ros1_bag(tmp_path: Path) -> None:
    """ROS 1 messages are published as ROS 2 messages."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    with Writer(tmp_path / "old.bag") as writer:
        connection = writer.add_connection("/odometry", "nav_msgs/msg/Odometry", typestore=store)
        for number in range(20):
            vector = types["geometry_msgs/msg/Vector3"]
            point = types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0)
            identity = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            pose = types["geometry_msgs/msg/Pose"](point, identity)
            linear, angular = vector(number, 0.0, 0.0), vector(0.0, 0.0, 0.1)
            twist = types["geometry_msgs/msg/Twist"](linear, angular)
            stamp = types["builtin_interfaces/msg/Time"](100, number * 10_000_000)
            odometry = types["nav_msgs/msg/Odometry"](
                types["std_msgs/msg/Header"](number, stamp, "odom"), "base_link",
                types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            )  # fmt: skip
            content = store.serialize_ros1(odometry, "nav_msgs/msg/Odometry")
            writer.write(connection, 100 * 10**9 + number * 10_000_000, content)
    with listening("/odometry") as received:
        stats = play(tmp_path / "old.bag")
        time.sleep(0.3)
    assert stats.messages == len(received) == 20
    messages = [deserialize_message(item.content, Odometry) for item in received]
    assert [item.twist.twist.linear.x for item in messages] == list(range(20))
    assert [join_stamp(item.header.stamp) for item in messages] == [
        100 * 10**9 + number * 10_000_000 for number in range(20)
    ]


def test_absent_bag(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        play(tmp_path / "none")


def test_only_stamped_messages_are_shifted() -> None:
    restamper = Restamper()
    for kind in (Imu, Clock, String, PointStamped):
        restamper.add(kind.__name__, kind)
    text = serialize_message(String(data="hello"))
    assert restamper.shift("String", text, 10**9) == text
    point = PointStamped()
    point.header.stamp.sec, point.header.stamp.nanosec = 5, 999_999_999
    shifted = restamper.shift("PointStamped", serialize_message(point), 2)
    stamp = deserialize_message(shifted, PointStamped).header.stamp
    assert (stamp.sec, stamp.nanosec) == (6, 1)
    # A stamp that would be beyond 2^31 s stays.
    assert restamper.shift("PointStamped", serialize_message(point), 2**31 * 10**9) == (
        serialize_message(point)
    )
    assert restamper.unshifted == {"PointStamped": 1}
    big_endian = b"\0\0\0\0" + (7).to_bytes(4, "big") + (8).to_bytes(4, "big") + b"rest"
    shifted = restamper.shift("Imu", big_endian, 3_000_000_001)
    assert shifted == b"\0\0\0\0" + (10).to_bytes(4, "big") + (9).to_bytes(4, "big") + b"rest"


class Item(NamedTuple):
    """An item with a due time."""

    offset_ns: int


def never() -> bool:
    return False


def test_paced_is_absolute() -> None:
    """A delay does not shift later items."""
    items = [Item(n * 10_000_000) for n in range(20)]
    begin_ns = time.monotonic_ns()
    delays = []
    for item, delay_ns in paced(iter(items), begin_ns, 1.0, never):
        assert time.monotonic_ns() >= begin_ns + item.offset_ns
        delays.append(delay_ns)
        if item.offset_ns == 50_000_000:
            time.sleep(0.045)
    assert max(delays) >= 25_000_000
    # One that is shifted would be late to the end.
    assert min(delays[11:]) < 20_000_000


def test_paced_stops_between_items() -> None:
    begin_s = time.monotonic()
    stop_at_s = begin_s + 0.2
    far = iter([Item(0), Item(60 * 10**9)])

    def stopped() -> bool:
        return time.monotonic() > stop_at_s

    assert len(list(paced(far, time.monotonic_ns(), 1.0, stopped))) == 1
    assert time.monotonic() - begin_s < 1.0


def failing(fail: Callable[[], None]) -> Iterator[Item]:
    yield Item(0)
    fail()
    yield Item(1)


def test_read_ahead_passes_errors_on() -> None:
    def fail() -> None:
        raise UsageError("the bag is damaged")

    with ReadAhead(failing(fail)) as ahead, pytest.raises(UsageError, match="damaged"):
        list(ahead)
    with ReadAhead(failing(lambda: None)) as ahead:
        assert [item.offset_ns for item in ahead] == [0, 1]


def test_read_ahead_can_end_early() -> None:
    endless = (Item(n) for n in iter(int, 1))
    with ReadAhead(endless) as ahead:
        assert next(iter(ahead)).offset_ns == 0
    assert not ahead._thread.is_alive()


def test_read_ahead_ends_while_nothing_is_ready() -> None:
    """As while it reads through an hour of a bag that is not played."""
    begin_s = time.monotonic()

    def stopped() -> bool:
        return time.monotonic() > begin_s + 0.3

    def nothing() -> Iterator[Item]:
        while not stopped():
            time.sleep(0.01)
        yield from ()

    with ReadAhead(nothing(), stopped) as ahead:
        assert list(ahead) == []
    assert time.monotonic() - begin_s < 2.0


def test_a_part_without_messages_is_not_repeated_for_ever(bag: Path) -> None:
    stats = play(
        bag, topics=["/odometry"], loop=True, clock=False, duration_s=1e-9, start_s=0.0131,
        wait_for_subscribers_s=0.0,
    )  # fmt: skip
    assert stats.messages == 0


def test_loops_count_towards_the_time_played(bag: Path) -> None:
    """Ended in the second of three loops of half a second."""
    done: list[float] = []

    def interrupt(played_s: float, _length_s: float) -> None:
        done.append(played_s)
        if len(done) > 1 and played_s < done[-2]:
            os.kill(os.getpid(), signal.SIGINT)

    stats = play(bag, loop=True, duration_s=0.5, wait_for_subscribers_s=0.0, progress=interrupt)
    assert stats.interrupted
    assert stats.loops == 1
    assert 0.5 <= stats.played_s < 1.0
    assert stats.played_s == pytest.approx(0.5 + done[-1], abs=0.1)
