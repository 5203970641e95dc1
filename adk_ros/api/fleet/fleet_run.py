# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run a stage of `adk fleet` on recordings as a caller names them, or say what a run would do."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from adk_ros.api.fleet.default_rates import DEFAULT_CORE_S, default_basis
from adk_ros.api.fleet.recording_minutes import recording_minutes
from adk_ros.errors import UsageError
from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.plan import plan
from adk_ros.fleet.recordings import FleetRecording, find_recordings
from adk_ros.fleet.run import Limits, Progress, RunSummary, run_stage
from adk_ros.fleet.run_lock import run_lock
from adk_ros.fleet.stage import Stage, version_of
from adk_ros.fleet.tags import TAGS_FILE, TagTable, merge_tags, read_tags, tags_beside


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class FleetOptions:
    """
    How a stage runs.

    `workers`: local processes; `cluster`: address of a running scheduler instead. `tags`: the file
    fleet.csv; default: that in the folder of the recordings, if there is one.
    """

    workers: int = field(default_factory=available_cores)
    cluster: str | None = None
    tags: Path | None = None
    limits: Limits = field(default_factory=Limits)


@dataclass(frozen=True)
class FleetEstimate:
    """
    What a run would do.

    `total` recordings, of which `reused` have a result and `missing` do not; `unhashed` of these
    are new. `seconds`: expected duration with `workers`, local or those of the cluster, None
    without a rate or a worker. `basis`: where the rate comes from: `measured` recordings of this
    stage in the dataset, or a default. `notes`: what does not match in fleet.csv.
    """

    stage: str
    total: int
    reused: int
    missing: int
    unhashed: int
    bytes: int
    workers: int
    seconds: float | None
    measured: int
    basis: str = ""
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate for JSON."""
        return dict(vars(self))


def run_fleet(
    stage: Stage,
    recordings: Sequence[str],
    out: Path | str,
    options: FleetOptions | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """
    Run a stage on all recordings that have no result yet; an interrupted run continues.

    :param recordings: folders, globs and fsspec URLs.
    :param out: folder of the dataset.
    :raises UsageError: nothing is there, `out` is in use, or a service does not answer.
    """
    options = options or FleetOptions()
    check_options(options)
    out = Path(out)
    found, table = listed_recordings(recordings, options)
    cluster = partial(open_cluster, options.workers, options.cluster)
    with run_lock(out):
        keep_tags(out, table)
        summary = run_stage(stage, found, out, cluster, options.limits, progress)
    return replace(summary, notes=table.notes)


def keep_tags(out: Path, table: TagTable) -> None:
    """
    Keep the tags with the results, which are joined with them; those of other recordings stay.

    :raises UsageError: the table of the results cannot be read or written.
    """
    path = out / TAGS_FILE
    if table.tags and not (path.is_file() and Path(table.path).resolve() == path.resolve()):
        merge_tags(path, table.tags)


def tags_file(out: Path) -> list[tuple[str, Path | str | None]]:
    """
    Return role and path of the tags that are kept with the results, for the provenance.

    The hashes of the recordings are in the dataset.
    """
    path = out / TAGS_FILE
    return [("tags", path)] if path.is_file() else []


def estimate_fleet(
    stage: Stage, recordings: Sequence[str], out: Path | str, options: FleetOptions | None = None
) -> FleetEstimate:
    """
    Return what `run_fleet` would do; writes nothing.

    The time is the bytes to process at the mean rate of the results in the dataset, or the minutes
    of recording at a default rate (`default_rates`).
    """
    options = options or FleetOptions()
    check_options(options)
    options = replace(options, workers=workers_of(options))
    found, table = listed_recordings(recordings, options)
    return replace(estimate_stage(stage, found, Path(out), options), notes=table.notes)


def workers_of(options: FleetOptions) -> int:
    """
    Return the number of recordings that are processed at a time: 0 for a cluster without workers.

    :raises UsageError: no scheduler answers.
    """
    if options.cluster is None:
        return options.workers
    with open_cluster(options.workers, options.cluster) as cluster:
        return cluster.threads


def estimate_stage(
    stage: Stage, found: Sequence[FleetRecording], out: Path, options: FleetOptions
) -> FleetEstimate:
    """Return what a stage would do on these recordings, as `estimate_fleet`."""
    dataset = FleetDataset(out)
    hashes = dataset.content_hashes()
    todo = plan(version_of(stage), found, hashes, dataset, options.limits.retry_failed)
    unhashed = todo.to_hash(options.limits.count)
    sizes = [work.size for work in todo.missing] + [each.size for each in unhashed]
    sizes = sizes[: options.limits.count]
    seconds, rate_bytes, measured = dataset.rates(stage.name)
    expected, basis = None, f"the rate of {measured} recordings" if measured else ""
    if not sizes:
        expected = 0.0
    elif options.workers and rate_bytes:
        expected = seconds * sum(sizes) / rate_bytes / options.workers
    elif options.workers and stage.name in DEFAULT_CORE_S:
        minutes = recording_minutes(found, dataset)
        if minutes is not None:
            share = sum(sizes) / sum(each.size for each in found)
            expected = DEFAULT_CORE_S[stage.name] * minutes * share / options.workers
            basis = default_basis(stage.name)
    return FleetEstimate(
        stage.name,
        len(found),
        todo.done + sum(len(same) for same in todo.copied.values()),
        len(sizes),
        len(unhashed),
        sum(sizes),
        options.workers,
        expected,
        measured,
        basis,
    )


def check_options(options: FleetOptions) -> None:
    """
    Check how a stage is to run.

    :raises UsageError: a value is out of range.
    """
    if options.workers < 1:
        raise UsageError(f"--workers {options.workers}: at least one")
    if not options.limits.timeout_s > 0.0:
        raise UsageError(f"--timeout {options.limits.timeout_s:g}: must be positive")
    if not options.limits.memory_mib > 0.0:
        raise UsageError(f"--memory {options.limits.memory_mib:g}: must be positive")
    if options.limits.count is not None and options.limits.count < 1:
        raise UsageError(f"--limit {options.limits.count}: at least one")


def listed_recordings(
    recordings: Sequence[str], options: FleetOptions
) -> tuple[list[FleetRecording], TagTable]:
    """
    Return the recordings, sorted by name, and what fleet.csv says about them.

    :raises UsageError: nothing is there, or fleet.csv is wrong.
    """
    found = find_recordings(recordings)
    path = tags_beside(recordings) if options.tags is None else options.tags
    return found, TagTable() if path is None else read_tags(path, found)


def chosen_recordings(found: Sequence[FleetRecording], count: int | None) -> list[FleetRecording]:
    """
    Return `count` of the recordings, None for all, in their order.

    They are chosen by the hash of their names: spread over the vehicles and days by which
    recordings are named, and a larger number includes those of a smaller one.
    """
    order = sorted(found, key=lambda each: sha256(each.name.encode()).digest())
    chosen = {each.name for each in order[:count]}
    return [each for each in found if each.name in chosen]
