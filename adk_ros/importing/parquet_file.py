# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read and write Parquet files, with pyarrow or fastparquet, whichever is installed."""

from __future__ import annotations

import warnings
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
    library = parquet_library()
    try:
        if library.__name__ == "fastparquet":
            frame = library.ParquetFile(str(path)).to_pandas()
        else:
            frame = library.parquet.read_table(path).to_pandas()
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


def write_parquet(frame: Any, path: Path) -> None:
    """
    Write a data frame without its index.

    :raises UsageError: neither pyarrow nor fastparquet is installed.
    """
    library = parquet_library()
    if library.__name__ == "fastparquet":
        library.write(str(path), frame, write_index=False)
    else:
        frame.to_parquet(path, index=False, engine="pyarrow")


def parquet_library() -> Any:
    """
    Return the module pyarrow with its `parquet`, or fastparquet.

    Called directly, because pandas is to lose its access to fastparquet.

    :raises UsageError: neither is installed.
    """
    try:
        optional_library("pyarrow.parquet", "Parquet")
        return optional_library("pyarrow", "Parquet")
    except UsageError:
        # Its remarks on pandas concern its authors, not who reads a file.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return optional_library("fastparquet", "Parquet")


def _values(series: Any) -> NDArray[Any]:
    if series.dtype.kind in "fiub":
        return np.asarray(series.to_numpy())
    if series.dtype.kind == "M":
        return np.asarray(series.to_numpy(dtype="datetime64[ns]"))
    return np.asarray(series.to_numpy(dtype=object))
