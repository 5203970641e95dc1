# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Plays a bag over ROS in real time, byte for byte, with /clock.

Each message goes out at an absolute time, begin + (log time - first log time) / rate. A bag that
loops begins again one clock tick after its end; its stamps, and /clock, then jump back.
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

_CLOCK_NS = 10_000_000
"""/clock comes at 100 Hz of wall time."""
_DEPTH = 1000
_SETTLE_S = 0.5
"""After the endpoints have matched, messages are still lost for a moment."""
_STRAGGLERS_S = 4.0
"""Discovery of one more endpoint of a process that is known already takes up to 3 s."""
_LEAD_NS = 50_000_000
_PROGRESS_NS = 100_000_000
_LATENESS_KEPT = 200_000


@dataclass(frozen=True)
class PlayStats:
    """
    What was played: `lateness_*_ms` is how long after their due time messages were handed over.

    `played_s` is bag time. `unheard` are topics of the sensors that nobody listened to.
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
        """As plain values, for a program to read."""
        return asdict(self)


class _Item(NamedTuple):
    """A message, or without a topic a tick of /clock; `offset_ns` from the begin of all loops."""

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

    :param rate: times real time. :param loop: begin again at the end, until a signal.
    :param remap: topic in the bag -> name to publish it as.
    :param stamps: "original", or "now": header stamps as if it happened now (rate 1 alone).
    :param topics: those to play; by default all whose message types are installed.
    :param start_s: begin so far into the bag. :param duration_s: play so much of it.
    :param wait_for_subscribers_s: wait so long for somebody to listen to the sensors' topics,
        and go on, with a notice, if nobody does; 0: do not wait.
    :param progress: called about ten times a second with (seconds played, seconds of a loop).
    :param notice: called with a line for a person.
    :raises UsageError: an option does not fit the bag. :raises DataError: nothing to play.
    """
    if not 0.01 <= rate <= 100.0:
        raise UsageError(f"--rate {rate:g} is out of range: choose 0.01 to 100")
    if stamps not in ("original", "now"):
        raise UsageError(f"--stamps {stamps} is unknown: choose original or now")
    if stamps == "now" and rate != 1.0:
        raise UsageError("--stamps now needs --rate 1: stamps must go as fast as the clock")
    tell = notice or (lambda line: None)
    with Bag(bag_path) as bag:
        from_ns, length_ns = _part(bag, start_s, duration_s)
        with Session("adk_play") as session, stopping() as stopped:
            player = _Player(bag, session, topics, remap or {}, tell)
            items = player.items(from_ns, length_ns, round(_CLOCK_NS * rate) if clock else 0, loop)
            with ReadAhead(items) as ahead:
                player.wait(wait_for_subscribers_s, stopped)
                begin_ns = time.monotonic_ns() + _LEAD_NS
                shift_ns = time.time_ns() + _LEAD_NS - from_ns if stamps == "now" else 0
                for item, late_ns in paced(iter(ahead), begin_ns, rate, stopped):
                    player.send(item, late_ns, from_ns, length_ns, shift_ns)
                    if progress is not None and player.progress_due(rate):
                        progress(player.played_ns * 1e-9, length_ns * 1e-9)
            stats = player.stats(stopped())
        for line in bag.warnings:
            tell(line)
        return stats


def _part(bag: Bag, start_s: float, duration_s: float | None) -> tuple[int, int]:
    """Return the part to play: from when, and for how long, in ns of log time."""
    whole_ns = bag.end_ns - bag.start_ns
    if not 0.0 <= start_s <= whole_ns * 1e-9:
        raise UsageError(f"--start {start_s:g} s lies outside the bag of {whole_ns * 1e-9:.1f} s")
    if duration_s is not None and not duration_s > 0.0:
        raise UsageError(f"--duration {duration_s:g} s: choose more than 0")
    start_ns = round(start_s * 1e9)
    left_ns = whole_ns - start_ns
    length_ns = left_ns if duration_s is None else min(left_ns, round(duration_s * 1e9))
    return bag.start_ns + start_ns, length_ns


class _Player:
    """Publishers for one bag, and what is counted while it plays."""

    def __init__(
        self,
        bag: Bag,
        session: Session,
        topics: Collection[str] | None,
        remap: Mapping[str, str],
        tell: Callable[[str], None],
    ) -> None:
        self.played_ns = 0
        self._bag = bag
        self._session = session
        self._tell = tell
        self._publishers: dict[str, Any] = {}
        self._sensors: list[str] = []
        self._unheard: tuple[str, ...] = ()
        self._restamper = Restamper()
        self._counts: Counter[str] = Counter()
        self._late_ns: deque[int] = deque(maxlen=_LATENESS_KEPT)
        self._loops = 0
        self._told_ns = 0
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
            raise DataError(f"bag {bag.path} has nothing to play; it has {bag.summary()}")
        self._sensors = self._sensors or list(self._publishers)
        self._clock_out = session.node.create_publisher(Clock, "/clock", 10)

    def _advertise(self, topic: str, msgtype: str, name: str, *, named: bool) -> None:
        try:
            kind = message_class(msgtype, f"topic {topic}")
        except UsageError as error:
            if named:
                raise
            self._tell(f"{error}: not played")
            return
        full_name = self._session.resolve(name)
        self._publishers[topic] = self._session.node.create_publisher(kind, full_name, _DEPTH)
        self._restamper.add(topic, kind)
        if msgtype in (IMU_TYPE, ODOMETRY_TYPE, *COMMAND_TYPES.values()):
            self._sensors.append(topic)

    def wait(self, limit_s: float, stopped: Callable[[], bool]) -> None:
        """
        Wait for somebody to listen to each of the sensors' topics.

        Once somebody listens to one of them, the others have a few seconds: who listens to some
        may not want the rest.
        """
        if limit_s <= 0.0:
            return
        begin_s = time.monotonic()
        deadline_s = begin_s + limit_s
        while (unheard := self._without_listener()) and not stopped():
            now_s = time.monotonic()
            if now_s > deadline_s:
                names = ", ".join(unheard)
                waited_s = now_s - begin_s
                self._tell(
                    f"nobody listens to {names} after {waited_s:.1f} s: played all the same"
                )
                break
            if len(unheard) < len(self._sensors):
                deadline_s = min(deadline_s, now_s + _STRAGGLERS_S)
            self._session.spin(0.05)
        self._unheard = unheard
        if not stopped():
            time.sleep(_SETTLE_S)

    def _without_listener(self) -> tuple[str, ...]:
        sensors = [self._publishers[topic] for topic in self._sensors]
        return tuple(p.topic_name for p in sensors if not p.get_subscription_count())

    def items(self, from_ns: int, length_ns: int, clock_ns: int, loop: bool) -> Iterator[_Item]:
        """Messages and, every `clock_ns` of bag time, ticks of /clock, in order; 0: no /clock."""
        count = 0
        while True:
            begin_ns = count * (length_ns + _CLOCK_NS)
            messages = self._messages(from_ns, length_ns, begin_ns, count)
            ticks = (
                _Item(begin_ns + offset_ns, count)
                for offset_ns in range(0, length_ns + 1, clock_ns or length_ns + 1)
            )
            yield from heapq.merge(ticks if clock_ns else (), messages, key=lambda x: x.offset_ns)
            count += 1
            if not loop:
                return

    def _messages(
        self, from_ns: int, length_ns: int, begin_ns: int, count: int
    ) -> Iterator[_Item]:
        for topic, _type, log_ns, content in self._bag.raw(list(self._publishers)):
            if log_ns > from_ns + length_ns:
                return
            if log_ns >= from_ns:
                yield _Item(begin_ns + log_ns - from_ns, count, topic, content)

    def send(self, item: _Item, late_ns: int, from_ns: int, length_ns: int, shift_ns: int) -> None:
        """Publish an item; `shift_ns` moves stamps to the present, 0 leaves them."""
        begin_ns = item.loop * (length_ns + _CLOCK_NS)
        self._loops = item.loop
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
        """Whether a tenth of a second has gone by since the last yes."""
        due = abs(self.played_ns - self._told_ns) >= _PROGRESS_NS * rate
        if due:
            self._told_ns = self.played_ns
        return due

    def stats(self, interrupted: bool) -> PlayStats:
        """Sum up."""
        late_ms = np.array(self._late_ns or [0]) * 1e-6
        p50, p99, worst = np.percentile(late_ms, (50, 99, 100)).tolist()
        return PlayStats(
            messages=sum(self._counts.values()),
            by_topic=dict(self._counts),
            loops=self._loops if interrupted else self._loops + 1,
            played_s=self.played_ns * 1e-9,
            lateness_p50_ms=p50,
            lateness_p99_ms=p99,
            lateness_max_ms=worst,
            unheard=self._unheard,
            interrupted=interrupted,
        )
