# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Storage files that their own index does not describe: cut off, not closed, or of a foreign writer.

A recorder that is killed, a full disk and an interrupted copy leave a file without its index.
Each scan here walks such a file from the front, record by record, and keeps every message that is
whole, those in a chunk that is itself cut included. Nothing is held in memory but the place and
the first log time of each block; a block (a chunk, a database page, or one loose message) is read
again when its turn in log order has come.

Formats: MCAP 0 (mcap.dev/spec), SQLite 3 (sqlite.org/fileformat), ROS bag 2.0
(wiki.ros.org/Bags/Format/2.0).
"""

from __future__ import annotations

import bz2
import heapq
import sqlite3
import struct
import sys
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import quote

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\x00"
ROS1_MAGIC = b"#ROSBAG V2.0\n"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

END_OF_TIME = 2**63 - 1
_PIECE = 1 << 12

# MCAP record types, section "Records" of its specification.
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_PRIVATE = 0x80
_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")

# ROS bag 2.0 record types, the values of the field "op".
_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CHUNK_INFO, _ROS1_CONNECTION = b"\x02", b"\x05", b"\x06", b"\x07"

_ROS1_MOST_HEADER = 1 << 20

# SQLite file format, sections 1.3 and 1.6.
_SQLITE_HEAD = 100
_LEAST_PAGE = 512
_TABLE_LEAF = b"\x0d"

_NO_INDEX = "it ends without an index"


@dataclass(frozen=True)
class Channel:
    """A topic as one storage file declares it; `encoding` is "cdr", "ros1" or a foreign one."""

    id: int
    topic: str
    msgtype: str
    encoding: str
    definition: str
    definition_format: str
    count: int


class RawMessage(NamedTuple):
    """A message as stored: its channel's id, log time in ns, serialised bytes."""

    channel: int
    log_ns: int
    data: bytes


class Storage(Protocol):
    """One opened storage file; `fault` says why it is not whole, and is empty where it is."""

    channels: list[Channel]
    start_ns: int
    end_ns: int
    fault: str

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the channels named, in log order."""

    def close(self) -> None:
        """Release the file."""


def inflate(compression: str, data: bytes) -> bytes:
    """Decompress ("zstd", "lz4", "bz2", or "" and "none") as much of `data` as is sound."""
    if compression in {"", "none"}:
        return data
    decoder: Any
    if compression == "zstd":
        decoder = zstd.ZstdDecompressor()
    elif compression == "lz4":
        decoder = lz4.frame.LZ4FrameDecompressor()
    elif compression == "bz2":
        decoder = bz2.BZ2Decompressor()
    else:
        return b""
    out = bytearray()
    for start in range(0, len(data), _PIECE):
        try:
            out += decoder.decompress(data[start : start + _PIECE])
        except (zstd.ZstdError, RuntimeError, OSError, EOFError, ValueError):
            break
        if decoder.eof:
            break
    return bytes(out)


def inflate_file(source: Path, target: Path) -> None:
    """Decompress a zstd file as far as it is sound."""
    decoder = zstd.ZstdDecompressor()
    with source.open("rb") as packed, target.open("wb") as out:
        while piece := packed.read(_PIECE):
            try:
                out.write(decoder.decompress(piece))
                while decoder.eof and decoder.unused_data:
                    rest, decoder = decoder.unused_data, zstd.ZstdDecompressor()
                    out.write(decoder.decompress(rest))
            except zstd.ZstdError:
                return
            if decoder.eof:
                decoder = zstd.ZstdDecompressor()


def ros2_type(name: str) -> str:
    """Return a ROS 1 type name ("pkg/Type") in the ROS 2 form ("pkg/msg/Type")."""
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"


class Scan(ABC):
    """
    The walk that the formats share; a format finds the blocks and the messages in each.

    Raises:
        OSError: the file cannot be read.
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
        if nameless := sum(n for key, n in counts.items() if key not in self._declared):
            self._note(f"the topic of {nameless} messages is not declared")

    @abstractmethod
    def _blocks(self) -> Iterator[int]:
        """Yield the offsets of the blocks that hold messages, in file order."""

    @abstractmethod
    def _read(self, offset: int) -> list[RawMessage]:
        """Return the whole messages of one block, and note what channels it declares."""

    def _note(self, fault: str) -> None:
        if fault not in self.fault:
            self.fault = f"{self.fault}, {fault}" if self.fault else fault

    def _at(self, offset: int, size: int) -> bytes:
        """Return up to `size` bytes from `offset`: fewer where the file ends."""
        if not 0 <= offset < self._size:
            return b""
        self._file.seek(offset)
        return self._file.read(min(size, self._size - offset))

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the channels named, in log order."""
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
        """Release the file."""
        self._file.close()


class McapScan(Scan):
    """An MCAP file, with or without chunks (lz4, zstd, none), its summary not looked at."""

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, tuple[str, str, str]] = {}
        super().__init__(path)

    def _blocks(self) -> Iterator[int]:
        position = len(MCAP_MAGIC)
        ended = False
        while position + _RECORD_HEAD.size <= self._size:
            op, length = _RECORD_HEAD.unpack(self._at(position, _RECORD_HEAD.size))
            body = position + _RECORD_HEAD.size
            whole = body + length <= self._size
            if op == 0 or _DATA_END < op < _PRIVATE or not (whole or op == _CHUNK):
                break
            if op == _FOOTER:
                return
            if op in {_SCHEMA, _CHANNEL}:
                self._declare(op, self._at(body, length))
            elif op in {_MESSAGE, _CHUNK} and not ended:
                yield position
            ended = ended or op == _DATA_END
            position = body + length
        self._note("no message is lost, but its index is" if ended else _NO_INDEX)

    def _read(self, offset: int) -> list[RawMessage]:
        op, length = _RECORD_HEAD.unpack(self._at(offset, _RECORD_HEAD.size))
        if op == _MESSAGE:
            return self._messages_in(self._at(offset, _RECORD_HEAD.size + length))
        body = self._at(offset + _RECORD_HEAD.size, length)
        if len(body) < _CHUNK_HEAD.size:
            return []
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(body)
        name_end = _CHUNK_HEAD.size + name_length
        compression = body[_CHUNK_HEAD.size : name_end].decode(errors="replace")
        content = inflate(compression, body[name_end + 8 :])
        if len(body) == length and len(content) != size:
            self._note(f"the chunk at byte {offset} is damaged")
        elif len(content) == size and crc and zlib.crc32(content) != crc:
            self._note(f"the chunk at byte {offset} is altered and left out")
            return []
        return self._messages_in(content)

    def _messages_in(self, content: bytes) -> list[RawMessage]:
        found: list[RawMessage] = []
        end = 0
        while end + _RECORD_HEAD.size <= len(content):
            op, length = _RECORD_HEAD.unpack_from(content, end)
            start, end = end + _RECORD_HEAD.size, end + _RECORD_HEAD.size + length
            if end > len(content):
                break
            if op == _MESSAGE and length >= _MESSAGE_HEAD.size:
                channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(content, start)
                data = content[start + _MESSAGE_HEAD.size : end]
                found.append(RawMessage(channel, min(log_ns, END_OF_TIME), data))
            elif op in {_SCHEMA, _CHANNEL}:
                self._declare(op, content[start:end])
        return found

    def _declare(self, op: int, body: bytes) -> None:
        try:
            if op == _SCHEMA:
                (key,) = struct.unpack_from("<H", body)
                name, position = _string(body, 2)
                encoding, position = _string(body, position)
                self._schemas.setdefault(key, (name, encoding, _string(body, position)[0]))
                return
            key, schema = struct.unpack_from("<HH", body)
            topic, position = _string(body, 4)
            encoding, _ = _string(body, position)
        except struct.error:
            return
        name, form, definition = self._schemas.get(schema, ("", "", ""))
        channel = Channel(key, topic, ros2_type(name), encoding, definition, form, 0)
        self._declared.setdefault(key, channel)


def _string(body: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, position)
    end = position + 4 + length
    return body[position + 4 : end].decode(errors="replace"), end


class Ros1Scan(Scan):
    """A ROS 1 bag (format 2.0) that was not closed, or lost its end."""

    def _blocks(self) -> Iterator[int]:
        position = len(ROS1_MAGIC)
        indexed = False
        while (record := self._record(position)) is not None:
            fields, data, length = record
            op = fields.get(b"op")
            whole = data + length <= self._size
            if op == _ROS1_CONNECTION and whole:
                self._declare(fields, self._at(data, length))
            elif op == _ROS1_CHUNK or (op == _ROS1_MESSAGE and whole):
                yield position
            indexed = indexed or op == _ROS1_CHUNK_INFO
            if not whole:
                break
            position = data + length
        if position < self._size or not indexed:
            self._note(_NO_INDEX)

    def _record(self, position: int) -> tuple[dict[bytes, bytes], int, int] | None:
        """Return header fields, and the data's offset and length, or None at the end."""
        start = self._at(position, 4)
        if len(start) < 4:
            return None
        (length,) = struct.unpack("<I", start)
        header = self._at(position + 4, min(length, _ROS1_MOST_HEADER) + 4)
        return _ros1_record(start + header, 0, base=position)

    def _read(self, offset: int) -> list[RawMessage]:
        record = self._record(offset)
        if record is None:
            return []
        fields, data, length = record
        if fields.get(b"op") == _ROS1_MESSAGE:
            content = self._at(offset, data + length - offset)
        else:
            compression = fields.get(b"compression", b"none").decode(errors="replace")
            content = inflate(compression, self._at(data, length))
        found: list[RawMessage] = []
        position = 0
        while (inner := _ros1_record(content, position)) is not None:
            fields, data, length = inner
            if data + length > len(content):
                break
            body = content[data : data + length]
            if fields.get(b"op") == _ROS1_CONNECTION:
                self._declare(fields, body)
            elif fields.get(b"op") == _ROS1_MESSAGE and {b"conn", b"time"} <= fields.keys():
                channel = int.from_bytes(fields[b"conn"], "little")
                sec = int.from_bytes(fields[b"time"][:4], "little")
                nanosec = int.from_bytes(fields[b"time"][4:8], "little")
                found.append(RawMessage(channel, sec * 10**9 + nanosec, body))
            position = data + length
        return found

    def _declare(self, fields: dict[bytes, bytes], body: bytes) -> None:
        described = _ros1_fields(body)
        if b"conn" not in fields or b"type" not in described:
            return
        key = int.from_bytes(fields[b"conn"], "little")
        topic = fields.get(b"topic", b"").decode(errors="replace")
        msgtype = ros2_type(described[b"type"].decode(errors="replace"))
        definition = described.get(b"message_definition", b"").decode(errors="replace")
        self._declared.setdefault(
            key, Channel(key, topic, msgtype, "ros1", definition, "ros2msg", 0)
        )


def _ros1_record(
    content: bytes, position: int, base: int = 0
) -> tuple[dict[bytes, bytes], int, int] | None:
    if position + 8 > len(content):
        return None
    (length,) = struct.unpack_from("<I", content, position)
    data = position + 4 + length + 4
    if data > len(content):
        return None
    (size,) = struct.unpack_from("<I", content, data - 4)
    return _ros1_fields(content[position + 4 : data - 4]), base + data, size


def _ros1_fields(header: bytes) -> dict[bytes, bytes]:
    fields: dict[bytes, bytes] = {}
    position = 0
    while position + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, position)
        name, _, value = header[position + 4 : position + 4 + length].partition(b"=")
        fields[name] = value
        position += 4 + length
    return fields


class SqliteScan(Scan):
    """
    A rosbag2 database, read page by page rather than through its b-trees.

    The inner pages of a b-tree are written after the leaves below them, so a cut takes away the
    way to most rows that are still there. Every leaf of the table of messages is told by its rows:
    (NULL, topic, time, blob).
    """

    def __init__(self, path: Path) -> None:
        self._rows = (END_OF_TIME, 0)
        super().__init__(path)

    def _walk(self) -> None:
        super()._walk()
        first, last = self._rows
        kept = sum(channel.count for channel in self.channels)
        # rosbag2 numbers its rows without a gap.
        if kept and last - first + 1 > kept:
            self._note(f"{last - first + 1 - kept} messages before that are damaged")

    def _blocks(self) -> Iterator[int]:
        head = self._at(0, _SQLITE_HEAD).ljust(_SQLITE_HEAD, b"\x00")
        self._page, pages = sqlite_pages(head)
        self._usable = self._page - head[20]
        if self._page < _LEAST_PAGE or self._size < self._page:
            self._note("not even its first page is whole")
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
                # Without this SQLite refuses a file that is shorter than its header says.
                database.execute("PRAGMA writable_schema=ON")
                topics += database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            except sqlite3.Error as error:
                self._note(str(error))
            # Before ROS 2 Iron there is no such table: types come from the distribution then.
            with suppress(sqlite3.Error):
                for msgtype, encoding, text in database.execute(
                    "SELECT topic_type, encoding, encoded_message_definition"
                    " FROM message_definitions"
                ):
                    definitions[msgtype] = (text, encoding)
        for key, *names in topics:
            # In a damaged database a name may be of any type.
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
            raise IndexError("a length that cannot be")
        if size <= usable - 35:
            return page[position : position + size]
        least = (usable - 12) * 32 // 255 - 23
        local = least + (size - least) % (usable - 4)
        local = local if local <= usable - 35 else least
        payload = bytearray(page[position : position + local])
        following = page[position + local : position + local + 4]
        while len(payload) < size:
            number = int.from_bytes(following, "big")
            overflow = self._at((number - 1) * self._page, self._page) if number else b""
            if len(overflow) < self._page:
                raise IndexError("an overflow page lies behind the cut")
            following = overflow[:4]
            payload += overflow[4 : min(usable, 4 + size - len(payload))]
        return bytes(payload)


def sqlite_pages(head: bytes) -> tuple[int, int]:
    """Return a database's size of a page in bytes and number of pages, from its first 32 bytes."""
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
    """Return the message that a row (NULL, integer, integer, blob) holds, else None."""
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
        raise IndexError("the row is not whole")
    return RawMessage(numbers[0], numbers[1], data)
