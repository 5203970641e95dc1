# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Moves the header stamp of a serialised message in time, in place: nothing else is touched."""

from __future__ import annotations

import struct
from typing import Any

_AT = 4
"""A stamp that comes first lies right behind the four bytes that begin every CDR message."""
_FIRST_FIELDS = ("std_msgs/Header", "builtin_interfaces/Time")


class Restamper:
    """Knows which topics' messages begin with a stamp."""

    def __init__(self) -> None:
        self._stamped: set[str] = set()

    def add(self, topic: str, message_class: Any) -> None:
        """Note the type of a topic."""
        kinds = list(message_class.get_fields_and_field_types().values())
        if kinds and kinds[0] in _FIRST_FIELDS:
            self._stamped.add(topic)

    def shift(self, topic: str, content: bytes, shift_ns: int) -> bytes:
        """Return the message with its stamp moved by `shift_ns`; as it is if it has none."""
        if topic not in self._stamped or len(content) < _AT + 8:
            return content
        # The second byte of CDR tells the order of bytes: even is big-endian.
        stamp = struct.Struct("<iI" if content[1] & 1 else ">iI")
        sec, nanosec = stamp.unpack_from(content, _AT)
        moved = divmod(sec * 1_000_000_000 + nanosec + shift_ns, 1_000_000_000)
        changed = bytearray(content)
        stamp.pack_into(changed, _AT, *moved)
        return bytes(changed)
