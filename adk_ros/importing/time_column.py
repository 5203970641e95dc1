# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the time column of a table and its unit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.importing.column_names import TIME, recognise
from adk_ros.importing.map_file import TIME_UNITS, TimeMap
from adk_ros.importing.table import Table, as_numbers
from adk_ros.numerics.arrays import FloatArray

_NAMES = {
    "sec": "s", "seconds": "s", "sek": "s", "msec": "ms", "usec": "us", "microseconds": "us",
    "milliseconds": "ms", "nanoseconds": "ns", "nsec": "ns", "hours": "h", "minutes": "min",
}  # fmt: skip
_FORMATS = (
    (r"\d{1,2}\.\d{1,2}\.\d{4}[ T]", "%d.%m.%Y %H:%M:%S"),
    (r"\d{1,2}/\d{1,2}/\d{4}[ T]", "%d/%m/%Y %H:%M:%S"),
)
# Epoch stamps of the years 1990 to 2038.
_EPOCH_S = (6.3e8, 2.2e9)


@dataclass(frozen=True)
class TimeGuess:
    """The time column, None if the format has its own clock or there is none; and why."""

    time: TimeMap | None
    reason: str
    is_certain: bool


def guess_time(table: Table) -> TimeGuess:
    """Return the time column of a table, by name, and its unit by name, size or steps."""
    named = [(recognise(column), column) for column in table.columns]
    columns = [(name, column) for name, column in named if name.channel == TIME]
    # A format's clock is better than a column of that name, which may be a counter.
    if table.clock() is not None:
        return TimeGuess(None, "clock of the file", True)
    best: TimeGuess | None = None
    for name, column in sorted(columns, key=lambda item: -item[0].quality):
        cells = table.load([column])[column]
        guess = _unit_guess(column, name.unit or table.units.get(column, ""), cells)
        if guess is not None and (best is None or (guess.is_certain and not best.is_certain)):
            best = guess
    if best is not None:
        return best
    return TimeGuess(None, "no column is named as a time", False)


def _unit_guess(column: str, stated: str, cells: NDArray[Any]) -> TimeGuess | None:
    """Return the unit of a column that is named as a time; None if its values are none."""
    if cells.dtype.kind == "M":
        return TimeGuess(TimeMap(column=column, unit="date"), "dates", True)
    values = as_numbers(cells).values
    known = values[np.isfinite(values)]
    if known.size < 2:
        return _date_guess(column, cells)
    if np.mean(np.diff(known) >= 0.0) < 0.9:
        return None
    unit = _NAMES.get(stated.lower(), stated)
    if unit in TIME_UNITS and unit != "date":
        return TimeGuess(TimeMap(column=column, unit=unit), "unit stated", True)
    return _by_size(column, known)


def _by_size(column: str, known: FloatArray) -> TimeGuess:
    first = float(known[0])
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        if _EPOCH_S[0] * factor < first < _EPOCH_S[1] * factor:
            return TimeGuess(TimeMap(column=column, unit=unit), "size of an epoch", True)
    step = float(np.median(np.diff(known)))
    text = f"steps of {step:.4g}"
    whole = bool(np.all(known[:100] == np.round(known[:100])))
    # Loggers sample at 1 Hz to 2 kHz: the units differ by 1000, so one of them fits.
    for unit, low, high in (
        ("s", 4e-4, 0.9), ("ms", 0.9, 1.1e3), ("us", 1.1e3, 1.1e6), ("ns", 1.1e6, 1.1e9),
    ):  # fmt: skip
        if low <= step < high:
            is_certain = whole == (unit != "s")
            return TimeGuess(TimeMap(column=column, unit=unit), text, is_certain)
    return TimeGuess(TimeMap(column=column, unit="s"), f"unit guessed: {text}", False)


def _date_guess(column: str, cells: NDArray[Any]) -> TimeGuess | None:
    texts = [str(cell).strip() for cell in cells[:20].tolist() if cell is not None]
    if not texts or not re.match(r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}", texts[0]):
        return None
    for pattern, form in _FORMATS:
        if re.match(pattern, texts[0]):
            fraction = ".%f" if "." in texts[0][11:] else ""
            time = TimeMap(column=column, unit="date", format=form + fraction)
            return TimeGuess(time, "dates; day first is assumed", "/" not in pattern)
    return TimeGuess(TimeMap(column=column, unit="date"), "dates", True)
