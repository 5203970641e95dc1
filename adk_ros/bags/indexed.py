# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Storage files that rosbags reads by their index."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader

from adk_ros.bags.storage import Channel, RawMessage


class NoIndex(Exception):
    """A file is whole, but without an index of its messages."""


class Indexed:
    """
    A storage file that rosbags reads by its index.

    `reader` is an unopened reader of rosbags. It may raise any exception for a damaged file.

    :raises NoIndex: the file has no index of all its messages.
    """

    def __init__(self, reader: Any) -> None:
        self.fault = ""
        self._reader = reader
        reader.open()
        about = reader if isinstance(reader, Ros1Reader) else reader.metadata
        # An MCAP file without chunk index is not sorted; one without message count looks empty.
        if not (getattr(reader, "chunks", True) and about.message_count):
            reader.close()
            raise NoIndex
        # Counts by channel are optional in MCAP; without them each channel looks empty.
        if sum(x.msgcount for x in reader.connections) != about.message_count:
            reader.close()
            raise NoIndex
        self.start_ns: int = about.start_time
        self.end_ns: int = about.end_time - 1
        self._connections = {connection.id: connection for connection in reader.connections}
        self.channels = [
            Channel(
                x.id,
                str(x.topic),
                str(x.msgtype),
                str(getattr(x.ext, "serialization_format", "ros1")),
                str(x.msgdef.data),
                "ros2idl" if x.msgdef.format == MessageDefinitionFormat.IDL else "ros2msg",
                x.msgcount,
            )
            for x in self._connections.values()
        ]

    def messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of the given channels, in log order."""
        chosen = [self._connections[i] for i in ids]
        if chosen:
            for connection, log_ns, data in self._reader.messages(chosen):
                yield RawMessage(connection.id, log_ns, data)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
