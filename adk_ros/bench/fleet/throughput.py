# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`adk fleet` against a plain loop and joblib, and its cost per recording as the fleet grows."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from adk_ros.bench.fleet.work import BusyStage, write_recordings
from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.recordings import find_recordings
from adk_ros.fleet.run import RunSummary, run_stage
from adk_ros.importing.optional_library import optional_library

Progress = Callable[[float, float, str], None]


def bench_throughput(
    recordings: int, stage: BusyStage, rounds: int, progress: Progress
) -> dict[str, Any]:
    """
    Time equal work on `recordings` in a loop, by joblib, and by `adk fleet` with 1 and 2 workers.

    Times are the shortest of `rounds`, s. `work_s` begins with the first recording; `total_s` has
    the start of the workers and the content hashes as well.

    :raises UsageError: joblib is not installed.
    """
    times: dict[str, list[tuple[float, float]]] = {}
    joblib = optional_library("joblib", "adk bench fleet --part throughput", extra="bench")
    with tempfile.TemporaryDirectory() as scratch:
        paths = write_recordings(Path(scratch) / "drives", recordings)

        def loop() -> float:
            started = time.monotonic()
            for path in paths:
                stage.run(path, path.name)
            return time.monotonic() - started

        def by_joblib(workers: int) -> float:
            started = time.monotonic()
            joblib.Parallel(n_jobs=workers)(
                joblib.delayed(stage.run)(path, path.name) for path in paths
            )
            return time.monotonic() - started

        ways: dict[str, Callable[[], float]] = {
            "loop": loop,
            "joblib, 2 processes": partial(by_joblib, 2),
            "adk fleet, 1 worker": lambda: _fleet(stage, Path(scratch), 1).seconds,
            "adk fleet, 2 workers": lambda: _fleet(stage, Path(scratch), 2).seconds,
        }
        for number in range(rounds):
            for i, (name, way) in enumerate(ways.items()):
                progress(number * len(ways) + i, rounds * len(ways), name)
                started = time.monotonic()
                work_s = way()
                times.setdefault(name, []).append((work_s, time.monotonic() - started))
    rows = {
        name: {"work_s": min(x[0] for x in each), "total_s": min(x[1] for x in each)}
        for name, each in times.items()
    }
    loop_s = rows["loop"]["work_s"]
    one, two = (rows[f"adk fleet, {n}"]["work_s"] for n in ("1 worker", "2 workers"))
    return {
        "recordings": recordings,
        "work": stage.text,
        "rows": rows,
        "overhead": one / loop_s - 1.0,
        "speedup": one / two,
        "speedup_joblib": loop_s / rows["joblib, 2 processes"]["work_s"],
    }


def bench_scaling(counts: list[int], stage: BusyStage, progress: Progress) -> list[dict[str, Any]]:
    """
    Measure fleets of growing size with 2 workers and a stage.

    `cost_ms`: ms of a worker for each recording; `driver_mib`: memory of this process afterwards;
    `worker_mib`: the largest worker without its stage process; `listing_s`, `resume_s`: time to
    find the recordings, and to find that all are done.
    """
    rows = []
    for i, count in enumerate(counts):
        progress(i, len(counts), f"{count} recordings")
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_recordings(folder / "drives", count)
            started = time.monotonic()
            found = find_recordings([str(folder / "drives")])
            listing_s = time.monotonic() - started
            watch = _WorkerMemory()
            cluster = partial(open_cluster, 2)
            summary = run_stage(stage, found, folder / "out", cluster, progress=watch)
            started = time.monotonic()
            run_stage(stage, found, folder / "out", cluster)
            rows.append(
                {
                    "recordings": count,
                    "work_s": summary.seconds,
                    "cost_ms": 2e3 * summary.seconds / count,
                    "driver_mib": psutil.Process().memory_info().rss / 2**20,
                    "worker_mib": watch.largest_mib,
                    "listing_s": listing_s,
                    "resume_s": time.monotonic() - started,
                    "files": len(list((folder / "out" / "results").rglob("*.parquet"))),
                }
            )
    return rows


def _fleet(stage: BusyStage, scratch: Path, workers: int) -> RunSummary:
    with tempfile.TemporaryDirectory(dir=scratch) as out:
        found = find_recordings([str(scratch / "drives")])
        return run_stage(stage, found, Path(out), partial(open_cluster, workers))


class _WorkerMemory:
    """A progress callback that looks at the memory of the workers now and then."""

    def __init__(self) -> None:
        self.largest_mib = 0.0
        self._looked = 0.0

    def __call__(self, done: float, total: float, text: str) -> None:
        if time.monotonic() - self._looked < 1.0:
            return
        self._looked = time.monotonic()
        for child in psutil.Process().children():
            try:
                if "spawn_main" in " ".join(child.cmdline()):
                    self.largest_mib = max(self.largest_mib, child.memory_info().rss / 2**20)
            except psutil.Error:
                continue
