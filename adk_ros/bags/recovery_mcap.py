# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP files without a usable index (MCAP 0, mcap.dev/spec)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from adk_ros.bags.compression import inflate
from adk_ros.bags.recovery import NO_INDEX, Scan
from adk_ros.bags.storage import END_OF_TIME, Channel, RawMessage, ros2_type

MCAP_MAGIC = b"\x89MCAP0\r\n"

# Record types, section "Records" of the specification.
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_PRIVATE = 0x80
_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")


class McapScan(Scan):
    """An MCAP file, with or without chunks (lz4, zstd, none), read without its summary."""

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, tuple[str, str, str]] = {}
        super().__init__(path)

    def _blocks(self) -> Iterator[int]:
        position = len(MCAP_MAGIC)
        ended = False
        while position + _RECORD_HEAD.size <= self._size:
            op, length = _RECORD_HEAD.unpack(self._at(position, _RECORD_HEAD.size))
            body = position + _RECORD_HEAD.size
            complete = body + length <= self._size
            if op == 0 or _DATA_END < op < _PRIVATE or not (complete or op == _CHUNK):
                break
            if op == _FOOTER:
                return
            if op in {_SCHEMA, _CHANNEL}:
                self._declare(op, self._at(body, length))
            elif op in {_MESSAGE, _CHUNK} and not ended:
                yield position
            ended = ended or op == _DATA_END
            position = body + length
        self._note("no message is lost, but the index is missing" if ended else NO_INDEX)

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
            self._note(f"the chunk at byte {offset} has a wrong checksum and is skipped")
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
