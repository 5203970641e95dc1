# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shift the header stamp of a serialised message in time."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

_STAMP_OFFSET = 4
"""Byte offset of a stamp that is the first field: the CDR header takes 4 bytes."""
_STAMPED_FIRST_FIELDS = ("std_msgs/Header", "builtin_interfaces/Time")


class Restamper:
    """Shifts the stamps of the topics whose messages begin with one."""

    def __init__(self) -> None:
        self._stamped: set[str] = set()
        self.unshifted: Counter[str] = Counter()
        """Messages by topic whose shifted stamp would be beyond the range of ROS time."""

    def add(self, topic: str, message_class: Any) -> None:
        """Register the message class of a topic."""
        kinds = list(message_class.get_fields_and_field_types().values())
        if kinds and kinds[0] in _STAMPED_FIRST_FIELDS:
            self._stamped.add(topic)

    def shift(self, topic: str, content: bytes, shift_ns: int) -> bytes:
        """Return the CDR message with its stamp shifted, if it has one that stays in range."""
        if topic not in self._stamped or len(content) < _STAMP_OFFSET + 8:
            return content
        # The second byte of the CDR header is even for big-endian.
        stamp = struct.Struct("<iI" if content[1] & 1 else ">iI")
        sec, nanosec = stamp.unpack_from(content, _STAMP_OFFSET)
        new_stamp = divmod(sec * 1_000_000_000 + nanosec + shift_ns, 1_000_000_000)
        if not -(2**31) <= new_stamp[0] < 2**31:
            self.unshifted[topic] += 1
            return content
        shifted = bytearray(content)
        stamp.pack_into(shifted, _STAMP_OFFSET, *new_stamp)
        return bytes(shifted)
