# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Dask and Ray on the same short stages: start, throughput, memory, a killed worker."""

from __future__ import annotations

import importlib
import logging
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from adk_ros.bench.fleet.work import BusyStage, write_recordings
from adk_ros.errors import UsageError

WORKERS = 2
Progress = Callable[[float, float, str], None]


def bench_engines(
    recordings: int, stage: BusyStage, rounds: int, progress: Progress
) -> dict[str, Any]:
    """
    Run a stage on `recordings` with two workers of each engine that is installed.

    `start_s`: until the first task has ended; `run_s`: all tasks, the shortest
    of `rounds`; `killed_run_s`: all tasks, while
    one worker is killed with SIGKILL after a third of them; `processes` and `memory_mib`: of the
    engine's processes, unique set size (memory that would be free without them).
    """
    engines: dict[str, Callable[[], Any]] = {"dask": _Dask, "ray": _Ray}
    result: dict[str, Any] = {"recordings": recordings, "work": stage.text}
    with tempfile.TemporaryDirectory() as scratch:
        paths = write_recordings(Path(scratch), recordings)
        started = time.monotonic()
        for path in paths:
            stage.run(path, path.name)
        result["loop_s"] = time.monotonic() - started
        for i, (name, make) in enumerate(engines.items()):
            progress(i, len(engines), name)
            started = time.monotonic()
            try:
                engine = make()
            except ImportError:
                result[name] = None
                continue
            try:
                engine.run(stage, paths[:1], lambda done: None)
                start_s = time.monotonic() - started
                engine.run(stage, paths[: 4 * WORKERS], lambda done: None)
                run_s = min(_timed(engine, stage, paths) for _ in range(rounds))
                memory = [_unique_mib(each) for each in psutil.Process().children(recursive=True)]
                started = time.monotonic()
                killed = _KillOnce(recordings // 3, engine.workers)
                rows = engine.run(stage, paths, killed)
                killed_run_s = time.monotonic() - started
                if sorted(row[0]["value"] for row in rows) != list(range(recordings)):
                    raise UsageError(f"{name} lost results when a worker was killed")
            finally:
                engine.close()
            result[name] = {
                "start_s": start_s,
                "run_s": run_s,
                "speedup": result["loop_s"] / run_s,
                "killed_run_s": killed_run_s,
                "processes": len(memory),
                "memory_mib": sum(memory),
            }
    return result


def _timed(engine: Any, stage: BusyStage, paths: list[Path]) -> float:
    started = time.monotonic()
    engine.run(stage, paths, lambda done: None)
    return time.monotonic() - started


def _unique_mib(process: psutil.Process) -> float:
    try:
        return float(process.memory_full_info().uss / 2**20)
    except psutil.Error:
        return 0.0


class _KillOnce:
    """Kills one worker after some tasks."""

    def __init__(self, after: int, workers: Callable[[], list[psutil.Process]]) -> None:
        self._after, self._workers, self._is_done = after, workers, False

    def __call__(self, done: int) -> None:
        if done >= self._after and not self._is_done:
            self._workers()[0].kill()
            self._is_done = True


class _Dask:
    def __init__(self) -> None:
        from adk_ros.fleet.cluster import open_cluster

        self._opened = open_cluster(WORKERS)
        self._cluster = self._opened.__enter__()

    def run(self, stage: BusyStage, paths: list[Path], report: Callable[[int], None]) -> list[Any]:
        distributed = importlib.import_module("distributed")
        client = self._cluster.client
        futures = [client.submit(stage.run, path, path.name, pure=False) for path in paths]
        rows = []
        for future in distributed.as_completed(futures):
            rows.append(future.result())
            report(len(rows))
        return rows

    @staticmethod
    def workers() -> list[psutil.Process]:
        return [x for x in psutil.Process().children() if "spawn_main" in " ".join(x.cmdline())]

    def close(self) -> None:
        self._opened.__exit__(None, None, None)


class _Ray:
    def __init__(self) -> None:
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        # A new engine of the same interpreter would otherwise be refused on machines with uv.
        os.environ["RAY_ENABLE_UV_RUN_RUNTIME_ENV"] = "0"
        self._ray = importlib.import_module("ray")
        self._ray.init(
            num_cpus=WORKERS,
            include_dashboard=False,
            _node_ip_address="127.0.0.1",
            logging_level=logging.CRITICAL,
            log_to_driver=False,
        )
        self._function = self._ray.remote(max_retries=3)(_run)

    def run(self, stage: BusyStage, paths: list[Path], report: Callable[[int], None]) -> list[Any]:
        waiting = [self._function.remote(stage, path) for path in paths]
        rows: list[Any] = []
        while waiting:
            ready, waiting = self._ray.wait(waiting)
            rows += self._ray.get(ready)
            report(len(rows))
        return rows

    @staticmethod
    def workers() -> list[psutil.Process]:
        found = []
        for child in psutil.Process().children(recursive=True):
            try:
                # The worker that runs a task is titled by it.
                if child.cmdline() and child.cmdline()[0].startswith("ray::_run"):
                    found.append(child)
            except psutil.Error:
                continue
        return found

    def close(self) -> None:
        self._ray.shutdown()


def _run(stage: BusyStage, path: Path) -> list[dict[str, Any]]:
    return stage.run(path, path.name)
