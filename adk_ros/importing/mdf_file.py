# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read MDF files, versions 3 and 4 (asammdf): one table per channel group."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, first_line
from adk_ros.importing.optional_library import optional_library, quiet_library
from adk_ros.importing.table import Clock, Table

_YEAR_S = 366 * 86_400
"""s; a start within the first year from 1970 is a file without a start time."""


def read_mdf_tables(path: Path) -> list[Table]:
    """
    Return the tables of an MDF file; their clock is the master channel of the group.

    :raises UsageError: asammdf is not installed.
    :raises DataError: the file cannot be read, or has no channel.
    """
    asammdf = optional_library("asammdf", "MDF")
    reason = ""
    with quiet_library("asammdf"):
        try:
            mdf = asammdf.MDF(str(path))
            start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
            groups = list(enumerate(mdf.groups))
        except Exception as error:  # the parser may raise anything on a file of a stranger
            reason = first_line(error)
        if reason:
            # asammdf fails again when a file that it could not open is discarded.
            gc.collect()
    if reason:
        raise DataError(f"{path}: cannot be read as MDF: {reason}")
    tables = []
    for index, group in groups:
        master = mdf.masters_db.get(index)
        names: dict[str, int] = {}
        units: dict[str, str] = {}
        for number, channel in enumerate(group.channels):
            if number == master:
                continue
            name = channel.name if channel.name not in names else f"{channel.name}.{number}"
            names[name] = number
            if channel.unit:
                units[name] = channel.unit
        about = str(getattr(group.channel_group, "acq_name", "") or "")
        if names and group.channel_group.cycles_nr:
            label = about if len(groups) == 1 else f"group {index}{f' {about}' if about else ''}"
            tables.append(_table(path, mdf, index, label, names, units, start_ns))
    if not tables:
        raise DataError(f"{path}: is empty: it has no channel with samples")
    return tables


def _table(
    path: Path,
    mdf: Any,
    group: int,
    label: str,
    names: dict[str, int],
    units: dict[str, str],
    start_ns: int,
) -> Table:
    def signal(number: int, **options: Any) -> Any:
        with quiet_library("asammdf"):
            try:
                # Else invalid samples are dropped, and columns of a group differ in length.
                return mdf.get(group=group, index=number, ignore_invalidation_bits=True, **options)
            except Exception as error:  # as above
                reason = first_line(error)
        raise DataError(f"{path}: a channel cannot be read: {reason}")

    def load(wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
        columns = {}
        for name in wanted:
            found = signal(names[name])
            values = np.asarray(found.samples)
            if values.dtype.kind == "S":
                values = np.array([cell.decode("latin-1") for cell in values], dtype=object)
            if values.ndim != 1:
                values = np.full(values.shape[0], np.nan)
            if found.invalidation_bits is not None and values.dtype.kind in "fiub":
                values = np.where(found.invalidation_bits, np.nan, values)
            columns[name] = values
        return columns

    @lru_cache(maxsize=1)
    def clock() -> Clock:
        seconds = np.asarray(signal(next(iter(names.values())), raw=True).timestamps)
        relative = np.rint(seconds.astype(np.float64) * 1e9).astype(np.int64)
        is_absolute = start_ns > _YEAR_S * 10**9
        return Clock(relative + (start_ns if is_absolute else 0), is_absolute)

    return Table(path, label, tuple(names), load, units, clock)
