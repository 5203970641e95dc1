# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Opening a storage file: by its index, or by a scan where there is none or it is unsound."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader

from adk_ros.bags.compression import ZSTD_MAGIC, inflate_file
from adk_ros.bags.indexed import Indexed
from adk_ros.bags.recovery import Scan
from adk_ros.bags.recovery_mcap import MCAP_MAGIC, McapScan
from adk_ros.bags.recovery_ros1 import ROS1_MAGIC, Ros1Scan
from adk_ros.bags.recovery_sqlite import SQLITE_MAGIC, SqliteScan, sqlite_pages
from adk_ros.bags.storage import Storage


class NoBagError(Exception):
    """A storage file holds nothing that can be read."""


class StorageFile(NamedTuple):
    """An opened storage file, and how to read it without its index."""

    name: str
    storage: Storage
    scan: Callable[[], Scan]


def open_storage(path: Path, stack: ExitStack) -> StorageFile:
    """
    Open a storage file, whatever it is called; closing `stack` closes it.

    Raises:
        NoBagError: it is empty, or of no format that holds a bag.
        OSError: it cannot be read.
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
        file = _with_log(file, stack)
        reader, scan = Reader.STORAGE_PLUGINS[".db3"], SqliteScan
    elif head.startswith(ROS1_MAGIC):
        reader, scan = Ros1Reader, Ros1Scan
    else:
        raise NoBagError("is neither MCAP, SQLite nor a ROS 1 bag" if head else "is empty")
    storage: Storage | None = None
    # SQLite answers for what the tree of a cut file still reaches, and is silent.
    if scan is not SqliteScan or _is_whole(file):
        try:
            storage = Indexed(reader(file))
        except Exception:
            # rosbags' parsers raise whatever they like at a file from outside. Nothing is lost:
            # the scan below reads what is there, tells of it, and raises what it cannot read.
            storage = None
    if storage is None:
        storage = scan(file)
    stack.callback(storage.close)
    return StorageFile(path.name, storage, lambda: scan(file))


def _head(file: Path) -> bytes:
    """Return the first bytes: what the file is, and how large a database should be."""
    with file.open("rb") as stream:
        return stream.read(32)


def _is_whole(database: Path) -> bool:
    """Whether an SQLite file is as long as its header says."""
    size, pages = sqlite_pages(_head(database))
    return size * pages == database.stat().st_size


def _with_log(file: Path, stack: ExitStack) -> Path:
    """Return a database with its write-ahead log worked in, in a copy: bags are never altered."""
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
