# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Open the files of an import as tables, by their format."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from adk_ros.errors import DataError, UsageError
from adk_ros.importing.bag_fields import read_bag_tables
from adk_ros.importing.can_log import READERS, load_databases, read_can_tables
from adk_ros.importing.delimited_text import read_text_table
from adk_ros.importing.map_file import FileMap
from adk_ros.importing.matlab_file import read_matlab_tables
from adk_ros.importing.mdf_file import read_mdf_tables
from adk_ros.importing.parquet_file import read_parquet_table
from adk_ros.importing.table import Table

_TEXT = {".csv", ".tsv", ".txt", ".dat"}
_PARQUET = {".parquet", ".pq"}
_MDF = {".mf4", ".mdf", ".dat4"}
_BAG = {".mcap", ".db3", ".bag", ".zstd"}

FORMATS = "CSV, Parquet, MAT, MDF (.mf4), CAN log (.blf, .asc, .log with --dbc) or bag"


def open_tables(
    paths: Sequence[Path],
    files: dict[str, FileMap],
    databases: Sequence[Path],
    notes: list[str],
) -> list[Table]:
    """
    Return the tables of all files.

    :param files: options by file name, `*` allowed.
    :param databases: DBC files, for CAN logs.
    :param notes: receives a line for each loss that the format reports.
    :raises UsageError: a file is missing, of unknown format, or needs a library or DBC file.
    :raises DataError: a file is empty or cannot be read.
    """
    database: Any = None
    tables: list[Table] = []
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: no such file")
        if path.suffix.lower() in READERS and database is None:
            if not databases:
                raise UsageError(f"{path}: a CAN log needs its messages: give --dbc FILE")
            database = load_databases(databases)
        options = options_of(path, files)
        opened = _open(path, options, database, notes)
        first, last = options.rows or (1, None)
        tables += [table.part(first, last, options.every) for table in opened]
    return tables


def options_of(path: Path, files: dict[str, FileMap]) -> FileMap:
    """Return the options of a file: those of its name, else of the first pattern that fits."""
    if path.name in files:
        return files[path.name]
    return next((each for key, each in files.items() if fnmatch(path.name, key)), FileMap())


def _open(path: Path, options: FileMap, database: Any, notes: list[str]) -> list[Table]:
    suffix = path.suffix.lower()
    if path.is_dir() or suffix in _BAG:
        return read_bag_tables(path, notes)
    if path.is_file() and not path.stat().st_size:
        raise DataError(f"{path}: is empty")
    if suffix in READERS:
        return read_can_tables(path, database, notes)
    if suffix in _PARQUET:
        return [read_parquet_table(path)]
    if suffix == ".mat":
        return read_matlab_tables(path)
    if suffix in _MDF:
        return read_mdf_tables(path)
    if suffix in _TEXT:
        return [read_text_table(path, options)]
    raise UsageError(f"{path}: format '{suffix}' is not known: give {FORMATS}")
