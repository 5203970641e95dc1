# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read CAN logs (BLF, ASC, candump) with a DBC file: one table per message."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, UsageError, first_line
from adk_ros.importing.optional_library import optional_library
from adk_ros.importing.table import Clock, Table

READERS = {".blf": "BLFReader", ".asc": "ASCReader", ".log": "CanutilsLogReader"}
"""File suffix -> reader of python-can."""

_YEAR_S = 366 * 86_400
"""s; stamps within the first year from 1970 count from the start of the log."""


def load_databases(paths: Sequence[Path]) -> Any:
    """
    Return the messages of DBC files, in one database.

    :raises UsageError: cantools is not installed, a file is missing or not a DBC file.
    """
    cantools = optional_library("cantools", "CAN logs")
    # Overlapping signals, common in the files of manufacturers, concern other messages mostly.
    database = cantools.database.Database(strict=False)
    for path in paths:
        try:
            content = path.read_bytes()
            try:
                text = content.decode("utf-8-sig")
            except UnicodeDecodeError:
                text = content.decode("cp1252")
            database.add_dbc_string(text)
        except OSError as error:
            raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from None
        except Exception as error:  # the parser may raise anything on a file of a stranger
            raise UsageError(f"{path}: is no DBC file: {first_line(error)}") from None
    return database


def read_can_tables(path: Path, database: Any, notes: list[str]) -> list[Table]:
    """
    Return the tables of a CAN log; their clock is the time of the frames.

    A column is named `message.signal`. Frames that cannot be decoded, and identifiers that the
    database does not know, are counted in `notes`.

    :raises UsageError: python-can is not installed.
    :raises DataError: the log cannot be read, or has no frame of the database.
    """
    can = optional_library("can", "CAN logs", "python-can")
    found: dict[str, _Frames] = {}
    unknown: Counter[int] = Counter()
    bad: Counter[str] = Counter()
    frames = 0
    suffix = path.suffix.lower()
    # The date in an ASC file is the local time of the logger; without it, stamps are relative.
    options = {"relative_timestamp": False} if suffix == ".asc" else {}
    try:
        with getattr(can, READERS[suffix])(str(path), **options) as reader:
            for frame in reader:
                if frame.is_error_frame or frame.is_remote_frame:
                    continue
                frames += 1
                try:
                    message = database.get_message_by_frame_id(frame.arbitration_id)
                except KeyError:
                    unknown[frame.arbitration_id] += 1
                    continue
                try:
                    values = message.decode(frame.data, decode_choices=False)
                except Exception:  # as below
                    bad[message.name] += 1
                    continue
                if message.name not in found:
                    found[message.name] = _Frames([signal.name for signal in message.signals])
                found[message.name].add(frame.timestamp, values)
    except Exception as error:  # the parser may raise anything on a file of a stranger
        raise DataError(f"{path}: cannot be read as a CAN log: {first_line(error)}") from None
    if not frames:
        raise DataError(f"{path}: is empty: it has no CAN frame")
    if not found:
        raise DataError(f"{path}: the DBC file describes none of its {len(unknown)} identifiers")
    if unknown:
        notes.append(
            f"{path.name}: {unknown.total()} frames of {len(unknown)} identifiers that the DBC "
            "file does not describe are skipped"
        )
    for name, count in bad.items():
        notes.append(f"{path.name}: {count} frames of {name} cannot be decoded and are skipped")
    return [_table(path, database, name, found[name]) for name in sorted(found)]


class _Frames:
    """
    The frames of a message: times, s, and a column per signal, 8 bytes each.

    An hour of a busy bus has millions of frames.
    """

    def __init__(self, signals: Sequence[str]) -> None:
        self.stamps = array("d")
        self.columns = {name: array("d") for name in signals}

    def add(self, stamp_s: float, values: Mapping[str, Any]) -> None:
        """Add a frame; a multiplexed signal is absent from some."""
        self.stamps.append(stamp_s)
        for name, column in self.columns.items():
            column.append(values.get(name, math.nan))


def _table(path: Path, database: Any, name: str, frames: _Frames) -> Table:
    signals = {signal.name: signal for signal in database.get_message_by_name(name).signals}
    columns = {f"{name}.{signal}": signal for signal in signals}
    units = {
        column: str(signals[signal].unit)
        for column, signal in columns.items()
        if signals[signal].unit
    }

    def load(wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {column: np.array(frames.columns[columns[column]]) for column in wanted}

    def clock() -> Clock:
        seconds = np.array(frames.stamps)
        whole = np.floor(seconds)
        stamp_ns = whole.astype(np.int64) * 10**9
        stamp_ns += np.rint((seconds - whole) * 1e9).astype(np.int64)
        return Clock(stamp_ns, bool(seconds[0] > _YEAR_S))

    return Table(path, name, tuple(columns), load, units, clock)
