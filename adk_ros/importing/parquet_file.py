# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read Parquet files, with pyarrow or fastparquet, whichever pandas finds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, UsageError, first_line
from adk_ros.importing.optional_library import optional_library
from adk_ros.importing.table import Table


def read_parquet_table(path: Path) -> Table:
    """
    Return the table of a Parquet file.

    :raises UsageError: neither pyarrow nor fastparquet is installed.
    :raises DataError: the file cannot be read, or has no row.
    """
    import pandas as pd

    try:
        optional_library("pyarrow", "Parquet")
    except UsageError:
        optional_library("fastparquet", "Parquet")
    try:
        frame = pd.read_parquet(path)
    except Exception as error:  # the parser may raise anything on a file of a stranger
        raise DataError(f"{path}: cannot be read as Parquet: {first_line(error)}") from None
    if frame.index.name:
        frame = frame.reset_index()
    if frame.empty:
        raise DataError(f"{path}: is empty")
    names = tuple(str(name) for name in frame.columns)
    series = dict(zip(names, (frame.iloc[:, i] for i in range(len(names))), strict=True))

    def load(wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: _values(series[name]) for name in wanted}

    return Table(path, "", names, load)


def _values(series: Any) -> NDArray[Any]:
    if series.dtype.kind in "fiub":
        return np.asarray(series.to_numpy())
    if series.dtype.kind == "M":
        return np.asarray(series.to_numpy(dtype="datetime64[ns]"))
    return np.asarray(series.to_numpy(dtype=object))
