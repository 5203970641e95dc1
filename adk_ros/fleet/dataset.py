# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The dataset of results: Parquet files in one folder per stage, which appear whole or not at all.

`OUT/results/stage=NAME/part-*.parquet` has one row per recording and finding; pandas, Polars and
DuckDB read the folder. `OUT/recordings/part-*.parquet` has the content hash of each recording and
version of its files, `OUT/listed/NAME.parquet` what the recordings were when a stage was last run.
Only the run that holds the lock writes.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError, first_line
from adk_ros.fleet.columns import ADDED, CONTENT, LISTING, PRUNED_BY, RESULT
from adk_ros.fleet.libraries import fleet_library

RESULTS, RECORDINGS, LISTED, SCRATCH = "results", "recordings", "listed", ".writing"
UNREADABLE = "unreadable "
"""Begin of what replaces the content hash of a recording that could not be read."""


class FleetDataset:
    """The dataset in an output folder."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._arrow = fleet_library("pyarrow")
        self._compute = fleet_library("pyarrow.compute")
        self._parquet = fleet_library("pyarrow.parquet")

    def folder(self, stage: str) -> Path:
        """Return the partition of a stage."""
        return self._out / RESULTS / f"stage={stage}"

    def append(self, stage: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """
        Add rows of a stage.

        :raises UsageError: the folder cannot be written, as on a full disk; nothing was added.
        """
        self._write(self.folder(stage), RESULT, rows)

    def append_hashes(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add content hashes; raises as `append`."""
        self._write(self._out / RECORDINGS, CONTENT, rows)

    def content_hashes(self, readable: bool = False) -> dict[tuple[str, str], str]:
        """
        Return (uri, version) -> content hash; `readable`: only of recordings that could be read.

        One that could not be read at first, and could later, has the hash of its content.
        """
        found: dict[tuple[str, str], str] = {}
        for path in _parts(self._out / RECORDINGS):
            for row in self._read(path, ["uri", "version", "content_hash"]):
                content = row["content_hash"]
                if not content.startswith(UNREADABLE):
                    found[row["uri"], row["version"]] = content
                elif not readable:
                    found.setdefault((row["uri"], row["version"]), content)
        return found

    def listing(self, stage: str) -> list[dict[str, str]]:
        """Return content and key of each recording at the last run of a stage that listed it."""
        path = self._out / LISTED / f"{stage}.parquet"
        return self._read(path, list(LISTING)) if path.is_file() else []

    def update_listing(self, stage: str, rows: Sequence[Mapping[str, str]]) -> None:
        """Replace the listing of these recordings; raises as `append`."""
        before = {row["recording"]: row for row in self.listing(stage)}
        after = before | {row["recording"]: dict(row) for row in rows}
        if after != before:
            self._write(self._out / LISTED, LISTING, list(after.values()), f"{stage}.parquet")

    def done(self, stage: str) -> dict[str, dict[str, str]]:
        """Return key -> name of recording -> failure, "" if it is ok."""
        found: dict[str, dict[str, str]] = {}
        for path in _parts(self.folder(stage)):
            for row in self._read(path, ["key", "recording", "failure"]):
                found.setdefault(row["key"], {})[row["recording"]] = row["failure"] or ""
        return found

    def rates(self, stage: str) -> tuple[float, int, int]:
        """Return seconds, bytes and number of the recordings whose stage succeeded."""
        seconds: dict[str, tuple[float, int]] = {}
        for path in _parts(self.folder(stage)):
            for row in self._read(path, ["key", "status", "seconds", "bytes"]):
                if row["status"] == "ok":
                    seconds[row["key"]] = (row["seconds"], row["bytes"])
        total_s, total_bytes = (sum(x[i] for x in seconds.values()) for i in (0, 1))
        return float(total_s), int(total_bytes), len(seconds)

    def rows(
        self, stage: str, where: Mapping[str, Collection[str]] | None = None
    ) -> list[dict[str, Any]]:
        """
        Return the rows of a stage.

        :param where: column of texts -> the values that are wanted; None for all rows. Rows are
            selected before they become Python objects, which takes most of the time.
        """
        return [
            row
            for path in _parts(self.folder(stage))
            for row in self._read(path, list(RESULT), where)
        ]

    def columns(self, stage: str, names: Sequence[str]) -> Any:
        """Return columns of all rows of a stage as an Arrow table, smaller than Python objects."""
        tables = [self._table(path, list(names)) for path in _parts(self.folder(stage))]
        empty = self.table({name: RESULT[name] for name in names}, [])
        return self._arrow.concat_tables([empty, *tables])

    def drop(self, stage: str, keys: Collection[str]) -> None:
        """Remove the rows of some keys; raises as `append`."""
        self.prune(stage, lambda row: row["key"] not in keys)

    def prune(self, stage: str, is_kept: Callable[[Mapping[str, str]], bool]) -> None:
        """
        Remove the rows that are not kept, by their texts of `PRUNED_BY`; raises as `append`.

        The rows are read one file at a time, and in full only where some of a file are kept.
        """
        for path in _parts(self.folder(stage)):
            kept = [is_kept(row) for row in self._read(path, list(PRUNED_BY))]
            if not any(kept):
                self._remove(path)
            elif not all(kept):
                rows = self._read(path, list(RESULT))
                chosen = [row for row, is_one in zip(rows, kept, strict=True) if is_one]
                self._write(path.parent, RESULT, chosen, path.name)

    def add_missing_columns(self) -> None:
        """
        Write files of earlier versions again, with the columns that they lack; raises as `append`.

        Others read a folder as one table, for which its files need the same columns.
        """
        for folder in sorted((self._out / RESULTS).glob("stage=*")):
            # Each, since an earlier version may have written next to files of this one.
            for path in _parts(folder):
                if self._lacks_columns(path):
                    self._write(folder, RESULT, self._read(path, list(RESULT)), path.name)

    def _lacks_columns(self, path: Path) -> bool:
        """Whether a file is one of an earlier version."""
        try:
            names = self._from_file(path, lambda content: content.schema_arrow.names)
        except UsageError:
            # The stage that reads it says so.
            return False
        missing = set(RESULT) - set(names)
        return bool(missing) and missing <= ADDED

    def _remove(self, path: Path) -> None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise self._not_writable(error) from None

    def _not_writable(self, error: OSError) -> UsageError:
        return UsageError(
            f"{self._out} cannot be written: {error.strerror or error}: the results so far "
            "are kept, run the same command again to continue"
        )

    def _write(
        self,
        folder: Path,
        columns: Mapping[str, str],
        rows: Sequence[Mapping[str, Any]],
        name: str | None = None,
    ) -> None:
        if not rows:
            return
        unique = f"part-{uuid.uuid4().hex}.parquet"
        # Not among the results: readers list a folder by its ending or read all that is in it.
        scratch = self._out / SCRATCH / unique
        try:
            table = self.table(columns, rows)
            folder.mkdir(parents=True, exist_ok=True)
            scratch.parent.mkdir(parents=True, exist_ok=True)
            with scratch.open("wb") as file:
                self._parquet.write_table(table, file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(scratch, folder / (name or unique))
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise self._not_writable(error) from None

    def table(self, columns: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> Any:
        """Return rows as an Arrow table with the given columns."""
        kinds = {
            "string": self._arrow.string(),
            "float64": self._arrow.float64(),
            "int64": self._arrow.int64(),
        }
        schema = self._arrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
        return self._arrow.Table.from_pylist([dict(row) for row in rows], schema=schema)

    def _read(
        self,
        path: Path,
        columns: list[str],
        where: Mapping[str, Collection[str]] | None = None,
    ) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = self._table(path, columns, where).to_pylist()
        return rows

    def _table(
        self,
        path: Path,
        columns: list[str],
        where: Mapping[str, Collection[str]] | None = None,
    ) -> Any:
        def chosen(content: Any) -> Any:
            if not where:
                return self._columns(content, columns)
            # Details are most of a file, and the files of other inputs have no row.
            selected = self._selected(self._columns(content, list(where)), where)
            if selected.true_count == 0:
                return self.table({name: RESULT[name] for name in columns}, [])
            return self._columns(content, columns).filter(selected)

        return self._from_file(path, chosen)

    def _columns(self, content: Any, names: list[str]) -> Any:
        """Return columns of an open file; those that earlier versions did not write are empty."""
        lacking = (ADDED & set(names)) - set(content.schema_arrow.names)
        # Without any column, a table would have no rows.
        table = content.read(columns=[name for name in names if name not in lacking] or ["key"])
        for name in lacking:
            empty = self._arrow.nulls(table.num_rows, self._arrow.string())
            table = table.append_column(name, empty)
        return table.select(names)

    def _from_file(self, path: Path, read: Callable[[Any], Any]) -> Any:
        """
        Return what `read` returns of an open Parquet file.

        :raises UsageError: it cannot be read, or is none of this dataset.
        """
        try:
            # Arrow's threads free buffers of a Python file under the interpreter's lock; one that
            # waits for it when the interpreter ends aborts the process.
            with self._arrow.OSFile(str(path), "rb") as file:
                return read(self._parquet.ParquetFile(file))
        except MemoryError:
            raise
        except Exception as error:  # the parser may raise anything on a file of a stranger
            if isinstance(error, OSError) and error.errno:
                raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
            raise UsageError(
                f"{path} is not a file of this dataset: {first_line(error)}: remove it, its "
                "recordings are then processed again"
            ) from None

    def _selected(self, table: Any, where: Mapping[str, Collection[str]]) -> Any:
        """Return which rows of an Arrow table have wanted values, a boolean array."""
        chosen = self._arrow.array([True] * table.num_rows, self._arrow.bool_())
        for name, values in where.items():
            wanted = self._arrow.array(sorted(values), self._arrow.string())
            column = table[name].combine_chunks()
            chosen = self._compute.and_(chosen, self._compute.is_in(column, value_set=wanted))
        return chosen


def remove_unfinished(out: Path) -> None:
    """Remove what a killed run has left half-written."""
    for path in (out / SCRATCH).glob("*.parquet"):
        path.unlink(missing_ok=True)


def _parts(folder: Path) -> Iterable[Path]:
    return sorted(folder.glob("part-*.parquet"))
