# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run `adk mismatch` on cases, each in a separate process, and score the answers.

The tool gets the simulation, the recording and the vehicle file of a case (`case_jobs`); the label
is read only for scoring. A report moves to the output folder when it is complete and scored, so an
interrupted run can be resumed.
"""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.baselines import Baselines
from adk_ros.bench.mismatch.case_files import recordings_of
from adk_ros.bench.mismatch.case_jobs import LABEL, CaseJob
from adk_ros.bench.mismatch.case_score import CaseResult, detectable, score_case
from adk_ros.bench.mismatch.proven_ties import proven_ties, reported_ties
from adk_ros.bench.mismatch.reliability import ScoredClaim
from adk_ros.bench.mismatch.subprocesses import ProcessResult, Subprocesses
from adk_ros.errors import UsageError
from adk_ros.mismatch.deployment.held_out import Evidence, horizon_errors, rmse
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.report.result_files import RESULT_FILE
from adk_ros.plant.scenario.random_routes import AlwaysSpins
from adk_ros.signals.channels import STATE_NAMES

HORIZON_S = 1.0
"""Horizon of the held-out error, s."""
SCORED, SIZES = "score.json", "detectable.csv"
WEAKEST = 0.1
"""Strength up to which the detectable size of an effect is computed, about 40 s a case."""

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True)
class MismatchBench:
    """
    Benchmark run: output folder, number of parallel cases, and whether to skip finished ones.

    `baselines`: other methods to run on each case as well, also on those finished without them.
    `left_out`: a line for each case that could not be generated, which has no result.
    """

    out: Path
    workers: int = 1
    resume: bool = False
    baselines: Baselines | None = None
    left_out: list[str] = field(default_factory=list)

    def run(self, jobs: Sequence[CaseJob], progress: Progress | None = None) -> list[CaseResult]:
        """
        Run and score all cases; return the results in their order.

        An interruption ends all processes and keeps complete reports.
        :raises UsageError: a folder in `out` is not a report of this command.
        """
        tell = progress or (lambda done, total, text: None)
        self._check(jobs)
        found = {
            job.name: s
            for job in jobs
            if (s := self._earlier(job)) is not None and (s.baselines or self.baselines is None)
        }
        todo = [job for job in jobs if job.name not in found]
        existed = self.out.exists()
        self.out.mkdir(parents=True, exist_ok=True)
        processes = Subprocesses()
        try:
            with tempfile.TemporaryDirectory(prefix=".concealed_", dir=self.out) as scratch:
                pool = ThreadPoolExecutor(self.workers)
                try:
                    waiting = {
                        pool.submit(self._case, job, Path(scratch), processes): job for job in todo
                    }
                    tell(len(found), len(jobs), "")
                    while waiting:
                        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                        for future in done:
                            job = waiting.pop(future)
                            try:
                                found[job.name] = future.result()
                            except AlwaysSpins as error:
                                # It says nothing about the tool.
                                self.left_out.append(str(error))
                            tell(len(found) + len(self.left_out), len(jobs), job.name)
                finally:
                    processes.end()
                    if self.baselines is not None:
                        self.baselines.close()
                    pool.shutdown(wait=True, cancel_futures=True)
        except BaseException:
            if not existed:
                with suppress(OSError):
                    self.out.rmdir()
            raise
        return [found[job.name] for job in jobs if job.name in found]

    def _check(self, jobs: Sequence[CaseJob]) -> None:
        for job in jobs:
            path = self.out / job.name
            if path.exists() and not (path / SCORED).is_file():
                raise UsageError(
                    f"{path} exists and is not a report of this command: choose another --out"
                )

    def _earlier(self, job: CaseJob) -> CaseResult | None:
        """Return the score of the same case from an earlier run, if it may be reused."""
        path = self.out / job.name / SCORED
        if not self.resume or not path.is_file():
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            earlier = CaseResult(**content["score"])
            earlier.claims = [ScoredClaim(*claim) for claim in earlier.claims]
        except (ValueError, KeyError, TypeError):
            return None
        return earlier if content["key"] == job.key else None

    def _case(self, job: CaseJob, scratch: Path, processes: Subprocesses) -> CaseResult:
        folder = scratch / job.name
        folder.mkdir()
        case = job.write(folder)
        report = folder / "report"
        result = self._earlier(job)
        if result is None:
            result = run_case(case, report, processes, job.write_noise_free, job.factors)
            result.case = job.name
        else:
            shutil.copytree(self.out / job.name, report)
        label = json.loads((case / LABEL).read_text(encoding="utf-8"))
        if self.baselines is not None and not result.failure:
            result.baselines = self.baselines.compare_baselines(
                read_sensor_log(case / "recording", needs_imu=False),
                report,
                label,
                json.loads((report / RESULT_FILE).read_text(encoding="utf-8")),
            )
        if not result.failure:
            content = {"key": job.key, "label": label, "score": asdict(result)}
            (report / SCORED).write_text(json.dumps(content, indent=1), encoding="utf-8")
            path = self.out / job.name
            if path.exists():
                shutil.rmtree(path)
            os.replace(report, path)
        shutil.rmtree(folder)
        return result


def run_case(
    case: Path,
    out: Path,
    processes: Subprocesses | None = None,
    write_noise_free: Callable[[Path], Path] | None = None,
    factors: Mapping[str, float] | None = None,
) -> CaseResult:
    """
    Run the tool on one case and score its answer; the report is written to `out`.

    `write_noise_free(folder)` writes the case without sensor noise and returns its path: reported
    ties are then examined. `factors`: a criterion to multiply, and by how much.
    """
    arguments = [
        "mismatch", "--simulation", str(case / "simulation"),
        *(x for path in recordings_of(case) for x in ("--recording", str(path))),
        "--vehicle", str(case / "vehicle.yaml"), "--out", str(out),
    ]  # fmt: skip
    process = (processes or Subprocesses()).adk(arguments, factors)
    label = json.loads((case / LABEL).read_text(encoding="utf-8"))
    result = _scored(case, label, out, process, write_noise_free)
    if result.kind == "single" and result.strength <= WEAKEST and not result.failure:
        sizes = detectable_sizes(case, label, out / SIZES, processes or Subprocesses())
        result.detectable = detectable(label, sizes)
    return result


def detectable_sizes(
    case: Path, label: dict[str, Any], out: Path, processes: Subprocesses
) -> dict[tuple[str, str], float]:
    """Return the sizes that `adk detectable` states for as much driving; empty if it fails."""
    minutes = max(t[1] for x in label["effects"] for t in x["time_intervals_s"]) / 60.0
    minutes *= len(recordings_of(case))
    arguments = [
        "detectable", "--simulation", str(case / "simulation"),
        "--recording", str(case / "recording"), "--vehicle", str(case / "vehicle.yaml"),
        "--minutes", f"{minutes:.3f}", "--out", str(out),
    ]  # fmt: skip
    if processes.adk(arguments).status != 0:
        return {}
    with out.open(encoding="utf-8", newline="") as file:
        return {
            (row["effect"], row["parameter"]): float(row["size"] or math.nan)
            for row in csv.DictReader(file)
        }


def _scored(
    case: Path,
    label: dict[str, Any],
    out: Path,
    process: ProcessResult,
    write_noise_free: Callable[[Path], Path] | None,
) -> CaseResult:
    if process.status != 0:
        result = score_case(case.name, label, {"verdict": "failed"})
        result.failure = process.output or "no message"
    else:
        answer = json.loads((out / RESULT_FILE).read_text(encoding="utf-8"))
        proven: list[str] = []
        # The proof is about one recording.
        tied = reported_ties(label, answer) if len(recordings_of(case)) == 1 else []
        if tied and write_noise_free is not None:
            with tempfile.TemporaryDirectory(dir=out.parent) as folder:
                noise_free = write_noise_free(Path(folder))
                proven = proven_ties(label, tied, case, noise_free, out)
        result = score_case(case.name, label, answer, proven)
        result.removed, result.raised_held_out = held_out_errors(case / "heldout", out)
    result.seconds, result.cpu_s = process.seconds, process.cpu_s
    result.memory_mib = process.memory_mib
    return result


def held_out_errors(held_out: Path, report: Path) -> tuple[dict[str, float], float]:
    """
    Return the effect of the correction on the error 1 s ahead on a further recording.

    First by channel the share of the removable error that is removed: the removable error is the
    one above the noise of the odometry; channels in which the simulation's error is within 1.5
    times the noise are left out. Second the largest relative increase of any channel's error, NaN
    without a recording.
    """
    if not held_out.exists():
        return {}, math.nan
    log = read_sensor_log(held_out, needs_imu=False)
    recordings = [Evidence(log)]
    before, after = (
        rmse(horizon_errors(load_surrogate(report / name).content, recordings, (HORIZON_S,)))[0]
        for name in ("simulation.yaml", "corrected.yaml")
    )
    noise = log.noise()[3:]
    removed = {
        name: float((before[i] - after[i]) / (before[i] - noise[i]))
        for i, name in enumerate(STATE_NAMES)
        if before[i] > 1.5 * noise[i]
    }
    return removed, float(np.max(after / before)) - 1.0
