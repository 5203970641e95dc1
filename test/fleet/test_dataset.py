# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The dataset: whole files, read by others; keys; the lock; plans."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import duckdb
import pandas as pd
import polars as pl
import pytest
from helpers.fleet import text_fleet, text_stage
from pyarrow.parquet import (  # type: ignore[import-untyped, unused-ignore]
    ParquetFile,
    write_table,
)

from adk_ros.errors import UsageError
from adk_ros.fleet.columns import RESULT, checked_row
from adk_ros.fleet.dataset import SCRATCH, FleetDataset, remove_unfinished
from adk_ros.fleet.plan import Work, plan
from adk_ros.fleet.recordings import content_hash
from adk_ros.fleet.run import _Writer, duration_text, result_rows
from adk_ros.fleet.run_lock import run_lock
from adk_ros.fleet.stage import Stage, version_of
from adk_ros.fleet.stage_process import Failure, Reply


def filled(tmp_path):
    """Return dataset, stage, recordings and hashes, with one result ok and one failed."""
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1", "b": "damaged", "c": "ok 3"})
    stage = text_stage(tmp_path / "log")
    hashes = {(x.uri, x.version): content_hash(x) for x in recordings}
    dataset = FleetDataset(tmp_path / "out")
    version = version_of(stage)
    work = plan(version, recordings, hashes, dataset).missing
    by_name = {each.recordings[0].name: each for each in work}
    good = Reply([checked_row({"finding": "f", "value": 1})], seconds=2.0, memory_mib=10.0)
    bad = Reply(failure=Failure.UNUSABLE, reason="is damaged")
    dataset.append("text", result_rows(version, by_name["a.mcap"], good))
    dataset.append("text", result_rows(version, by_name["b.mcap"], bad))
    return dataset, stage, recordings, hashes


def test_others_read_the_dataset(tmp_path) -> None:
    filled(tmp_path)
    folder = tmp_path / "out" / "results"
    frame = pd.read_parquet(folder)
    assert set(frame.columns) == {*RESULT, "stage"}
    by_polars = pl.read_parquet(folder / "**" / "*.parquet", hive_partitioning=True)
    by_duckdb = (
        duckdb.connect()
        .execute(f"select * from read_parquet('{folder}/**/*.parquet', hive_partitioning=true)")
        .df()
    )
    for other in (by_polars.to_pandas(), by_duckdb):
        assert list(other.sort_values("recording")["reason"].fillna("")) == ["", "is damaged"]
        assert set(other["stage"]) == {"text"}
        assert set(other.columns) == set(frame.columns)
    assert list(frame["status"]).count("failed") == 1


def test_plan(tmp_path) -> None:
    dataset, stage, recordings, hashes = filled(tmp_path)
    assert isinstance(stage, Stage)
    version = version_of(stage)
    found = plan(version, recordings, hashes, dataset)
    assert (found.done, found.failed) == (2, 1)
    assert [each.recordings[0].name for each in found.missing] == ["c.mcap"]
    retried = plan(version, recordings, hashes, dataset, retry_failed=True)
    assert [each.recordings[0].name for each in retried.missing] == ["b.mcap", "c.mcap"]
    other = text_stage(tmp_path / "log", inputs_hash="other")
    assert len(plan(version_of(other), recordings, hashes, dataset).missing) == 3
    new = plan(version, recordings, {}, dataset)
    assert len(new.unhashed) == 3


def test_the_key_depends_on_all_that_the_result_depends_on(tmp_path) -> None:
    version = version_of(text_stage(tmp_path / "log"))
    keys = {
        version.key("content", "a"),
        version.key("other", "a"),
        replace(version, code_version="other").key("content", "a"),
        version_of(text_stage(tmp_path / "log", inputs_hash="x")).key("content", "a"),
        version_of(text_stage(tmp_path / "log", name="x")).key("content", "a"),
        replace(version, recording_inputs=str.upper).key("content", "a"),
    }
    assert len(keys) == 6
    assert version.key("content", "a") == version.key("content", "b")


def test_rates_and_dropped_rows(tmp_path) -> None:
    dataset, *_ = filled(tmp_path)
    assert dataset.rates("text") == (2.0, len("ok 1"), 1)
    failed = {key for key, names in dataset.done("text").items() if any(names.values())}
    dataset.drop("text", failed)
    assert [row["recording"] for row in dataset.rows("text")] == ["a.mcap"]


def test_selected_rows_are_those_that_python_selects(tmp_path) -> None:
    dataset = FleetDataset(tmp_path)
    for part in range(3):
        rows = [
            {"recording": f"r{number % 7}", "key": str(part), "value": float(number)}
            for number in range(50)
        ]
        dataset.append("text", [*rows, {"value": -1.0}])
    every = dataset.rows("text")
    assert len(every) == 153
    wanted = {"r3", "r5", "none"}
    assert dataset.rows("text", {"recording": wanted, "key": ["0", "2"]}) == [
        row for row in every if row["recording"] in wanted and row["key"] in {"0", "2"}
    ]
    assert dataset.rows("text", {"recording": []}) == []


def test_a_full_disk_is_a_line_and_leaves_no_file(tmp_path, monkeypatch) -> None:
    dataset, *_ = filled(tmp_path)
    before = sorted(tmp_path.rglob("*.parquet"))

    def full(number):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UsageError, match=r"No space left on device.*run the same command again"):
        dataset.append("text", [{"recording": "x", "key": "k"}])
    assert sorted(tmp_path.rglob("*.parquet")) == before


def test_what_a_killed_run_left_is_removed(tmp_path) -> None:
    (tmp_path / SCRATCH).mkdir()
    (tmp_path / SCRATCH / "part-1.parquet").write_bytes(b"half")
    remove_unfinished(tmp_path)
    assert list((tmp_path / SCRATCH).iterdir()) == []


def test_a_file_of_others_is_named(tmp_path) -> None:
    dataset, *_ = filled(tmp_path)
    (dataset.folder("text") / "part-x.parquet").write_bytes(b"nothing")
    with pytest.raises(UsageError, match=r"part-x.parquet is not a file of this dataset"):
        dataset.done("text")


def test_rows_of_a_stage_are_checked() -> None:
    assert checked_row({"value": 1, "text": "a\nb", "low": None, "details": {"x": 1}}) == {
        "value": 1.0, "text": "a b", "details": '{"x": 1}',
    }  # fmt: skip
    with pytest.raises(ValueError, match="column x is not among"):
        checked_row({"x": 1})
    with pytest.raises(ValueError, match="column finding is int"):
        checked_row({"finding": 1})


def as_earlier(path):
    """Write a file of results again as the versions before the column model_hash did."""
    write_table(ParquetFile(path).read().drop_columns(["model_hash"]), path)


def test_files_without_the_hash_of_the_model_are_results(tmp_path) -> None:
    dataset, stage, recordings, hashes = filled(tmp_path)
    parts = sorted(dataset.folder("text").iterdir())
    assert len(parts) == 2
    before = [row | {"model_hash": None} for row in dataset.rows("text")]
    for path in parts:
        as_earlier(path)
    dataset.append("text", [{"recording": "new", "key": "k", "model_hash": "m"}])
    assert dataset.rows("text", {"recording": ["a.mcap", "b.mcap"]}) == before
    assert [row["recording"] for row in dataset.rows("text", {"model_hash": ["m"]})] == ["new"]
    column = dataset.columns("text", ["model_hash"]).column("model_hash").to_pylist()
    assert sorted(map(str, column)) == ["None", "None", "m"]
    found = plan(version_of(stage), recordings, hashes, dataset)
    assert (found.done, len(found.missing)) == (2, 1)


def test_a_folder_of_two_versions_becomes_one_table(tmp_path, monkeypatch) -> None:
    """Polars and DuckDB refuse files with different columns."""
    dataset, *_ = filled(tmp_path)
    dataset.folder("index").mkdir()
    (dataset.folder("index") / "part-x.parquet").write_bytes(b"of another")
    first, second = sorted(dataset.folder("text").iterdir())
    as_earlier(first)
    as_earlier(second)
    write = FleetDataset._write
    written: list[str | None] = []

    def interrupted(self, folder, columns, rows, name=None):
        if written:
            raise KeyboardInterrupt
        written.append(name)
        write(self, folder, columns, rows, name)

    monkeypatch.setattr(FleetDataset, "_write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        dataset.add_missing_columns()
    monkeypatch.undo()
    assert written == [first.name]
    dataset.add_missing_columns()
    frame = pl.read_parquet(str(dataset.folder("text") / "*.parquet"))
    assert set(frame.columns) >= set(RESULT)
    assert sorted(frame["status"]) == ["failed", "ok"]
    known = first.stat().st_mtime_ns
    # An earlier version has written next to it.
    as_earlier(second)
    dataset.add_missing_columns()
    assert first.stat().st_mtime_ns == known
    frame = pl.read_parquet(str(dataset.folder("text") / "*.parquet"))
    assert set(frame.columns) >= set(RESULT)


def test_a_copy_has_rows_of_its_own(tmp_path) -> None:
    recordings = text_fleet(tmp_path / "drives", {"a": "ok 1", "b": "ok 1"})
    work = Work("key", "content", tuple(recordings))
    version = version_of(text_stage(tmp_path / "log"))
    rows = result_rows(version, work, Reply([{"finding": "f"}, {}]))
    assert Counter(row["recording"] for row in rows) == {"a.mcap": 2, "b.mcap": 2}


def in_a_thread(out):
    """Take and release the lock in another thread; raises what it raises there."""

    def take():
        with run_lock(out):
            pass

    with ThreadPoolExecutor(1) as pool:
        pool.submit(take).result()


def test_two_runs_on_one_folder(tmp_path) -> None:
    with run_lock(tmp_path / "out"):
        with (tmp_path / "out" / ".lock").open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # A stage of the run takes it again, by another path, and does not release it.
        (tmp_path / "link").symlink_to(tmp_path / "out")
        with run_lock(tmp_path / "link"):
            pass
        for _ in range(2):
            with pytest.raises(UsageError, match=f"is in use by process {os.getpid()} on"):
                in_a_thread(tmp_path / "out")
    in_a_thread(tmp_path / "out")
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot be written"), run_lock(tmp_path / "file"):
        pass


def test_results_are_written_in_few_files(monkeypatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    writes: list[list[dict]] = []
    with _Writer(writes.append) as writer:
        for second in range(36_000):
            now[0] = float(second)
            writer.add([{"second": second}])
    assert sum(map(len, writes)) == 36_000
    # 100 + 100 ln(6000 / 100) files in the first 6000 s, then one a minute.
    assert 900 < len(writes) < 1100
    assert max(map(len, writes)) == 60


def test_an_interruption_writes_what_is_there() -> None:
    writes: list[list[dict]] = []

    def interrupted():
        with _Writer(writes.append) as writer:
            writer.add([{"a": 1}])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert writes == [[{"a": 1}]]


def test_durations() -> None:
    assert [duration_text(x) for x in (5, 100, 8000)] == ["5 s", "2 min", "2.2 h"]


AT_ONCE = """
import os, sys, time
from pathlib import Path
from adk_ros.fleet.dataset import FleetDataset
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.setswitchinterval(1.0)
FleetDataset(Path(sys.argv[1])).listing("text")
end = time.perf_counter() + 0.02
while time.perf_counter() < end:
    pass
"""


def test_a_process_that_ends_after_a_read_is_not_aborted(tmp_path) -> None:
    """Arrow's threads that free a Python buffer while the interpreter ends abort it."""
    dataset = FleetDataset(tmp_path)
    rows = [{"recording": f"r{i}", "content_hash": "c" * 64, "key": "k" * 64} for i in range(200)]
    dataset.update_listing("text", rows)
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-c", AT_ONCE, str(tmp_path)],
            capture_output=True, text=True, check=False, timeout=60.0,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
