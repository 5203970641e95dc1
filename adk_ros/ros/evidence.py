# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The latest messages of the inputs, in bounded memory, and the bag that is made of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from adk_ros.bags import BagWriter

SPAN_S = 300.0
"""s of messages kept: the ring of the watch (180 s), and two minutes for late naming."""
MAX_BYTES = 256_000_000
"""Most bytes kept: a span of an IMU at 1000 Hz with 400 bytes a message, and reserve."""
_SLICE = 1000
"""Messages written between two pauses: some 20 ms."""


class StampedMessage(NamedTuple):
    """A received message: topic, header stamp in ns, CDR."""

    topic: str
    stamp_ns: int
    content: bytes


class Evidence:
    """Keeps the messages of the last `SPAN_S`; `types`: topic -> message type."""

    def __init__(self, types: Mapping[str, str]) -> None:
        self._types = dict(types)
        self._kept: deque[StampedMessage] = deque()
        self._bytes = 0

    def add(self, message: StampedMessage) -> None:
        """Add a message, and forget those that are too old or too many."""
        self._kept.append(message)
        self._bytes += len(message.content)
        oldest_ns = message.stamp_ns - round(SPAN_S * 1e9)
        while self._bytes > MAX_BYTES or self._kept[0].stamp_ns < oldest_ns:
            self._bytes -= len(self._kept.popleft().content)

    def clear(self) -> None:
        """Forget all messages."""
        self._kept.clear()
        self._bytes = 0

    def write(self, path: Path, begin_ns: int, end_ns: int) -> Iterator[None]:
        """
        Write the messages of a time span into a new bag; yield between slices.

        :raises UsageError: the bag cannot be written.
        """
        chosen = [item for item in self._kept if begin_ns <= item.stamp_ns <= end_ns]
        with BagWriter(path) as bag:
            for topic, msgtype in self._types.items():
                bag.add_topic(topic, msgtype)
            for i, item in enumerate(chosen):
                bag.write(item.topic, item.content, item.stamp_ns)
                if i % _SLICE == _SLICE - 1:
                    yield
