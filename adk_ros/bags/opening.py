# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Open a storage file by its index, or scan it if the index is missing or damaged."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import Reader
from rosbags.rosbag2 import ReaderError as Ros2ReaderError

from adk_ros.bags.compression import ZSTD_MAGIC, inflate_file
from adk_ros.bags.indexed import Indexed, NoIndex
from adk_ros.bags.recovery import Scan
from adk_ros.bags.recovery_mcap import MCAP_MAGIC, McapScan
from adk_ros.bags.recovery_ros1 import ROS1_MAGIC, Ros1Scan
from adk_ros.bags.recovery_sqlite import SQLITE_MAGIC, SqliteScan, sqlite_pages
from adk_ros.bags.storage import Storage


class NoBagError(Exception):
    """A storage file is empty or of an unknown format."""


class StorageFile(NamedTuple):
    """An opened storage file, and a function that opens it without its index."""

    name: str
    storage: Storage
    scan: Callable[[], Scan]


def open_storage(path: Path, stack: ExitStack) -> StorageFile:
    """
    Open a storage file, whatever its name; closing `stack` closes it.

    :raises NoBagError: it is empty, or of an unknown format.
    :raises OSError: it cannot be read.
    """
    file = path
    head = _head(file)
    if head[:4] == ZSTD_MAGIC:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bag_")))
        file = folder / path.stem
        inflate_file(path, file)
        head = _head(file)
    reader: Any
    scan: type[Scan]
    if head.startswith(MCAP_MAGIC):
        reader, scan = Reader.STORAGE_PLUGINS[".mcap"], McapScan
    elif head.startswith(SQLITE_MAGIC):
        file = _with_write_ahead_log(file, stack)
        reader, scan = Reader.STORAGE_PLUGINS[".db3"], SqliteScan
    elif head.startswith(ROS1_MAGIC):
        reader, scan = Ros1Reader, Ros1Scan
    else:
        fault = "is neither MCAP, SQLite nor a ROS 1 bag (CSV is not read)"
        raise NoBagError(fault if head else "is empty")
    storage: Storage | None = None
    reason = ""
    # SQLite silently returns only the rows that the b-tree of a truncated file still reaches.
    if scan is not SqliteScan or _is_whole(file):
        try:
            storage = Indexed(reader(file))
        except (NoIndex, Ros1ReaderError, Ros2ReaderError):
            # Of another writer, or damaged: the scan below reads it, and reports what is damaged.
            pass
        except Exception as error:
            # The parsers may fail in any way on an untrusted file. The scan reads it too; if it
            # finds no damage, the reason is reported.
            reason = f"its index is not readable ({type(error).__name__}: {error})"
    if storage is None:
        storage = scan(file)
        storage.fault = storage.fault or reason
    stack.callback(storage.close)
    return StorageFile(path.name, storage, lambda: scan(file))


def _head(file: Path) -> bytes:
    """Return the first bytes, which identify the format and the size of a database."""
    with file.open("rb") as stream:
        return stream.read(32)


def _is_whole(database: Path) -> bool:
    """Return whether an SQLite file is as long as its header states."""
    size, pages = sqlite_pages(_head(database))
    return size * pages == database.stat().st_size


def _with_write_ahead_log(file: Path, stack: ExitStack) -> Path:
    """Return a copy of a database with its write-ahead log applied: bags are never modified."""
    log = file.with_name(file.name + "-wal")
    if not log.is_file() or not log.stat().st_size:
        return file
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="adk_bag_")))
    copy = folder / file.name
    shutil.copyfile(file, copy)
    shutil.copyfile(log, folder / log.name)
    with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return copy
