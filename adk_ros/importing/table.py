# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Tables: what every format is read as. Columns of numbers that share one time.

A CSV or Parquet file is one table; an MDF4 file has one per channel group, a CAN log one per
message, a bag one per topic, a MAT file one per structure or length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.arrays import FloatArray, IntArray


class Clock(NamedTuple):
    """
    Stamps (n,) that a format itself gives to the rows of a table, ns.

    `is_absolute`: they count from 1970; otherwise from a start that the file does not state.
    """

    stamp_ns: IntArray
    is_absolute: bool


@dataclass(frozen=True)
class Table:
    """
    Columns with one row per time.

    `name`: of the group, message or topic, empty if the file is one table. `columns`: their names
    in order. `units`: those that the file states, by column. `load(names)` returns the values of
    columns, numbers (n,) or texts. `clock()`: the stamps of the rows, None if a column has them.
    `every`: rows of the file from one row to the next.
    """

    path: Path
    name: str
    columns: tuple[str, ...]
    load: Callable[[Sequence[str]], dict[str, NDArray[Any]]]
    units: dict[str, str] = field(default_factory=dict)
    clock: Callable[[], Clock | None] = lambda: None
    every: int = 1

    @property
    def label(self) -> str:
        """Name of the file, and of the table in it if it has several."""
        return f"{self.path.name}: {self.name}" if self.name else self.path.name

    def find(self, column: str) -> str | None:
        """
        Return the column of that name; None if there is none.

        Parts in front may be left out at a dot or slash: `imu.a_x` is found by `a_x`, if no other
        column of the table is.
        """
        if column in self.columns:
            return column
        ends = [name for name in self.columns if name.endswith((f".{column}", f"/{column}"))]
        return ends[0] if len(ends) == 1 else None

    def part(self, first: int = 1, last: int | None = None, every: int = 1) -> Table:
        """
        Return the table of rows `first` to `last`, both included, counted from 1.

        :param last: None: to the end. :param every: of these, only every n-th, from the first on.
        """
        rows = slice(first - 1, last, every)

        def load(columns: Sequence[str]) -> dict[str, NDArray[Any]]:
            return {name: values[rows] for name, values in self.load(columns).items()}

        def clock() -> Clock | None:
            whole = self.clock()
            return None if whole is None else Clock(whole.stamp_ns[rows], whole.is_absolute)

        return replace(self, load=load, clock=clock, every=self.every * every)


class Numbers(NamedTuple):
    """Values (n,), NaN where a cell has none; `texts`: number of cells that are no number."""

    values: FloatArray
    texts: int


def as_numbers(column: NDArray[Any]) -> Numbers:
    """Return a column as numbers; empty cells and infinite values become NaN."""
    if column.dtype.kind in "fiub":
        values = column.astype(np.float64)
        infinite = np.isinf(values)
        values[infinite] = np.nan
        return Numbers(values, int(infinite.sum()))
    values, texts = np.full(column.shape[0], np.nan), 0
    for i, cell in enumerate(column.tolist()):
        if cell is None or cell != cell:  # None or NaN
            continue
        text = str(cell).strip()
        if not text:
            continue
        try:
            values[i] = float(text)
        except ValueError:
            texts += 1
            continue
        if np.isinf(values[i]):
            values[i] = np.nan
            texts += 1
        # A cell with "nan" is empty: some loggers write it for a missing value.
    return Numbers(values, texts)
