# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run a stage on all recordings of a fleet, and continue an interrupted run."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.fleet.cluster import Cluster
from adk_ros.fleet.dataset import FleetDataset, remove_unfinished
from adk_ros.fleet.engine import Task, run_tasks
from adk_ros.fleet.plan import Plan, Work, current_keys, plan, unreadable_content
from adk_ros.fleet.recording_work import hash_of_recording, run_on_recording, seen_folder
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.run_lock import run_lock
from adk_ros.fleet.stage import Stage, StageVersion, version_of
from adk_ros.fleet.stage_process import ENDS_RUN, Failure, Reply

Progress = Callable[[float, float, str], None]
"""Called with (done, total, text)."""

_FLUSH_SHARE, _SHORTEST_FLUSH_S, _LONGEST_FLUSH_S = 0.01, 1.0, 60.0
"""
Results are written after 1 % of the time that the run has taken, 1 to 60 s.

A killed driver loses at most that; a run of T s writes about 100 + 100 ln(T / 100 s) files in its
first 100 min, and one a minute from then on.
"""


@dataclass(frozen=True)
class Limits:
    """
    Limits of the work on one recording.

    `timeout_s`: s; `memory_mib`: resident memory of its process, MiB. `count`: recordings to
    process in this run, None for all. `retry_failed`: process failed recordings again.
    """

    timeout_s: float = 1800.0
    memory_mib: float = 4096.0
    count: int | None = None
    retry_failed: bool = False


@dataclass(frozen=True)
class RunSummary:
    """
    What a run did.

    `total` recordings, of which `reused` had a result; `computed` in `seconds`, of which
    `failures` by kind; `left`: not processed because of the limit on their number. `notes` to the
    user.
    """

    total: int
    reused: int
    computed: int
    seconds: float
    failures: dict[str, int]
    left: int = 0
    memory_mib: float = 0.0
    notes: tuple[str, ...] = ()


def run_stage(
    stage: Stage,
    recordings: Sequence[FleetRecording],
    out: Path,
    cluster: Callable[[], AbstractContextManager[Cluster]],
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """
    Process the recordings that have no result of this stage, code and inputs yet.

    :param out: output folder, which one run at a time writes to; a verb of several stages holds
        its lock (`run_lock`) for all of them.
    :param cluster: opens the cluster; called only if there is something to do.
    :raises UsageError: the folder is in use or cannot be written, a store or the scheduler does
        not answer: the results so far are kept. An interruption keeps them as well.
    """
    limits = limits or Limits()
    with run_lock(out):
        remove_unfinished(out)
        dataset = FleetDataset(out)
        dataset.add_missing_columns()
        hashes = dataset.content_hashes(readable=limits.retry_failed)
        version = version_of(stage)
        found = plan(version, recordings, hashes, dataset, limits.retry_failed)
        if not found.unhashed and not found.missing:
            _list_and_copy(version, recordings, hashes, found, dataset)
            return _summary(recordings, found, Counter(), 0.0)
        with cluster() as opened:
            wanted = found.to_hash(limits.count)
            if wanted:
                _hash_recordings(wanted, opened, dataset, limits, progress)
            # Recordings that are left for later keep what is known of them.
            hashes = dataset.content_hashes()
            if wanted:
                left = _identities(found.unhashed) - _identities(wanted)
                to_do = {k: v for k, v in hashes.items() if k not in left}
                found = plan(version, recordings, to_do, dataset, limits.retry_failed)
            _list_and_copy(version, recordings, hashes, found, dataset)
            return _compute(stage, version, recordings, found, opened, dataset, limits, progress)


def _identities(recordings: Sequence[FleetRecording]) -> set[tuple[str, str]]:
    return {(each.uri, each.version) for each in recordings}


def _hash_recordings(
    recordings: Sequence[FleetRecording],
    cluster: Cluster,
    dataset: FleetDataset,
    limits: Limits,
    progress: Progress | None,
) -> None:
    by_name = {recording.name: recording for recording in recordings}
    tasks = (
        Task(
            name,
            hash_of_recording,
            (recording, seen_folder(recording)),
            limits.timeout_s,
            limits.memory_mib,
        )
        for name, recording in by_name.items()
    )
    meter = _Meter("hashing", len(by_name), sum(x.size for x in recordings), progress, cluster)
    with _Writer(dataset.append_hashes) as writer:
        for task, reply in _outcomes(cluster, tasks, writer, meter):
            recording = by_name[task.name]
            content = unreadable_content(recording) if reply.failure else reply.value
            writer.add(
                [
                    {
                        "uri": recording.uri,
                        "version": recording.version,
                        "content_hash": content,
                        "bytes": recording.size,
                    }
                ]
            )
            meter.add(recording.size, False)


def _compute(
    stage: Stage,
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    found: Plan,
    cluster: Cluster,
    dataset: FleetDataset,
    limits: Limits,
    progress: Progress | None,
) -> RunSummary:
    missing = found.missing[: limits.count]
    if replaced := found.replaced & {work.key for work in missing}:
        dataset.drop(stage.name, replaced)
    by_key = {work.key: work for work in missing}
    shared = tuple(path for path in stage.shared_paths if Path(path).exists())
    tasks = (
        Task(
            work.key, run_on_recording,
            (
                stage, work.recordings[0], (*shared, *seen_folder(work.recordings[0])),
                work.content_hash,
            ),
            limits.timeout_s, limits.memory_mib,
        )
        for work in missing
    )  # fmt: skip
    meter = _Meter(stage.name, len(by_key), sum(x.size for x in missing), progress, cluster)
    failures: Counter[str] = Counter()
    started, memory_mib, computed = time.monotonic(), 0.0, 0
    with _Writer(lambda rows: dataset.append(stage.name, rows)) as writer:
        for task, reply in _outcomes(cluster, tasks, writer, meter):
            work = by_key[task.name]
            writer.add(result_rows(version, work, reply))
            memory_mib = max(memory_mib, reply.memory_mib)
            computed += len(work.recordings)
            if reply.failure:
                failures[reply.failure.value] += len(work.recordings)
            meter.add(work.size, reply.failure is not None)
    left = sum(len(work.recordings) for work in found.missing) - computed + len(found.unhashed)
    return _summary(recordings, found, failures, time.monotonic() - started, left, memory_mib)


def result_rows(version: StageVersion, work: Work, reply: Reply) -> list[dict[str, Any]]:
    """Return the rows of the dataset for the outcome of a stage."""
    findings: list[dict[str, Any]] = [{}] if reply.failure else reply.value or [{}]
    return [
        {
            "recording": recording.name,
            "uri": recording.uri,
            "content_hash": work.content_hash,
            "key": work.key,
            "code_version": version.code_version,
            "inputs_hash": version.inputs_of(recording.name),
            "model_hash": version.model_hash,
            "status": "failed" if reply.failure else "ok",
            "failure": reply.failure.value if reply.failure else None,
            "reason": reply.reason or None,
            "seconds": reply.seconds,
            "memory_mib": reply.memory_mib,
            "bytes": recording.size,
            "written_s": time.time(),
            **finding,
        }
        for recording in work.recordings
        for finding in findings
    ]


def _list_and_copy(
    version: StageVersion,
    recordings: Sequence[FleetRecording],
    hashes: Mapping[tuple[str, str], str],
    found: Plan,
    dataset: FleetDataset,
) -> None:
    """
    Write what the recordings are now, and the results of copies under their names.

    One that is not hashed yet has no result: what is stored of it may be of another content.
    """
    keys = current_keys(version, recordings, hashes)
    dataset.update_listing(
        version.name,
        [
            {
                "recording": each.name,
                "content_hash": hashes.get((each.uri, each.version), ""),
                "key": keys.get(each.name, ""),
            }
            for each in recordings
        ],
    )
    if not found.copied:
        return
    names: dict[str, str] = {}
    rows = []
    for row in dataset.rows(version.name, {"key": found.copied.keys()}):
        if names.setdefault(row["key"], row["recording"]) == row["recording"]:
            for copy in found.copied[row["key"]]:
                named = {"recording": copy.name, "uri": copy.uri, "written_s": time.time()}
                rows.append(row | named)
    dataset.append(version.name, rows)


def _outcomes(
    cluster: Cluster, tasks: Iterable[Task], writer: _Writer, meter: _Meter
) -> Iterator[tuple[Task, Reply]]:
    """
    Yield every task with its outcome; write what is due and say what is lacking meanwhile.

    :raises UsageError: an outcome that would hit all other tasks, or no scheduler any more.
    """

    def on_wake() -> None:
        writer.flush_if_due()
        meter.say_what_is_lacking()

    for task, reply in run_tasks(cluster, tasks, on_wake):
        stop_if_needed(reply)
        yield task, reply


def stop_if_needed(reply: Reply) -> None:
    """Raise what says nothing about a recording. :raises UsageError: see `ENDS_RUN`."""
    if reply.failure not in ENDS_RUN:
        return
    if reply.failure is Failure.DISK_FULL:
        raise UsageError(
            f"the disk of a worker is full: {reply.reason}: free some space and run the same "
            "command again, results so far are kept"
        )
    raise UsageError(reply.reason)


def _summary(
    recordings: Sequence[FleetRecording],
    found: Plan,
    failures: Counter[str],
    seconds: float,
    left: int = 0,
    memory_mib: float = 0.0,
) -> RunSummary:
    reused = found.done + sum(len(same) for same in found.copied.values())
    computed = len(recordings) - reused - left
    return RunSummary(len(recordings), reused, computed, seconds, dict(failures), left, memory_mib)


class _Writer:
    """Collects rows and writes them in few files; on the way out as well, whatever happened."""

    def __init__(self, append: Callable[[list[dict[str, Any]]], None]) -> None:
        self._append, self._rows = append, list[dict[str, Any]]()
        self._started = self._written = time.monotonic()

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        rows, self._rows = self._rows, []
        self._append(rows)

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        self._rows += rows
        self.flush_if_due()

    def flush_if_due(self) -> None:
        now = time.monotonic()
        due_s = min(max(_FLUSH_SHARE * (now - self._started), _SHORTEST_FLUSH_S), _LONGEST_FLUSH_S)
        if self._rows and now - self._written >= due_s:
            rows, self._rows = self._rows, []
            self._append(rows)
            self._written = now


class _Meter:
    """
    Progress with rate and remaining time.

    Each recording counts by its size and the mean size together: the work follows the size, but
    not for small recordings.
    """

    def __init__(
        self, what: str, total: int, size: int, progress: Progress | None, cluster: Cluster
    ) -> None:
        self._what, self._total = what, total
        self._mean_size = max(1.0, size / max(1, total))
        self._progress = progress
        self._started, self._done, self._weight, self._failed = time.monotonic(), 0, 0.0, 0
        self._cluster = cluster
        dashboard = cluster.dashboard
        self._engine = f", dashboard {dashboard}" if dashboard else ""
        self._report("")

    def add(self, size: int, is_failed: bool) -> None:
        self._done += 1
        self._weight += size + self._mean_size
        self._failed += is_failed
        elapsed_s = time.monotonic() - self._started
        share = self._weight / (2.0 * self._mean_size * self._total)
        left = duration_text(max(0.0, elapsed_s * (1.0 - share) / share))
        rate = 60.0 * self._done / max(elapsed_s, 1e-9)
        failed = f", {self._failed} failed" if self._failed else ""
        self._report(f"{rate:.3g} a minute, {left} left{failed}")

    def say_what_is_lacking(self) -> None:
        """Report why nothing can go on, if nothing can."""
        if lacking := self._cluster.lacking:
            self._report(lacking)

    def _report(self, text: str) -> None:
        if self._progress is not None:
            counts = f"{self._what} {self._done}/{self._total}"
            text = f"{counts}, {text}" if text else counts
            self._progress(self._done, self._total, f"{text}{self._engine}")


def duration_text(seconds: float) -> str:
    """Return a duration in words: 45 s, 12 min, 3.5 h."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
