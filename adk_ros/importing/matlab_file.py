# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Read MAT files up to version 7 (scipy): vectors, and structures of vectors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adk_ros.errors import DataError, first_line
from adk_ros.importing.table import Table

_MIN_ROWS = 2
_MAX_DEPTH = 8
"""Levels of nested structures that are read."""


def read_matlab_tables(path: Path) -> list[Table]:
    """
    Return a table for each structure of vectors of one length, and for the vectors of one length.

    A matrix has one column per column, named `name[0]`, `name[1]` and so on; one that is wider
    than high has its channels in rows. A structure `units` of texts, as `adk export` writes it,
    gives the unit of the vector of the same path.

    :raises DataError: the file cannot be read, is of version 7.3, or has no vector of numbers.
    """
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise DataError(
            f"{path}: is a MAT file of version 7.3 (HDF5), which is not read: save it in MATLAB "
            "with save(file, '-v7')"
        ) from None
    except Exception as error:  # the parser may raise anything on a file of a stranger
        raise DataError(f"{path}: cannot be read as a MAT file: {first_line(error)}") from None
    found: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _collect(name, value, found, 0)
    units: dict[str, str] = {}
    _collect_units("", content.get("units"), units, 0)
    groups: dict[tuple[str, int], dict[str, NDArray[Any]]] = {}
    for name, column in found.items():
        structure = name.rpartition(".")[0]
        groups.setdefault((structure, column.shape[0]), {})[name] = column
    if not groups:
        raise DataError(f"{path}: has no vector of numbers (timeseries and tables are not read)")
    sizes = [structure for structure, _ in groups]
    return [
        _table(
            path,
            name if sizes.count(name) == 1 else f"{name} of {rows}".strip(),
            columns,
            {column: units[column] for column in columns if column in units},
        )
        for (name, rows), columns in groups.items()
    ]


def _table(
    path: Path, name: str, columns: dict[str, NDArray[Any]], units: dict[str, str]
) -> Table:
    def load(wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {column: columns[column] for column in wanted}

    return Table(path, name, tuple(columns), load, units)


def _collect_units(name: str, value: Any, found: dict[str, str], depth: int) -> None:
    """Add the texts of a structure to `found`, by their path in it."""
    for each in getattr(value, "_fieldnames", None) or ():
        inner, path = getattr(value, each), f"{name}.{each}".lstrip(".")
        if isinstance(inner, str):
            found[path] = inner
        elif depth < _MAX_DEPTH:
            _collect_units(path, inner, found, depth + 1)


def _collect(name: str, value: Any, found: dict[str, NDArray[Any]], depth: int) -> None:
    """Add the vectors of a variable to `found`, by their path."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None and depth < _MAX_DEPTH:
        for each in fields:
            _collect(f"{name}.{each}", getattr(value, each), found, depth + 1)
        return
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiubO":
        return
    if value.dtype.kind == "O" and not all(isinstance(cell, str) for cell in value.flat):
        return
    if value.ndim == 1 and value.shape[0] >= _MIN_ROWS:
        found[name] = value
    elif value.ndim == 2 and max(value.shape) >= _MIN_ROWS:
        # Samples outnumber channels.
        table = value.T if value.shape[1] > value.shape[0] else value
        for i in range(table.shape[1]):
            found[f"{name}[{i}]"] = table[:, i]
