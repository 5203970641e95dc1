# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Columns side by side with their units, and the files that hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.importing.parquet_file import write_parquet
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.numerics.arrays import FloatArray, IntArray

FORMATS = ("csv", "parquet", "mat", "mcap")


@dataclass(frozen=True)
class ColumnTable:
    """
    Columns (n,) at stamps (n,), ns; NaN where a column has no value at that stamp.

    `units`: by column, "1" for a number. `start_ns`: where `time_s` is zero.
    """

    stamp_ns: IntArray
    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    start_ns: int

    @property
    def time_s(self) -> FloatArray:
        """Time of each row since `start_ns`, s."""
        return np.asarray((self.stamp_ns - self.start_ns) * 1e-9, dtype=np.float64)

    def headings(self) -> dict[str, str]:
        """Return column -> its name with the unit, such as `v_x [m/s]`."""
        return {
            name: name if self.units[name] == "1" else f"{name} [{self.units[name]}]"
            for name in self.columns
        }


def side_by_side(
    channels: Sequence[SourceChannel], units: Mapping[str, str], start_ns: int
) -> ColumnTable:
    """
    Return channels of different rates as one table, with a row at each stamp of any of them.

    Nothing is resampled: a channel without a message at a stamp has no value in its row.
    """
    stamps = np.unique(np.concatenate([channel.stamp_ns for channel in channels]))
    columns = {}
    for channel in channels:
        column = np.full(stamps.shape[0], np.nan)
        column[np.searchsorted(stamps, channel.stamp_ns)] = channel.values
        columns[channel.name] = column
    return ColumnTable(stamps, columns, {c.name: units[c.name] for c in channels}, start_ns)


def write_table(table: ColumnTable, kind: str, out: Path) -> None:
    """
    Write a table as "csv" or "parquet": `stamp_ns`, `time_s`, and a column per channel.

    :raises UsageError: Parquet needs a library that is not installed.
    """
    import pandas as pd

    content: dict[str, Any] = {"stamp_ns": table.stamp_ns, "time_s": table.time_s}
    headings = table.headings()
    content |= {headings[name]: column for name, column in table.columns.items()}
    frame = pd.DataFrame(content)
    if kind == "csv":
        frame.to_csv(out, index=False)
        return
    write_parquet(frame, out)


def write_mat(groups: Mapping[str, ColumnTable], out: Path) -> None:
    """
    Write tables as a MAT file of version 5: a structure each, with `stamp_ns` and `time_s`.

    The structure `units` holds the unit of each column.
    """
    from scipy.io import savemat

    content: dict[str, Any] = {}
    for name, table in groups.items():
        content[name] = {"stamp_ns": table.stamp_ns, "time_s": table.time_s, **table.columns}
    content["units"] = {
        name: dict(table.units) | {"stamp_ns": "ns", "time_s": "s"}
        for name, table in groups.items()
    }
    savemat(out, content, long_field_names=True, oned_as="column")
