# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stamps of a table's rows: from a time column or the clock of the format, in ns."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, datetime, timezone
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, UsageError
from adk_ros.importing.map_file import TIME_UNITS, ImportMap, TimeMap
from adk_ros.importing.source_files import options_of
from adk_ros.importing.table import Table, as_numbers
from adk_ros.numerics.arrays import BoolArray, IntArray

DEFAULT_ORIGIN = "2000-01-01T00:00:00Z"
"""Start of a recording whose files state none: ROS takes a stamp of 0 for none."""
_YEAR_NS = 366 * 86_400 * 10**9
_MAX_STAMP_NS = (2**31 - 10) * 10**9
"""ns; ROS time ends there."""
_MAX_STEP_BACK_NS = 10**9
"""ns by which a row may lie before the one above it: rows of several senders are interleaved."""


class RowStamps(NamedTuple):
    """
    Stamps of a table's rows in order of time.

    `row` (n,): index of the rows with a time, in that order; `stamp_ns` (n,): their stamps.
    `is_absolute`: they count from 1970.
    """

    row: IntArray
    stamp_ns: IntArray
    is_absolute: bool


def row_stamps(table: Table, import_map: ImportMap, notes: list[str]) -> RowStamps:
    """
    Return the stamps of a table; lines on what was lost or put in order are added to `notes`.

    :raises UsageError: there is no time, or its unit, format or origin is wrong.
    :raises DataError: no row has a time, or the time jumps back.
    """
    own = options_of(table.path, import_map.files).time
    time = own or import_map.time
    column = None if time is None or time.column is None else table.find(time.column)
    if own is not None and own.column is not None and column is None:
        raise UsageError(
            f"{table.label}: has no column '{own.column}' for the time; it has "
            f"{column_list(table.columns)}"
        )
    if time is not None and time.period is not None:
        stamp_ns = _counted_stamps(table, table.every * time.period * TIME_UNITS[time.unit])
        known, is_absolute = np.ones(stamp_ns.shape[0], dtype=bool), False
    elif time is None or column is None:
        clock = table.clock()
        if clock is None:
            named = (
                f"has no column '{time.column}'"
                if time is not None and time.column is not None
                else "give time.column"
            )
            raise UsageError(
                f"{table.label}: {named} for the time; it has {column_list(table.columns)}"
            )
        stamp_ns, is_absolute = clock
        known = np.ones(stamp_ns.shape[0], dtype=bool)
        if is_absolute and own is not None and own.origin is not None:
            raise UsageError(f"{table.label}: its time is absolute: leave out time.origin")
        if is_absolute or (own is None and time is not None and time.column is not None):
            # An origin of the column of another file says nothing about this clock.
            time = None
    else:
        stamp_ns, known = _column_stamps(table, column, time)
        # Years from 1970, or a date.
        is_absolute = bool(known.any() and abs(stamp_ns[known][0]) > _YEAR_NS)
    if not known.any():
        raise DataError(f"{table.label}: no row has a time")
    if time is not None and time.origin is not None:
        stamp_ns = stamp_ns + origin_ns(time.origin)
        is_absolute = True
    return _in_order(table, stamp_ns, known, is_absolute, notes)


def origin_ns(origin: datetime | date | float | str) -> int:
    """
    Return a date, or a number of seconds since 1970, in ns since 1970.

    :raises UsageError: it is no date. A date without a zone is in UTC.
    """
    if isinstance(origin, str):
        try:
            origin = datetime.fromisoformat(origin.strip().replace("Z", "+00:00"))
        except ValueError:
            raise UsageError(
                f"time.origin '{origin}' is no date, such as {DEFAULT_ORIGIN}"
            ) from None
    if isinstance(origin, date):
        at = origin if isinstance(origin, datetime) else datetime(*origin.timetuple()[:3])
        at = at if at.tzinfo is not None else at.replace(tzinfo=timezone.utc)
        since = at - datetime(1970, 1, 1, tzinfo=timezone.utc)
        return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000
    return round(origin * 1e9)


def check_range(label: str, stamp_ns: IntArray) -> None:
    """Raise `DataError` if stamps are not those of ROS, which begin in 1970 and end in 2038."""
    if stamp_ns[0] <= 0 or stamp_ns[-1] >= _MAX_STAMP_NS:
        raise DataError(
            f"{label}: times from {stamp_ns[0] * 1e-9:g} to {stamp_ns[-1] * 1e-9:g} s since 1970 "
            "are beyond ROS time (1970 to 2038): check time.unit and time.origin"
        )


def column_list(columns: Sequence[str]) -> str:
    """Return the first column names for a message."""
    shown = ", ".join(f"'{name}'" for name in columns[:8])
    return shown + (f" and {len(columns) - 8} more" if len(columns) > 8 else "")


def _counted_stamps(table: Table, period_ns: float) -> IntArray:
    """Return stamps of a constant period for rows without a time."""
    rows = table.load(table.columns[:1])[table.columns[0]].shape[0]
    return np.asarray(np.round(period_ns * np.arange(rows)), dtype=np.int64)


def _column_stamps(table: Table, column: str, time: TimeMap) -> tuple[IntArray, BoolArray]:
    """Return the stamps of a time column (n,), and whether each row has one (n,)."""
    cells = table.load([column])[column]
    if time.unit == "date" or cells.dtype.kind == "M":
        return _dates(table, column, cells, time.format)
    unit = TIME_UNITS[time.unit]
    if cells.dtype.kind in "iu":
        if cells.size and float(np.abs(cells.astype(np.float64)).max()) * unit > 9e18:
            raise DataError(f"{table.label}: column '{column}' is too large for {time.unit}")
        return cells.astype(np.int64) * unit, np.ones(cells.shape[0], dtype=bool)
    values = as_numbers(cells).values
    if np.nanmax(np.abs(values), initial=0.0) * unit > 9e18:
        raise DataError(f"{table.label}: column '{column}' is too large for {time.unit}")
    known = np.isfinite(values)
    # Apart, because their sum has more digits than a float64.
    whole = np.floor(np.where(known, values, 0.0))
    fraction = np.where(known, values, 0.0) - whole
    stamp_ns = whole.astype(np.int64) * unit + np.rint(fraction * unit).astype(np.int64)
    return stamp_ns, known


def _dates(
    table: Table, column: str, cells: NDArray[Any], format_: str | None
) -> tuple[IntArray, BoolArray]:
    import pandas as pd

    try:
        parsed = pd.to_datetime(
            pd.Series(cells), format=format_ or "ISO8601", errors="coerce", utc=True
        )
    except ValueError as error:
        raise UsageError(f"{table.label}: time.format: {error}") from None
    known = np.asarray(parsed.notna().to_numpy())
    if not known.any():
        raise UsageError(
            f"{table.label}: column '{column}' is no date"
            f"{f' of the format {format_}' if format_ else ''}: give time.format, such as "
            "'%d.%m.%Y %H:%M:%S.%f'"
        )
    values = parsed.dt.tz_localize(None).to_numpy(dtype="datetime64[ns]")
    return np.where(known, values.astype(np.int64), 0), known


def _in_order(
    table: Table, stamp_ns: IntArray, known: BoolArray, is_absolute: bool, notes: list[str]
) -> RowStamps:
    rows = np.flatnonzero(known)
    if missing := known.shape[0] - rows.shape[0]:
        notes.append(f"{table.label}: {missing} of {known.shape[0]} rows have no time: skipped")
    stamps = stamp_ns[rows]
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    if back.size:
        worst = int(back[np.argmin(steps[back])])
        if -steps[worst] > _MAX_STEP_BACK_NS:
            raise DataError(
                f"{table.label}: the time jumps back by {-steps[worst] * 1e-9:.6g} s at row "
                f"{int(rows[worst + 1]) + 1} of the data: split a file with several recordings"
            )
        notes.append(
            f"{table.label}: {back.size} rows lie before the row above them, by at most "
            f"{-steps[worst] * 1e-9:.3g} s: sorted by time"
        )
    order = np.argsort(stamps, kind="stable")
    return RowStamps(rows[order], stamps[order], is_absolute)
