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

import json
import os
import uuid
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError, first_line, one_line
from adk_ros.fleet.libraries import fleet_library

RESULTS, RECORDINGS, LISTED, SCRATCH = "results", "recordings", "listed", ".writing"
UNREADABLE = "unreadable "
"""Begin of what replaces the content hash of a recording that could not be read."""

FINDING = {
    "finding": "string",
    "kind": "string",
    "channel": "string",
    "horizon_s": "float64",
    "condition": "string",
    "value": "float64",
    "low": "float64",
    "high": "float64",
    "unit": "string",
    "text": "string",
    "details": "string",
}
"""Columns that a stage may fill: what was found, with its 90 % interval; details are JSON."""

RESULT = {
    "recording": "string",
    "uri": "string",
    "content_hash": "string",
    "key": "string",
    "code_version": "string",
    "inputs_hash": "string",
    "status": "string",
    "failure": "string",
    "reason": "string",
    "seconds": "float64",
    "memory_mib": "float64",
    "bytes": "int64",
    "written_s": "float64",
} | FINDING
"""
Columns of the results. `status`: ok or failed, with `failure` (engine.Failure) and `reason`;
`seconds` and `memory_mib`: duration and peak memory of the work; `bytes`: size of the recording;
`written_s`: when, s since 1970.
"""

PRUNED_BY = ("recording", "key", "code_version", "inputs_hash")
"""Columns by which rows are removed."""

CONTENT = {"uri": "string", "version": "string", "content_hash": "string", "bytes": "int64"}
"""Columns of the content hashes."""

LISTING = {"recording": "string", "content_hash": "string", "key": "string"}
"""Columns of the listing of a stage: content and key of each recording at its last run."""


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
        try:
            # Arrow's threads free buffers of a Python file under the interpreter's lock; one that
            # waits for it when the interpreter ends aborts the process.
            with self._arrow.OSFile(str(path), "rb") as file:
                content = self._parquet.ParquetFile(file)
                if not where:
                    return content.read(columns=columns).select(columns)
                # Details are most of a file, and the files of other inputs have no row.
                chosen = self._selected(content.read(columns=list(where)), where)
                if chosen.true_count == 0:
                    return self.table({name: RESULT[name] for name in columns}, [])
                return content.read(columns=columns).filter(chosen)
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


def checked_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return a row of a stage as it is stored: details as JSON, texts of one line.

    :raises ValueError: it has a column that is not in `FINDING`, or a value of another type.
    """
    if unknown := sorted(set(row) - set(FINDING)):
        raise ValueError(f"column {', '.join(unknown)} is not among {', '.join(FINDING)}")
    stored: dict[str, Any] = {}
    for name, value in row.items():
        if value is None:
            continue
        if name == "details":
            stored[name] = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
        elif FINDING[name] == "float64":
            stored[name] = float(value)
        elif isinstance(value, str):
            stored[name] = one_line(value) if name == "text" else value
        else:
            raise ValueError(f"column {name} is {type(value).__name__}, not text")
    return stored


def remove_unfinished(out: Path) -> None:
    """Remove what a killed run has left half-written."""
    for path in (out / SCRATCH).glob("*.parquet"):
        path.unlink(missing_ok=True)


def _parts(folder: Path) -> Iterable[Path]:
    return sorted(folder.glob("part-*.parquet"))
