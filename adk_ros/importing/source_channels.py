# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the columns of a map in the tables, and convert them to SI units."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, UsageError
from adk_ros.importing.map_file import ChannelMap, ImportMap, factor_of
from adk_ros.importing.row_stamps import (
    DEFAULT_ORIGIN,
    RowStamps,
    check_range,
    column_list,
    origin_ns,
    row_stamps,
)
from adk_ros.importing.table import Table, as_numbers
from adk_ros.numerics.arrays import FloatArray, IntArray

COMPUTED = "computed"
"""Table of a channel that was computed from others."""


@dataclass(frozen=True)
class SourceChannel:
    """
    A channel at the stamps of its source.

    `stamp_ns` (n,) ascend strictly, `values` (n,) are finite, in the SI unit of the channel.
    `table` names where `column` was found; `factor` is that of the unit. `empty`, `texts`,
    `duplicates`: rows without a value, with a text in its place, and with a stamp given before.
    """

    name: str
    table: str
    column: str
    entry: ChannelMap
    factor: float
    stamp_ns: IntArray
    values: FloatArray
    empty: int
    texts: int
    duplicates: int


def converted(raw: FloatArray, entry: ChannelMap, factor: float) -> FloatArray:
    """Return raw values in SI units: `factor * sign * (scale * raw + offset) / ratio`."""
    values = raw
    # Factors of one are left out, so that values in SI units stay as they are to the last bit.
    if entry.scale != 1.0:
        values = values * entry.scale
    if entry.offset:
        values = values + entry.offset
    scale = entry.sign * factor / entry.ratio
    return values if scale == 1.0 else values * scale


def source_channels(
    tables: Sequence[Table], import_map: ImportMap, map_name: str, notes: list[str]
) -> list[SourceChannel]:
    """
    Return the channels of a map, on one time; relative times count from `DEFAULT_ORIGIN`.

    Each loss is a line in `notes`.

    :param map_name: of the file, for messages.
    :raises UsageError: a column is missing or ambiguous, or times do not fit together.
    :raises DataError: a column has no number, or the times are unusable.
    """
    found = {
        name: _find(tables, name, entry, map_name) for name, entry in import_map.channels.items()
    }
    wanted: dict[int, tuple[Table, list[str]]] = {}
    for table, column in found.values():
        wanted.setdefault(id(table), (table, []))[1].append(column)
    loaded: dict[int, tuple[RowStamps, dict[str, NDArray[Any]]]] = {}
    for key, (table, columns) in wanted.items():
        loaded[key] = row_stamps(table, import_map, notes), table.load(columns)
    shift_ns = _shift([(wanted[key][0], stamps) for key, (stamps, _) in loaded.items()], notes)
    channels = []
    for name, (table, column) in found.items():
        stamps, columns_of = loaded[id(table)]
        at = RowStamps(stamps.row, stamps.stamp_ns + shift_ns, True)
        check_range(table.label, at.stamp_ns)
        entry = import_map.channels[name]
        channels.append(_channel(name, table, column, entry, columns_of[column], at))
    return channels


def _shift(found: Sequence[tuple[Table, RowStamps]], notes: list[str]) -> int:
    """Return what to add to the stamps, ns."""
    absolute = [table for table, stamps in found if stamps.is_absolute]
    relative = [table for table, stamps in found if not stamps.is_absolute]
    if absolute and relative:
        raise UsageError(
            f"{relative[0].label}: its time is relative, that of {absolute[0].label} is absolute: "
            f"give files.{relative[0].path.name}.time.origin"
        )
    if not relative:
        return 0
    notes.append(
        f"the time is relative: stamps count from {DEFAULT_ORIGIN}; time.origin changes that"
    )
    return origin_ns(DEFAULT_ORIGIN)


def _find(
    tables: Sequence[Table], name: str, entry: ChannelMap, map_name: str
) -> tuple[Table, str]:
    place = f"{map_name}: channels.{name}"
    chosen = [
        table
        for table in tables
        if entry.file is None
        or fnmatch(table.path.name, entry.file)
        or fnmatch(table.label, entry.file)
        or fnmatch(table.name, entry.file)
    ]
    if not chosen:
        files = ", ".join(dict.fromkeys(table.path.name for table in tables))
        raise UsageError(f"{place}.file: no file '{entry.file}' is imported; there is {files}")
    found = [(table, column) for table in chosen if (column := table.find(entry.column))]
    exact = [(table, column) for table, column in found if column == entry.column]
    found = exact or found
    if len(found) > 1:
        labels = ", ".join(table.label for table, _ in found[:4])
        raise UsageError(f"{place}: column '{entry.column}' is in {labels}: choose with file")
    if not found:
        columns = [column for table in chosen for column in table.columns]
        close = difflib.get_close_matches(entry.column, columns, n=1)
        hint = f"; did you mean '{close[0]}'?" if close else f"; there is {column_list(columns)}"
        raise UsageError(f"{place}: no column '{entry.column}' in {chosen[0].path.name}{hint}")
    return found[0]


def _channel(
    name: str,
    table: Table,
    column: str,
    entry: ChannelMap,
    cells: NDArray[Any],
    stamps: RowStamps,
) -> SourceChannel:
    numbers = as_numbers(cells[stamps.row])
    factor = factor_of(name, entry)
    values = converted(numbers.values, entry, factor)
    known = np.isfinite(values)
    if not known.any():
        raise DataError(f"{table.label}: column '{column}' has no number")
    stamp_ns, first = np.unique(stamps.stamp_ns[known], return_index=True)
    return SourceChannel(
        name,
        table.label,
        column,
        entry,
        factor,
        stamp_ns,
        values[known][first],
        empty=int((~known).sum()) - numbers.texts,
        texts=numbers.texts,
        duplicates=int(known.sum()) - stamp_ns.shape[0],
    )
