# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Write new rosbag2 recordings."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
    Writer,
    WriterError,
)

from adk_ros.bags.storage import END_OF_TIME
from adk_ros.bags.typestores import jazzy
from adk_ros.errors import UsageError

_PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


def check_storage(storage: str, compression: str | None) -> None:
    """
    Check what `BagWriter` is to write.

    :raises UsageError: storage or compression is unknown.
    """
    if storage not in _PLUGINS:
        raise UsageError(f"storage {storage!r} is unknown: choose mcap or sqlite3")
    if compression not in {None, "zstd"}:
        raise UsageError(f"compression {compression!r} is unknown: choose zstd or none")


class BagWriter:
    """
    A new rosbag2 folder at `path`, open for writing; a context manager.

    `storage` is "mcap" or "sqlite3"; `compression` is None or "zstd", which compresses the chunks
    of an mcap file, or a sqlite3 file as a whole: single messages of some hundred bytes hardly
    shrink. After an exception the bag is closed properly with the messages written so far.

    :raises UsageError: `path` exists or cannot be written, or an argument is unknown.
    """

    def __init__(
        self, path: Path | str, storage: str = "mcap", compression: str | None = None
    ) -> None:
        self.path = Path(path)
        check_storage(storage, compression)
        if self.path.exists():
            raise UsageError(f"{self.path} exists already: choose another --out or remove it")
        self._connections: dict[str, Connection] = {}
        with self._usage_errors():
            self._writer: Writer | None = Writer(
                self.path, version=9, storage_plugin=_PLUGINS[storage]
            )
            if compression == "zstd":
                mode = {"mcap": CompressionMode.STORAGE, "sqlite3": CompressionMode.FILE}
                self._writer.set_compression(mode[storage], CompressionFormat.ZSTD)
            self._writer.open()

    @contextmanager
    def _usage_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, WriterError, sqlite3.Error) as error:
            raise UsageError(f"bag {self.path} cannot be written: {error}") from error

    def _opened(self) -> Writer:
        if self._writer is None:
            raise UsageError(f"bag {self.path} is closed")
        return self._writer

    def add_topic(self, name: str, msgtype: str) -> None:
        """Declare a topic; declaring it again with the same type has no effect."""
        writer = self._opened()
        if name in self._connections:
            if (declared := self._connections[name].msgtype) != msgtype:
                raise UsageError(f"bag {self.path}: {name} is declared as {declared} already")
            return
        if msgtype not in jazzy().types:
            raise UsageError(f"bag {self.path}: {name}: message type {msgtype} is unknown")
        with self._usage_errors():
            self._connections[name] = writer.add_connection(name, msgtype, typestore=jazzy())

    def write(self, topic: str, msg: Any, log_ns: int) -> None:
        """Write a message (an object as from `message`, or CDR bytes) with its log time in ns."""
        writer = self._opened()
        if topic not in self._connections:
            raise UsageError(f"bag {self.path}: topic {topic} was not declared")
        if not 0 <= log_ns < END_OF_TIME:
            raise UsageError(f"bag {self.path}: {topic}: log time {log_ns} ns is out of range")
        connection = self._connections[topic]
        if not isinstance(msg, bytes | bytearray | memoryview):
            msg = jazzy().serialize_cdr(msg, connection.msgtype)
        with self._usage_errors():
            writer.write(connection, log_ns, msg)

    def close(self) -> None:
        """Write the index and `metadata.yaml`; a second call has no effect."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with self._usage_errors():
                writer.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
