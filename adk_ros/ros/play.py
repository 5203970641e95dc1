# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Play a bag on ROS topics in real time, with unchanged message bytes, and publish /clock.

Each message is published at an absolute time: start + (log time - first log time) / rate. A bag
that loops starts again one clock period after its end; its stamps and /clock then jump back.

Fixed transforms hold at all times: those of the whole bag are published before the first message,
and kept for later subscribers.
"""

from __future__ import annotations

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosgraph_msgs.msg import Clock

from adk_ros.bags import COMMAND_TYPES, IMU_TYPE, ODOMETRY_TYPE, Bag
from adk_ros.errors import DataError, UsageError
from adk_ros.ros.messages import split_stamp
from adk_ros.ros.pacing import ReadAhead, paced
from adk_ros.ros.restamp import Restamper
from adk_ros.ros.session import Session, message_class, stopping
from adk_ros.ros.static_transforms import has_static_transforms, static_transforms_qos

_CLOCK_NS = 10_000_000
"""ns of wall time between two messages on /clock: 100 Hz, as `ros2 bag play --clock 100`."""
_DEPTH = 1000
"""Queue depth of the publishers, messages: 1 s of a bag with 1000 messages per second."""
_SETTLE_S = 0.5
"""s to wait after discovery: right after the endpoints match, messages are still lost."""
_DISCOVERY_S = 4.0
"""s to wait for the other subscribers once one is found: DDS discovery takes up to 3 s."""
_LEAD_NS = 50_000_000
"""ns between the end of the preparation and the first message."""
_PROGRESS_NS = 100_000_000
"""ns of wall time between two progress calls."""
_MAX_DELAYS = 200_000
"""Latest delays kept for the percentiles: about 10 min of a usual bag."""


@dataclass(frozen=True)
class PlayStats:
    """
    Statistics of playing: `lateness_*_ms` is the delay of the messages after their due time.

    `played_s` is bag time, all loops together. `unheard` are the sensor topics without a
    subscriber.
    """

    messages: int
    by_topic: dict[str, int]
    loops: int
    played_s: float
    lateness_p50_ms: float
    lateness_p99_ms: float
    lateness_max_ms: float
    unheard: tuple[str, ...]
    interrupted: bool

    def to_json(self) -> dict[str, Any]:
        """Return the statistics as plain values."""
        return asdict(self)


class _Item(NamedTuple):
    """A message; without topic, a message on /clock. `offset_ns` since the start of loop 1."""

    offset_ns: int
    loop: int
    topic: str = ""
    content: bytes = b""


def play(
    bag_path: Path | str,
    rate: float = 1.0,
    *,
    clock: bool = True,
    loop: bool = False,
    remap: Mapping[str, str] | None = None,
    stamps: str = "original",
    topics: Collection[str] | None = None,
    start_s: float = 0.0,
    duration_s: float | None = None,
    wait_for_subscribers_s: float = 10.0,
    progress: Callable[[float, float], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> PlayStats:
    """
    Play a bag until its end or a signal.

    :param rate: playing speed relative to real time.
    :param clock: publish /clock.
    :param loop: start again at the end, until a signal.
    :param remap: topic in the bag -> topic to publish it on.
    :param stamps: "original", or "now": shift header stamps to the present (rate 1 only).
    :param topics: topics to play; default: all whose message types are installed.
    :param start_s: offset into the bag at which to start, s.
    :param duration_s: length of the part to play, s.
    :param wait_for_subscribers_s: longest wait for subscribers of the sensor topics, s; then play
        without them, after a notice. 0: do not wait.
    :param progress: called about ten times per second with (seconds played, seconds per loop).
    :param notice: called with a line to show to the user.
    :raises UsageError: an option does not fit the bag. :raises DataError: nothing to play.
    """
    if not 0.01 <= rate <= 100.0:
        raise UsageError(f"--rate {rate:g} is out of range: choose 0.01 to 100")
    if stamps not in ("original", "now"):
        raise UsageError(f"--stamps {stamps} is unknown: choose original or now")
    if stamps == "now" and rate != 1.0:
        raise UsageError("--stamps now needs --rate 1: stamps must advance with the clock")
    notify = notice or (lambda line: None)
    with Bag(bag_path) as bag:
        from_ns, length_ns = _selected_part(bag, start_s, duration_s)
        with Session("adk_play") as session, stopping() as stopped:
            player = _Player(bag, session, topics, remap or {}, notify)
            player.send_static_transforms()
            clock_ns = round(_CLOCK_NS * rate) if clock else 0
            items = player.items(from_ns, length_ns, clock_ns, loop, stopped)
            with ReadAhead(items, stopped) as ahead:
                player.wait(wait_for_subscribers_s, stopped)
                begin_ns = time.monotonic_ns() + _LEAD_NS
                shift_ns = time.time_ns() + _LEAD_NS - from_ns if stamps == "now" else 0
                for item, late_ns in paced(iter(ahead), begin_ns, rate, stopped):
                    player.send(item, late_ns, from_ns, length_ns, shift_ns)
                    if progress is not None and player.progress_due(rate):
                        progress(player.played_ns * 1e-9, length_ns * 1e-9)
            stats = player.stats(stopped())
        for line in (*bag.warnings, *player.unshifted()):
            notify(line)
        return stats


def _selected_part(bag: Bag, start_s: float, duration_s: float | None) -> tuple[int, int]:
    """Return start (log time) and length of the part to play, in ns."""
    whole_ns = bag.end_ns - bag.start_ns
    if not 0.0 <= start_s <= whole_ns * 1e-9:
        raise UsageError(f"--start {start_s:g} s is outside the bag of {whole_ns * 1e-9:.1f} s")
    if duration_s is not None and not duration_s > 0.0:
        raise UsageError(f"--duration {duration_s:g} s is out of range: choose more than 0")
    start_ns = round(start_s * 1e9)
    remaining_ns = whole_ns - start_ns
    length_ns = remaining_ns if duration_s is None else min(remaining_ns, round(duration_s * 1e9))
    return bag.start_ns + start_ns, length_ns


class _Player:
    """Publishers for one bag, and the counts while it plays."""

    def __init__(
        self,
        bag: Bag,
        session: Session,
        topics: Collection[str] | None,
        remap: Mapping[str, str],
        notify: Callable[[str], None],
    ) -> None:
        self.played_ns = 0
        self._earlier_loops_ns = 0
        self._bag = bag
        self._session = session
        self._notify = notify
        self._publishers: dict[str, Any] = {}
        self._static: list[str] = []
        self._sensors: list[str] = []
        self._unheard: tuple[str, ...] = ()
        self._restamper = Restamper()
        self._counts: Counter[str] = Counter()
        self._late_ns: deque[int] = deque(maxlen=_MAX_DELAYS)
        self._loops = 0
        self._progress_ns = 0
        names = {info.name for info in bag.topics}
        for name in (*remap, *(topics or ())):
            if name not in names:
                raise UsageError(f"bag {bag.path} has no topic {name}; it has {bag.summary()}")
        for info in bag.topics:
            if info.count and (topics is None or info.name in topics):
                self._advertise(
                    info.name,
                    info.msgtype,
                    remap.get(info.name, info.name),
                    named=topics is not None,
                )
        if not self._publishers:
            raise DataError(f"bag {bag.path} has no playable topic; it has {bag.summary()}")
        self._sensors = self._sensors or list(self._publishers)
        self._clock_out = session.node.create_publisher(Clock, "/clock", 10)

    def _advertise(self, topic: str, msgtype: str, name: str, *, named: bool) -> None:
        try:
            kind = message_class(msgtype, f"topic {topic}")
        except UsageError as error:
            if named:
                raise
            self._notify(f"{error}; the topic is not played")
            return
        full_name = self._session.resolve(name)
        is_static = has_static_transforms(full_name)
        qos = static_transforms_qos(_DEPTH) if is_static else _DEPTH
        self._publishers[topic] = self._session.node.create_publisher(kind, full_name, qos)
        if is_static:
            self._static.append(topic)
        self._restamper.add(topic, kind)
        if msgtype in (IMU_TYPE, ODOMETRY_TYPE, *COMMAND_TYPES.values()):
            self._sensors.append(topic)

    def send_static_transforms(self) -> None:
        """Publish all fixed transforms of the bag."""
        for topic, _type, _log_ns, content in self._bag.raw(self._static):
            self._publishers[topic].publish(content)
            self._counts[topic] += 1

    def wait(self, limit_s: float, stopped: Callable[[], bool]) -> None:
        """
        Wait for a subscriber of each sensor topic, at most `limit_s`.

        Once one topic has a subscriber, the others are waited for only a few seconds: a node may
        not need all of them.
        """
        if limit_s <= 0.0:
            return
        begin_s = time.monotonic()
        deadline_s = begin_s + limit_s
        while (unheard := self._without_subscriber()) and not stopped():
            now_s = time.monotonic()
            if now_s > deadline_s:
                names = ", ".join(unheard)
                waited_s = now_s - begin_s
                self._notify(f"no subscriber to {names} after {waited_s:.1f} s: playing anyway")
                break
            if len(unheard) < len(self._sensors):
                deadline_s = min(deadline_s, now_s + _DISCOVERY_S)
            self._session.spin(0.05)
        self._unheard = unheard
        if not stopped():
            time.sleep(_SETTLE_S)

    def _without_subscriber(self) -> tuple[str, ...]:
        sensors = [self._publishers[topic] for topic in self._sensors]
        return tuple(p.topic_name for p in sensors if not p.get_subscription_count())

    def unshifted(self) -> list[str]:
        """Return a line for each topic with stamps that could not be shifted to the present."""
        return [
            f"{topic}: {n} messages keep their stamp: shifted, it is beyond the range of ROS time"
            for topic, n in self._restamper.unshifted.items()
        ]

    def items(
        self,
        from_ns: int,
        length_ns: int,
        clock_ns: int,
        loop: bool,
        stopped: Callable[[], bool],
    ) -> Iterator[_Item]:
        """
        Yield messages in order, and a /clock item every `clock_ns` of bag time (0: none).

        Messages end once `stopped`; no loop follows one without any item.
        """
        count = 0
        while True:
            begin_ns = count * (length_ns + _CLOCK_NS)
            messages = self._messages(from_ns, length_ns, begin_ns, count, stopped)
            clock = (
                _Item(begin_ns + offset_ns, count)
                for offset_ns in range(0, length_ns + 1, clock_ns or length_ns + 1)
            )
            played = False
            for item in heapq.merge(
                clock if clock_ns else (), messages, key=lambda x: x.offset_ns
            ):
                played = True
                yield item
            count += 1
            if not (loop and played) or stopped():
                return

    def _messages(
        self,
        from_ns: int,
        length_ns: int,
        begin_ns: int,
        count: int,
        stopped: Callable[[], bool],
    ) -> Iterator[_Item]:
        played = [topic for topic in self._publishers if topic not in self._static]
        for topic, _type, log_ns, content in self._bag.raw(played):
            if log_ns > from_ns + length_ns or stopped():
                return
            if log_ns >= from_ns:
                yield _Item(begin_ns + log_ns - from_ns, count, topic, content)

    def send(self, item: _Item, late_ns: int, from_ns: int, length_ns: int, shift_ns: int) -> None:
        """Publish an item; `shift_ns` shifts stamps to the present, 0 keeps them."""
        begin_ns = item.loop * (length_ns + _CLOCK_NS)
        self._loops = item.loop
        self._earlier_loops_ns = item.loop * length_ns
        self.played_ns = item.offset_ns - begin_ns
        if not item.topic:
            message = Clock()
            stamp_ns = from_ns + (item.offset_ns + shift_ns if shift_ns else self.played_ns)
            message.clock.sec, message.clock.nanosec = split_stamp(stamp_ns)
            self._clock_out.publish(message)
            return
        content = item.content
        if shift_ns:
            content = self._restamper.shift(item.topic, content, shift_ns + begin_ns)
        self._publishers[item.topic].publish(content)
        self._counts[item.topic] += 1
        self._late_ns.append(late_ns)

    def progress_due(self, rate: float) -> bool:
        """Return whether 0.1 s has passed since the last time that this was True."""
        due = abs(self.played_ns - self._progress_ns) >= _PROGRESS_NS * rate
        if due:
            self._progress_ns = self.played_ns
        return due

    def stats(self, interrupted: bool) -> PlayStats:
        """Return the statistics."""
        late_ms = np.array(self._late_ns or [0]) * 1e-6
        p50, p99, maximum = np.percentile(late_ms, (50, 99, 100)).tolist()
        return PlayStats(
            messages=sum(self._counts.values()),
            by_topic=dict(self._counts),
            loops=self._loops if interrupted else self._loops + 1,
            played_s=(self._earlier_loops_ns + self.played_ns) * 1e-9,
            lateness_p50_ms=p50,
            lateness_p99_ms=p99,
            lateness_max_ms=maximum,
            unheard=self._unheard,
            interrupted=interrupted,
        )
