# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rosbag2 databases that are truncated or were not closed (SQLite 3, sqlite.org/fileformat)."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

from adk_ros.bags.recovery import Scan
from adk_ros.bags.storage import END_OF_TIME, Channel, RawMessage

SQLITE_MAGIC = b"SQLite format 3\x00"

# Sections 1.3 and 1.6 of the file format.
_HEADER_SIZE = 100
_MIN_PAGE_SIZE = 512
_TABLE_LEAF = b"\x0d"


class SqliteScan(Scan):
    """
    A rosbag2 database, read page by page rather than through its b-trees.

    Inner pages of a b-tree are written after the leaves below them, so after truncation most
    remaining rows cannot be reached from the root. A leaf of the message table is recognised by
    its rows: (NULL, topic, time, blob).
    """

    def __init__(self, path: Path) -> None:
        self._rows = (END_OF_TIME, 0)
        super().__init__(path)

    def _walk(self) -> None:
        super()._walk()
        first, last = self._rows
        count = sum(channel.count for channel in self.channels)
        # rosbag2 numbers its rows consecutively.
        if count and last - first + 1 > count:
            self._note(
                f"{last - first + 1 - count} messages are missing before its last readable message"
            )

    def _blocks(self) -> Iterator[int]:
        head = self._at(0, _HEADER_SIZE).ljust(_HEADER_SIZE, b"\x00")
        self._page, pages = sqlite_pages(head)
        self._usable = self._page - head[20]
        if self._page < _MIN_PAGE_SIZE or self._size < self._page:
            self._note("its first page is incomplete")
            return
        self._topics()
        if self._size < self._page * pages:
            self._note("it ends before its last page")
        elif self._size > self._page * pages:
            self._note("it was not closed")
        for offset in range(self._page, self._size - self._page + 1, self._page):
            if self._at(offset, 1) == _TABLE_LEAF:
                yield offset

    def _topics(self) -> None:
        topics: list[tuple[int, str, str, str]] = []
        definitions: dict[str, tuple[str, str]] = {}
        address = f"file:{quote(str(self.path))}?immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as database:
            database.text_factory = lambda raw: raw.decode(errors="replace")
            try:
                # Without this, SQLite refuses a file that is shorter than its header states.
                database.execute("PRAGMA writable_schema=ON")
                topics += database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            except sqlite3.Error as error:
                self._note(str(error))
            # Before ROS 2 Iron there is no such table; types are then those of the distribution.
            with suppress(sqlite3.Error):
                for msgtype, encoding, text in database.execute(
                    "SELECT topic_type, encoding, encoded_message_definition"
                    " FROM message_definitions"
                ):
                    definitions[msgtype] = (text, encoding)
        for key, *names in topics:
            # In a damaged database a name can have any type.
            topic, msgtype, encoding = map(str, names)
            text, form = map(str, definitions.get(msgtype, ("", "")))
            self._declared[key] = Channel(key, topic, msgtype, encoding, text, form, 0)

    def _read(self, offset: int) -> list[RawMessage]:
        page = self._at(offset, self._page)
        found: list[RawMessage] = []
        for i in range(int.from_bytes(page[3:5], "big")):
            pointer = int.from_bytes(page[8 + 2 * i : 10 + 2 * i], "big")
            try:
                size, position = _varint(page, pointer)
                row, position = _varint(page, position)
                record = self._payload(page, position, size)
                message = _message_row(record)
            except IndexError:
                continue
            if message is not None:
                self._rows = (min(row, self._rows[0]), max(row, self._rows[1]))
                found.append(message)
        return found

    def _payload(self, page: bytes, position: int, size: int) -> bytes:
        """Return a cell's payload, its overflow pages included (file format, section 1.6)."""
        usable = self._usable
        if size > self._size:
            raise IndexError("a length beyond the file")
        if size <= usable - 35:
            return page[position : position + size]
        minimum = (usable - 12) * 32 // 255 - 23
        local = minimum + (size - minimum) % (usable - 4)
        local = local if local <= usable - 35 else minimum
        payload = bytearray(page[position : position + local])
        following = page[position + local : position + local + 4]
        while len(payload) < size:
            number = int.from_bytes(following, "big")
            overflow = self._at((number - 1) * self._page, self._page) if number else b""
            if len(overflow) < self._page:
                raise IndexError("an overflow page is beyond the end of the file")
            following = overflow[:4]
            payload += overflow[4 : min(usable, 4 + size - len(payload))]
        return bytes(payload)


def sqlite_pages(head: bytes) -> tuple[int, int]:
    """Return page size in bytes and number of pages of a database, from its first 32 bytes."""
    size = int.from_bytes(head[16:18], "big")
    return 65536 if size == 1 else size, int.from_bytes(head[28:32], "big")


def _varint(data: bytes, position: int) -> tuple[int, int]:
    value = 0
    for i in range(8):
        byte = data[position + i]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, position + i + 1
    return value << 8 | data[position + 8], position + 9


def _message_row(record: bytes) -> RawMessage | None:
    """Return the message in a row (NULL, integer, integer, blob), else None."""
    header, position = _varint(record, 0)
    kinds: list[int] = []
    while position < header and len(kinds) < 5:
        kind, position = _varint(record, position)
        kinds.append(kind)
    if len(kinds) != 4 or kinds[0] != 0 or kinds[3] < 12 or kinds[3] % 2:
        return None
    numbers: list[int] = []
    for kind in kinds[1:3]:
        if kind in {8, 9}:
            numbers.append(kind - 8)
        elif 1 <= kind <= 6:
            width = (1, 2, 3, 4, 6, 8)[kind - 1]
            numbers.append(int.from_bytes(record[position : position + width], "big", signed=True))
            position += width
        else:
            return None
    data = record[position : position + (kinds[3] - 12) // 2]
    if len(data) < (kinds[3] - 12) // 2:
        raise IndexError("the row is incomplete")
    return RawMessage(numbers[0], numbers[1], data)
