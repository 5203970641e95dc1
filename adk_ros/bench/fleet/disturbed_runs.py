# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Verbs of `adk fleet` in processes that are killed, and what their results are compared by."""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any

import psutil

from adk_ros.fleet.dataset import RESULTS, FleetDataset
from adk_ros.fleet.libraries import fleet_library
from adk_ros.fleet.stage import KeepingStage, Stage, keeps_recordings, version_of

WORKERS = 2
VARYING = ("seconds", "memory_mib", "written_s")
"""Columns that differ between equal runs: durations, memory, time of writing."""
_PAGE = Path("report", "fleet.json")
_RESTART_S = 0.2
"""Time between two looks of the supervisor at the processes of a cluster."""
_WORKER_MARK = "spawn_main"
"""In the command line of a local worker."""
_DRIVER = """
import sys
from adk_ros.bench.fleet.disturbed_runs import log_starts
from adk_ros.cli.main import main
log_starts(sys.argv[1], float(sys.argv[2]))
sys.exit(main(sys.argv[3:]))
"""


@dataclass(frozen=True)
class LoggedStage:
    """
    A stage that leaves a file in the folder `log` at each start, then waits `nap_s` and works.

    Its results have the keys of the stage itself.
    """

    stage: Stage
    log: str
    nap_s: float
    name: str
    inputs_hash: str
    shared_paths: tuple[str, ...]

    def recording_inputs(self) -> Callable[[str], str]:
        """Return those of the stage."""
        return version_of(self.stage).recording_inputs

    def run(self, path: Path, recording: str) -> list[dict[str, Any]]:
        """Return the rows of the stage."""
        self._log_start(recording)
        return self.stage.run(path, recording)

    def _log_start(self, recording: str) -> None:
        work = work_of(self.name, version_of(self.stage).inputs_of(recording), recording)
        (Path(self.log) / f"{work}-{time.time_ns()}-{os.getpid()}").touch()
        time.sleep(self.nap_s)


@dataclass(frozen=True)
class LoggedKeepingStage(LoggedStage):
    """
    One that keeps what it has read: a killed worker may leave that as well.

    A start from what is kept is logged once it has been read, since it may not be there.
    """

    stage: KeepingStage

    def of_content(self, content_hash: str) -> LoggedKeepingStage:
        """Return the stage for a recording with this hash of its content."""
        return replace(self, stage=self.stage.of_content(content_hash))

    def run_kept(self, recording: str) -> list[dict[str, Any]] | None:
        """Return the rows of the stage from what was kept; None if nothing was."""
        rows = self.stage.run_kept(recording)
        if rows is not None:
            self._log_start(recording)
        return rows


def work_of(stage: str, inputs_hash: str, recording: str) -> str:
    """Return the name under which the starts of a stage on a recording are logged."""
    return hashlib.sha256(f"{stage}\n{inputs_hash}\n{recording}".encode()).hexdigest()


def log_starts(log: str, nap_s: float) -> None:
    """Let the verbs of this process log the starts of their stages, see `LoggedStage`."""
    from adk_ros.api.fleet import fleet_mismatch, fleet_run
    from adk_ros.fleet.run import run_stage

    @wraps(run_stage)
    def logged(stage: Stage, *given: Any) -> Any:
        known = log, nap_s, stage.name, stage.inputs_hash, stage.shared_paths
        if keeps_recordings(stage):
            return run_stage(LoggedKeepingStage(stage, *known), *given)
        return run_stage(LoggedStage(stage, *known), *given)

    for module in (fleet_run, fleet_mismatch):
        vars(module)["run_stage"] = logged


class Driver:
    """
    A verb of `adk fleet` in a separate process, which is killed on the way out of its context.

    :param log: folder of the starts of its stages, see `LoggedStage`.
    :param verb: verb and arguments without --out, which is `out`.
    """

    def __init__(self, log: Path, out: Path, verb: Sequence[str], nap_s: float) -> None:
        self._log = log
        log.mkdir(parents=True, exist_ok=True)
        given = ["fleet", *verb, "--out", str(out)]
        self._output = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self._process = subprocess.Popen(
            [sys.executable, "-c", _DRIVER, str(log), str(nap_s), *given],
            env=environment(), stdout=subprocess.DEVNULL, stderr=self._output,
        )  # fmt: skip
        self._seen: set[psutil.Process] = set()

    def __enter__(self) -> Driver:
        return self

    def __exit__(self, *error: object) -> None:
        if self.exit_code() is None:
            self.kill()
        self._output.close()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def started(self) -> int:
        """Number of starts of a stage so far, in all runs with this log."""
        return sum(1 for _ in self._log.iterdir())

    def exit_code(self) -> int | None:
        """Return the exit code; None while the process runs."""
        return self._process.poll()

    def wait(self, timeout_s: float | None = None) -> int:
        """Return the exit code when the process has ended."""
        return self._process.wait(timeout_s)

    def kill(self) -> None:
        """End the process with SIGKILL."""
        self.note_children()
        self._process.kill()
        self._process.wait()

    def workers(self) -> list[psutil.Process]:
        """Return the local workers."""
        found = []
        for child in self.note_children():
            # It may have ended since.
            with suppress(psutil.Error):
                if _WORKER_MARK in " ".join(child.cmdline()):
                    found.append(child)
        return found

    def note_children(self) -> list[psutil.Process]:
        """Return the processes that this one has started, and remember them for `left`."""
        with suppress(psutil.Error):
            children = psutil.Process(self.pid).children(recursive=True)
            self._seen |= set(children)
            return children
        return []

    def left(self, wait_s: float) -> list[int]:
        """Return the numbers of its processes that still run `wait_s` after it has ended."""
        _, alive = psutil.wait_procs(list(self._seen), wait_s)
        return sorted(each.pid for each in alive)

    @property
    def lines(self) -> list[str]:
        """Lines that it has printed on stderr, without its progress."""
        self._output.seek(0)
        lines = self._output.read().splitlines()
        return [line for line in lines if not line.startswith(("fleet: ", "results in "))]


def environment() -> dict[str, str]:
    """Return the environment of a child that imports what this process does."""
    paths = [path or str(Path.cwd()) for path in sys.path]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


class RunningCluster:
    """A scheduler and workers on the loopback interface, each started again when it ends."""

    def __init__(self, folder: Path, workers: int = WORKERS) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self._folder, self._stopped = folder, threading.Event()
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        worker = ["worker", self.address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
        worker += ["--host", "127.0.0.1", "--local-directory", str(folder)]
        self._commands = [scheduler, *[worker] * workers]
        self.processes = [self._start(command) for command in self._commands]
        self._watch = threading.Thread(target=self._restart)
        self._watch.start()

    def _start(self, command: Sequence[str]) -> subprocess.Popen[bytes]:
        with (self._folder / f"{command[0]}.log").open("a") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *command],
                env=environment(), stdout=log, stderr=log,
            )  # fmt: skip

    def _restart(self) -> None:
        while not self._stopped.wait(_RESTART_S):
            for i, process in enumerate(self.processes):
                if process.poll() is not None:
                    self.processes[i] = self._start(self._commands[i])

    def stop(self) -> None:
        """End all processes."""
        self._stopped.set()
        self._watch.join()
        for process in self.processes:
            process.kill()
            process.wait()


def compared_rows(
    out: Path, removed: re.Pattern[str] | None = None, ignored: Sequence[str] = ()
) -> Counter[str]:
    """
    Return the rows of all stages as texts without what varies, and how often each is there.

    The findings of `adk fleet mismatch` (report/fleet.json) are one more row, without date and
    duration.

    :param removed: what is removed from them, such as the folder of the recordings.
    :param ignored: further columns that vary.
    """
    rows: Counter[str] = Counter()
    dropped = {*VARYING, *ignored}
    for stage in _stages(out):
        for row in FleetDataset(out).rows(stage):
            kept = {key: value for key, value in row.items() if key not in dropped}
            text = json.dumps({"stage": stage} | kept, sort_keys=True)
            rows[text if removed is None else removed.sub("", text)] += 1
    if (out / _PAGE).exists():
        content = json.loads((out / _PAGE).read_text())
        content.get("page", {}).pop("provenance", None)
        rows[json.dumps(content, sort_keys=True)] += 1
    return rows


def different_rows(undisturbed: Counter[str], disturbed: Counter[str]) -> list[str]:
    """
    Return the rows that one result has and the other has not.

    Of the two results those of which there are more, so that a changed row counts once.
    """
    missing, further = undisturbed - disturbed, disturbed - undisturbed
    return sorted(max(further, missing, key=Counter.total).elements())


@dataclass(frozen=True)
class Repeats:
    """
    Work that was done more than once, in pairs of stage and recording.

    `started`: starts beyond the first; `stored`: starts after the result had been stored.
    """

    started: int
    stored: int


def repeats_of(log: Path, out: Path) -> Repeats:
    """Return what the runs with this log of starts have done more than once."""
    starts: dict[str, list[int]] = {}
    for path in log.iterdir():
        work, started_ns, _ = path.name.split("-")
        starts.setdefault(work, []).append(int(started_ns))
    stored: dict[str, int] = {}
    for work, stored_ns in _stored(out):
        stored[work] = min(stored_ns, stored.get(work, stored_ns))
    return Repeats(
        sum(len(each) - 1 for each in starts.values()),
        sum(at > stored[work] for work, each in starts.items() if work in stored for at in each),
    )


def _stored(out: Path) -> Iterator[tuple[str, int]]:
    """Yield the work of each stored row, and when its file was written, ns since 1970."""
    parquet = fleet_library("pyarrow.parquet")
    for stage in _stages(out):
        for path in FleetDataset(out).folder(stage).glob("part-*.parquet"):
            table = parquet.read_table(path, columns=["inputs_hash", "recording"])
            for row in table.to_pylist():
                yield work_of(stage, row["inputs_hash"], row["recording"]), path.stat().st_mtime_ns


def _stages(out: Path) -> list[str]:
    return sorted(path.name.partition("=")[2] for path in (out / RESULTS).glob("stage=*"))
