# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Shards: the samples of a recording as a file of which rows are read without reading the rest.

`NAME.npy` is a float64 array (n, 12): x (3), u (2), a (2), x_ref (3), flags, episode. NAME is the
hash of its content, so copies of a recording share a shard, and a shard never changes.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from adk_ros.errors import UsageError, first_line
from adk_ros.files.whole_file import whole_file
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Record

COLUMNS = 12
_X, _U, _A, _REFERENCE = slice(0, 3), slice(3, 5), slice(5, 7), slice(7, 10)
_FLAGS, _EPISODE = 10, 11


def write_shard(record: Record, folder: Path) -> str:
    """
    Write a record into `folder` and return the name of its shard; one that exists is kept.

    :raises OSError: the folder cannot be written, as on a full disk.
    """
    rows = np.column_stack([record.x, record.u, record.a, record.x_ref])
    rows = np.column_stack([rows, record.flags, record.episode]).astype(np.float64)
    name = f"{hashlib.sha256(rows.tobytes()).hexdigest()}.npy"
    path = folder / name
    if path.is_file():
        return name
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        np.save(file, rows, allow_pickle=False)
    return name


def read_rows(
    path: Path, start: int, stop: int, name: str, estimated: tuple[str, ...] = ()
) -> Record:
    """
    Return rows `start` to `stop` of a shard as a record of this name; stamps count from its row 0.

    :raises UsageError: the file is missing or no shard.
    """
    try:
        rows: FloatArray = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, EOFError, ValueError) as error:
        raise UsageError(
            f"{path} cannot be read: {first_line(error)}: remove it, the same command writes it "
            "again"
        ) from None
    if rows.ndim != 2 or rows.shape[1] != COLUMNS or not 0 <= start < stop <= len(rows):
        raise UsageError(
            f"{path} has no rows {start} to {stop} of {COLUMNS} values: remove it, the same "
            "command writes it again"
        )
    part = np.array(rows[start:stop])
    return Record(
        np.arange(start, stop, dtype=np.int64) * TICK_NS,
        part[:, _X].copy(),
        part[:, _U].copy(),
        part[:, _A].copy(),
        part[:, _FLAGS].astype(np.int64),
        part[:, _REFERENCE].copy(),
        part[:, _EPISODE].astype(np.int64),
        name,
        estimated,
    )
