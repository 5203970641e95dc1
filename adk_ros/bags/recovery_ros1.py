# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags without a usable index (ROS bag 2.0, wiki.ros.org/Bags/Format/2.0)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from adk_ros.bags.compression import inflate
from adk_ros.bags.recovery import NO_INDEX, Scan
from adk_ros.bags.storage import Channel, RawMessage, ros2_type

ROS1_MAGIC = b"#ROSBAG V2.0\n"

# Record types, the values of the field "op".
_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION = b"\x02", b"\x05", b"\x06", b"\x07"

_MAX_HEADER = 1 << 20
"""Bytes; a longer record header is damaged: connection headers have some kilobytes at most."""


class Ros1Scan(Scan):
    """A ROS 1 bag (format 2.0) that was not closed or is truncated."""

    def _blocks(self) -> Iterator[int]:
        position = len(ROS1_MAGIC)
        indexed = False
        while (record := self._record(position)) is not None:
            fields, data, length = record
            op = fields.get(b"op")
            complete = data + length <= self._size
            if op == _CONNECTION and complete:
                self._declare(fields, self._at(data, length))
            elif op == _CHUNK or (op == _MESSAGE and complete):
                yield position
            indexed = indexed or op == _CHUNK_INFO
            if not complete:
                break
            position = data + length
        if position < self._size or not indexed:
            self._note(NO_INDEX)

    def _record(self, position: int) -> tuple[dict[bytes, bytes], int, int] | None:
        """Return header fields, data offset and data length, or None at the end."""
        start = self._at(position, 4)
        if len(start) < 4:
            return None
        (length,) = struct.unpack("<I", start)
        header = self._at(position + 4, min(length, _MAX_HEADER) + 4)
        return _record_at(start + header, 0, base=position)

    def _read(self, offset: int) -> list[RawMessage]:
        record = self._record(offset)
        if record is None:
            return []
        fields, data, length = record
        if fields.get(b"op") == _MESSAGE:
            content = self._at(offset, data + length - offset)
        else:
            compression = fields.get(b"compression", b"none").decode(errors="replace")
            content = inflate(compression, self._at(data, length))
        found: list[RawMessage] = []
        position = 0
        while (inner := _record_at(content, position)) is not None:
            fields, data, length = inner
            if data + length > len(content):
                break
            body = content[data : data + length]
            if fields.get(b"op") == _CONNECTION:
                self._declare(fields, body)
            elif fields.get(b"op") == _MESSAGE and {b"conn", b"time"} <= fields.keys():
                channel = int.from_bytes(fields[b"conn"], "little")
                sec = int.from_bytes(fields[b"time"][:4], "little")
                nanosec = int.from_bytes(fields[b"time"][4:8], "little")
                found.append(RawMessage(channel, sec * 10**9 + nanosec, body))
            position = data + length
        return found

    def _declare(self, fields: dict[bytes, bytes], body: bytes) -> None:
        described = _fields(body)
        if b"conn" not in fields or b"type" not in described:
            return
        key = int.from_bytes(fields[b"conn"], "little")
        topic = fields.get(b"topic", b"").decode(errors="replace")
        msgtype = ros2_type(described[b"type"].decode(errors="replace"))
        definition = described.get(b"message_definition", b"").decode(errors="replace")
        self._declared.setdefault(
            key, Channel(key, topic, msgtype, "ros1", definition, "ros2msg", 0)
        )


def _record_at(
    content: bytes, position: int, base: int = 0
) -> tuple[dict[bytes, bytes], int, int] | None:
    if position + 8 > len(content):
        return None
    (length,) = struct.unpack_from("<I", content, position)
    data = position + 4 + length + 4
    if data > len(content):
        return None
    (size,) = struct.unpack_from("<I", content, data - 4)
    return _fields(content[position + 4 : data - 4]), base + data, size


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields: dict[bytes, bytes] = {}
    position = 0
    while position + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, position)
        name, _, value = header[position + 4 : position + 4 + length].partition(b"=")
        fields[name] = value
        position += 4 + length
    return fields
