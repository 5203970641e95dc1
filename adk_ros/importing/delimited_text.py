# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read delimited text (CSV, TSV): delimiter, decimal mark, header and unit row are detected."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, UsageError, first_line
from adk_ros.importing.map_file import FileMap
from adk_ros.importing.table import Table

_EXAMINED_LINES = 200
"""Lines in which header and delimiter are looked for; loggers write preambles of some ten."""
_DELIMITERS = (";", "\t", ",", "|")
_NUMBER = re.compile(r"\s*[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?\s*")
_DATE = re.compile(r"\s*\d{1,4}[-./]\d{1,2}[-./]\d{1,4}.*|\s*\d{1,2}:\d{2}.*")


class Layout(NamedTuple):
    """How a text file is laid out; rows count from 0."""

    encoding: str
    delimiter: str
    decimal: str
    header_row: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_row: int


def read_text_table(path: Path, options: FileMap) -> Table:
    """
    Return the table of a text file.

    :raises UsageError: it cannot be read.
    :raises DataError: it is empty, or no row of numbers is found in it.
    """
    import pandas as pd

    layout = detect_layout(path, options)
    try:
        frame = pd.read_csv(
            path,
            sep=layout.delimiter,
            decimal=layout.decimal,
            header=None,
            names=list(range(len(layout.names))),
            skiprows=layout.first_row,
            encoding=layout.encoding,
            # Exact anyway from pandas 3 on, which warns of the argument.
            **({"float_precision": "round_trip"} if pd.__version__ < "3" else {}),
            skip_blank_lines=True,
            skipinitialspace=True,
            index_col=False,
            low_memory=False,
            on_bad_lines="error",
        )
    except Exception as error:  # the parser may raise anything on a file of a stranger
        raise DataError(f"{path}: cannot be read as a table: {first_line(error)}") from None
    values = {name: frame[i] for i, name in enumerate(layout.names)}
    units = {name: unit for name, unit in zip(layout.names, layout.units, strict=True) if unit}

    def load(names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: _cells(values[name], layout.decimal) for name in names}

    return Table(path, "", layout.names, load, units)


def _cells(series: Any, decimal: str) -> NDArray[Any]:
    """Return a column; with a decimal comma, texts among its numbers have left all as texts."""
    if series.dtype.kind in "fiub":
        return np.asarray(series.to_numpy())
    column = np.asarray(series.to_numpy(dtype=object))
    if decimal != ",":
        return column
    texts = [
        cell.replace(",", ".") if isinstance(cell, str) and _NUMBER.fullmatch(cell) else cell
        for cell in column.tolist()
    ]
    return np.array(texts, dtype=object)


def detect_layout(path: Path, options: FileMap) -> Layout:
    """
    Return the layout of a text file; what `options` state is not detected.

    The header is the last row before the first row of numbers that has a name for every field,
    or the row above it if there is a row of units between them.

    :raises UsageError, DataError: as `read_text_table`.
    """
    text, encoding = _head(path, _EXAMINED_LINES + (options.header_row or 0))
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise DataError(f"{path}: is empty")
    delimiter = options.delimiter or _delimiter(lines)
    rows = list(csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter))
    # An unbalanced quotation mark would join lines.
    if len(rows) != len(lines):
        rows = [line.split(delimiter) for line in lines]
    # The usual one: a single row with a field more must not hide those before it.
    lengths = Counter(len(row) for row in rows if _is_numeric(row))
    width = lengths.most_common(1)[0][0] if lengths else 1
    first = next((i for i, row in enumerate(rows) if len(row) == width and _is_numeric(row)), None)
    if first is None:
        raise DataError(f"{path}: has no row of numbers in its first {len(rows)} rows")
    above = [i for i in range(first) if _is_header(rows[i], width)]
    if options.header_row is not None:
        header = options.header_row - 1
        if header >= len(rows):
            raise UsageError(f"{path}: header_row {options.header_row} is beyond the header")
    elif not above:
        raise DataError(f"{path}: has no row of column names above row {first + 1}: add one")
    else:
        header = above[-1]
        if len(above) > 1 and above[-2] == header - 1 and _is_unit_row(rows[header]):
            header = above[-2]
    names = [cell.strip() or f"column {i + 1}" for i, cell in enumerate(rows[header])]
    names += [f"column {i + 1}" for i in range(len(names), width)]
    units = [""] * len(names)
    if header + 1 < first and _is_unit_row(rows[header + 1]):
        units = [cell.strip().strip("[]()") for cell in rows[header + 1][: len(names)]]
        units += [""] * (len(names) - len(units))
    body = rows[max(first, header + 1) :]
    decimal = options.decimal or _decimal(body, delimiter)
    return Layout(
        encoding, delimiter, decimal, header, _unique(names), tuple(units), max(first, header + 1)
    )


def _head(path: Path, lines: int) -> tuple[str, str]:
    """Return the first lines and the encoding: UTF-8, otherwise Latin-1, which reads all."""
    try:
        with path.open("rb") as file:
            head = b"".join(file.readline(1 << 20) for _ in range(lines))
        if head.startswith((b"\xff\xfe", b"\xfe\xff")):
            # A line does not end after a byte of 0x0A.
            with path.open(encoding="utf-16", errors="replace") as text:
                return "".join(text.readline(1 << 20) for _ in range(lines)), "utf-16"
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from None
    if b"\0" in head:
        raise DataError(f"{path}: is no text file")
    try:
        return head.decode("utf-8-sig"), "utf-8-sig"
    except UnicodeDecodeError:
        return head.decode("latin-1"), "latin-1"


def _delimiter(lines: Sequence[str]) -> str:
    """Return the delimiter that divides the last lines into the same number of fields, > 1."""
    body = [line for line in lines if line.strip()][-50:]
    for delimiter in _DELIMITERS:
        counts = {line.count(delimiter) for line in body}
        if min(counts) > 0 and len(counts) == 1:
            # With decimal commas and one column, a semicolon is absent and commas mislead.
            return delimiter
    most = max(_DELIMITERS, key=lambda mark: min(line.count(mark) for line in body))
    return most if any(most in line for line in body) else ","


def _is_numeric(row: Sequence[str]) -> bool:
    """Return whether most filled fields of a row are numbers or dates."""
    filled = [cell for cell in row if cell.strip()]
    numbers = sum(bool(_NUMBER.fullmatch(cell) or _DATE.fullmatch(cell)) for cell in filled)
    return bool(filled) and numbers > 0.5 * len(filled)


def _is_header(row: Sequence[str], width: int) -> bool:
    return len(row) in {width, width - 1} and not _is_numeric(row) and any(map(str.strip, row))


def _is_unit_row(row: Sequence[str]) -> bool:
    """Return whether the fields of a row are units, at least half of them known ones."""
    from adk_ros.importing.channels import QUANTITIES
    from adk_ros.importing.map_file import TIME_UNITS
    from adk_ros.importing.units import is_unit_of

    cells = [cell.strip().strip("[]()") for cell in row if cell.strip()]
    known = sum(
        cell in TIME_UNITS or any(is_unit_of(cell, si) for si in QUANTITIES) for cell in cells
    )
    return bool(cells) and known > 0.5 * len(cells)


def _decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    if delimiter == ",":
        return "."
    cells = [cell for row in rows[:50] for cell in row if _NUMBER.fullmatch(cell)]
    commas, points = (sum(mark in cell for cell in cells) for mark in ",.")
    return "," if commas > points else "."


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, those that repeat with a number."""
    seen: Counter[str] = Counter()
    out = []
    for name in names:
        seen[name] += 1
        out.append(name if seen[name] == 1 else f"{name}.{seen[name] - 1}")
    return tuple(out)
