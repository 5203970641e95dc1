# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run the whole benchmark: simulate drives, train and evaluate all predictors, in parallel."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from adk_ros.bench.paper import training_jobs
from adk_ros.bench.paper.av21 import RecordingScores, recording_job
from adk_ros.bench.paper.baseline_libraries import find_python
from adk_ros.bench.paper.cases import CLEAN, NOMINAL, VARIANTS
from adk_ros.bench.paper.effect_job import effect_job
from adk_ros.bench.paper.online_effect import Reading
from adk_ros.bench.paper.outcome_store import OutcomeStore
from adk_ros.bench.paper.predictors import PYKOOP, PYKOOPMAN
from adk_ros.bench.paper.scores import ScoreTable
from adk_ros.bench.paper.training_jobs import BenchPlan, NoteProgress, Outcome, TrainingJob
from adk_ros.errors import DataError, UsageError
from adk_ros.shutdown import TERMINATED, begin_worker, end_all

Progress = Callable[[float, float, str], None]
Note = Callable[[str], None]
Keep = Callable[[Outcome], None]

KINDS: dict[str, Callable[[TrainingJob, BenchPlan, Path, NoteProgress], Outcome]] = {
    "simulate": training_jobs.simulate_job,
    "recording": recording_job,
    "effect": effect_job,
    "default": training_jobs.default_job,
    "aldk": training_jobs.paper_job,
    "dk": training_jobs.paper_job,
    "peers": training_jobs.peers_job,
    "tuned": training_jobs.tuned_job,
    "floor": training_jobs.floor_job,
    "naive": training_jobs.naive_job,
}
"""Job functions by kind, longest first: then no process is left with a long job at the end."""
_POLL_S = 0.5
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


def _forget(outcome: Outcome) -> None:
    """Keep nothing."""


_progress: Any = None
"""In a worker: completed fraction of each job, shared with the parent process."""


@dataclass
class Result:
    """All measurements; `without`: why the baseline libraries did not take part."""

    board: ScoreTable
    recorded: RecordingScores | None
    outcomes: list[Outcome]
    without: str = ""
    seconds: float = 0.0
    settings: dict[str, str] = field(default_factory=dict)
    readings: list[Reading] = field(default_factory=list)


def effect_plan(plan: BenchPlan) -> BenchPlan:
    """Return the plan with the nominal drive and the job "effect" alone."""
    others = tuple(kind for kind in KINDS if kind not in {"simulate", "effect"})
    return replace(plan, tests=(NOMINAL,), left_out=others, recordings=(), peers=False)


def check(plan: BenchPlan) -> None:
    """
    Check a plan before hours are spent on it.

    :raises UsageError: an unknown test, seeds out of range, the nominal drive is not among the
        tests, or a recording is missing or named like another.
    """
    known = plan.drives.tests
    unknown = [test for test in plan.tests if test not in known]
    if unknown:
        raise UsageError(f"test '{unknown[0]}' is unknown: choose from {', '.join(known)}")
    if NOMINAL not in plan.tests:
        raise UsageError(f"the test '{NOMINAL}' is part of every run: its drive is trained on")
    if not 1 <= plan.seeds <= 100:
        raise UsageError(f"--seeds is {plan.seeds}: choose 1 to 100")
    names: dict[str, Path] = {}
    for path in plan.recordings:
        if not path.exists():
            raise UsageError(f"recording {path} does not exist")
        # Results are reported by name.
        if path.name in names:
            raise UsageError(f"recordings {names[path.name]} and {path} have the same name")
        names[path.name] = path


def run_paper(
    plan: BenchPlan,
    folder: Path,
    workers: int = 2,
    progress: Progress | None = None,
    note: Note | None = None,
    store: OutcomeStore | None = None,
) -> Result:
    """
    Run the whole plan; drives and the data of the figures are written to `folder`.

    :param workers: processes of one thread each; 0 runs all jobs in this process.
    :param store: where outcomes are kept; jobs whose outcome it has are not run again. What they
        wrote to `folder` must be there.
    :raises UsageError, DataError: as `check`, training and recordings.
    """
    check(plan)
    started = time.monotonic()
    without = "" if plan.peers else "switched off (--no-peers)"
    if plan.peers:
        try:
            find_python()
        except UsageError as error:
            without = str(error)
    if without and note and "peers" not in plan.left_out:
        note(f"without pykoop and pykoopman: {without}")
    drives = [TrainingJob("simulate", about=test) for test in plan.tests]
    after = planned(plan, not without)
    jobs = max(len(drives), len(after))
    pool = _InProcess(plan, folder) if workers == 0 else _Pool(plan, folder, workers, jobs)
    with pool:
        outcomes = _run(pool, drives, "simulating", progress, note, store)
        outcomes += _run(pool, after, "training and predicting", progress, note, store)
    board = ScoreTable()
    # Sorted in the plan's order, which numbers the seeds and makes the report reproducible.
    order = {job: i for i, job in enumerate([*drives, *after])}
    outcomes.sort(key=lambda outcome: order[outcome.job])
    settings: dict[str, str] = {}
    for outcome in outcomes:
        if outcome.job.kind == "recording":
            continue
        for test, name, item in outcome.scores:
            board.add(outcome.job.variant, test, name, item)
        for name, text in outcome.notes.items():
            settings[f"{name}, {outcome.job.variant}"] = text
    failed = [outcome.failed for outcome in outcomes if outcome.failed]
    if failed:
        # Both variants or none: half a comparison would be misread as a complete one.
        without = failed[0]
        board.drop(PYKOOP, PYKOOPMAN)
        if note:
            note(f"without pykoop and pykoopman: {without}")
    on_recordings = [o for o in outcomes if o.job.kind == "recording"]
    recorded = RecordingScores.of(on_recordings) if on_recordings else None
    readings = [reading for outcome in outcomes for reading in outcome.readings]
    seconds = time.monotonic() - started
    return Result(board, recorded, outcomes, without, seconds, settings, readings)


def _run(
    pool: _InProcess | _Pool,
    jobs: list[TrainingJob],
    what: str,
    progress: Progress | None,
    note: Note | None,
    store: OutcomeStore | None,
) -> list[Outcome]:
    """Run the jobs whose outcomes are not kept, keep theirs, and return all."""
    if store is None:
        return pool.run(jobs, what, progress, note)
    kept = {job: store.load(job) for job in jobs}
    todo = [job for job in jobs if kept[job] is None]
    found = [outcome for outcome in kept.values() if outcome is not None]
    return found + pool.run(todo, what, progress, note, store.save)


def planned(plan: BenchPlan, peers: bool) -> list[TrainingJob]:
    """Return all jobs but the simulations, longest first."""
    result = []
    for kind in KINDS:
        if kind == "simulate" or kind in plan.left_out or (kind == "peers" and not peers):
            continue
        if kind == "recording":
            for path in plan.recordings:
                seeds = 1 if plan.quick else plan.seeds
                result += [TrainingJob(kind, "recorded", seed, path.name) for seed in range(seeds)]
            continue
        seeds = plan.seeds if kind == "default" else 1
        # The paper has no noise.
        variants = (CLEAN,) if kind == "effect" else VARIANTS
        result += [
            TrainingJob(kind, variant, seed) for variant in variants for seed in range(seeds)
        ]
    return result


class _InProcess:
    """Runs jobs one after the other in this process."""

    def __init__(self, plan: BenchPlan, folder: Path) -> None:
        self._plan, self._folder = plan, folder

    def __enter__(self) -> _InProcess:
        return self

    def __exit__(self, *error: object) -> None:
        """Release nothing: there are no processes."""

    def run(
        self,
        todo: list[TrainingJob],
        what: str,
        progress: Progress | None,
        note: Note | None,
        keep: Keep = _forget,
    ) -> list[Outcome]:
        """Run all of `todo`; `keep` is called with each outcome."""
        outcomes = []
        for number, job in enumerate(todo):

            def report(share: float, number: int = number, job: TrainingJob = job) -> None:
                if progress is not None:
                    progress(number + share, len(todo), f"{what}: {job.name}")

            outcomes.append(KINDS[job.kind](job, self._plan, self._folder, report))
            keep(outcomes[-1])
            report(1.0)
        return outcomes


def _begin(fractions: Any) -> None:
    """Set up a worker process."""
    global _progress  # noqa: PLW0603 (shared memory reaches a worker only when it starts)
    _progress = fractions
    begin_worker()


def _work(number: int, job: TrainingJob, plan: BenchPlan, folder: Path) -> Outcome:
    def report(share: float) -> None:
        _progress[number] = share

    try:
        return KINDS[job.kind](job, plan, folder, report)
    except SystemExit:
        # SIGTERM: the job has cleaned up, but the executor would wait for the next one.
        os._exit(TERMINATED)


class _Pool:
    """
    Runs jobs on processes of one thread each, spawned: torch does not survive a fork.

    :param jobs: largest number of jobs in one `run`.
    """

    def __init__(self, plan: BenchPlan, folder: Path, workers: int, jobs: int) -> None:
        self._plan, self._folder, self._workers = plan, folder, workers
        context = multiprocessing.get_context("spawn")
        self._progress = context.Array("d", jobs, lock=False)
        self._kept = {name: os.environ.get(name) for name in _THREADS}
        os.environ.update(dict.fromkeys(_THREADS, "1"))
        self._before = set(multiprocessing.active_children())
        self._executor = ProcessPoolExecutor(
            workers, mp_context=context, initializer=_begin, initargs=(self._progress,)
        )

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        for name, value in self._kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        if kind is not None:
            end_all(set(multiprocessing.active_children()) - self._before)
        # Wait even for a broken pool: its thread would otherwise print a traceback if it still
        # closes a pipe when the interpreter exits.
        self._executor.shutdown(wait=True, cancel_futures=True)

    def run(
        self,
        todo: list[TrainingJob],
        what: str,
        progress: Progress | None,
        note: Note | None,
        keep: Keep = _forget,
    ) -> list[Outcome]:
        """
        Run all of `todo` and report the progress; the first failure ends the run.

        `keep` is called with each outcome.
        """
        for i in range(len(todo)):
            self._progress[i] = 0.0
        futures: dict[Future[Outcome], TrainingJob] = {
            self._executor.submit(_work, i, job, self._plan, self._folder): job
            for i, job in enumerate(todo)
        }
        numbers = {job: i for i, job in enumerate(todo)}
        outcomes: list[Outcome] = []
        open_ones = set(futures)
        while open_ones:
            finished, open_ones = wait(open_ones, _POLL_S, FIRST_COMPLETED)
            for future in finished:
                try:
                    outcomes.append(future.result())
                except BrokenProcessPool:
                    raise DataError(
                        "a worker process was killed, possibly for lack of memory: try --jobs 1"
                    ) from None
                keep(outcomes[-1])
                self._progress[numbers[futures[future]]] = 1.0
            if progress is not None:
                running = [futures[f].name for f in futures if f in open_ones and f.running()]
                done = sum(self._progress[: len(todo)])
                progress(done, len(todo), f"{what}: {', '.join(running[: self._workers])}")
        return outcomes
