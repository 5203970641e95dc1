# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scan storage files without a usable index: truncated, not closed, or of another writer.

A killed recorder, a full disk and an interrupted copy leave a file without its index. A scan
walks through such a file from the front, record by record, and keeps every complete message,
including those in a truncated chunk. Only the position and the first log time of each block (a
chunk, a database page, or one loose message) are kept in memory; a block is read again when its
turn in log order comes. This module has the part that all formats share.
"""

from __future__ import annotations

import heapq
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from adk_ros.bags.storage import END_OF_TIME, Channel, RawMessage

NO_INDEX = "it ends without an index"


class Scan(ABC):
    """
    A scan; subclasses find the blocks of a format and the messages in each block.

    :raises OSError: the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fault = ""
        self.start_ns = END_OF_TIME
        self.end_ns = 0
        self.channels: list[Channel] = []
        self._declared: dict[int, Channel] = {}
        self._index: list[tuple[int, int]] = []
        self._file = path.open("rb")
        self._size = path.stat().st_size
        try:
            self._walk()
        except BaseException:
            self._file.close()
            raise

    def _walk(self) -> None:
        counts: Counter[int] = Counter()
        for offset in self._blocks():
            found = self._read(offset)
            if found:
                times = [log_ns for _, log_ns, _ in found]
                counts.update(channel for channel, _, _ in found)
                self.start_ns = min(self.start_ns, *times)
                self.end_ns = max(self.end_ns, *times)
                self._index.append((min(times), offset))
        self._index.sort()
        self.channels = [replace(x, count=counts[x.id]) for x in self._declared.values()]
        if undeclared := sum(n for key, n in counts.items() if key not in self._declared):
            self._note(f"the topic of {undeclared} messages is not declared")

    @abstractmethod
    def _blocks(self) -> Iterator[int]:
        """Yield the offsets of the blocks with messages, in file order."""

    @abstractmethod
    def _read(self, offset: int) -> list[RawMessage]:
        """Return the complete messages of one block; store the channels that it declares."""

    def _note(self, fault: str) -> None:
        if fault not in self.fault:
            self.fault = f"{self.fault}, {fault}" if self.fault else fault

    def _at(self, offset: int, size: int) -> bytes:
        """Return up to `size` bytes from `offset`, fewer at the end of the file."""
        if not 0 <= offset < self._size:
            return b""
        self._file.seek(offset)
        return self._file.read(min(size, self._size - offset))

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the given channels, in log order."""
        waiting: list[tuple[int, int, RawMessage]] = []
        number = 0
        starts = [first for first, _ in self._index[1:]] + [END_OF_TIME]
        for (_, offset), following in zip(self._index, starts, strict=False):
            for message in self._read(offset):
                if message.channel in ids:
                    heapq.heappush(waiting, (message.log_ns, number, message))
                    number += 1
            while waiting and waiting[0][0] <= following:
                yield heapq.heappop(waiting)[2]

    def close(self) -> None:
        """Close the file."""
        self._file.close()
