# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs `adk mismatch` on cases, each in a process of its own, and scores the answers.

A case is a folder with `simulation`, `recording`, `heldout`, `vehicle.yaml` and `label.json`. The
tool is given the first two and the vehicle; the label is read when the answer is there. A report
comes to lie beside the others once it is whole and scored, so that an interrupted run leaves
finished ones, which the next can go on from.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from adk_ros.bench.mismatch.baselines import Baselines
from adk_ros.bench.mismatch.case_matrix import select_plans
from adk_ros.bench.mismatch.case_score import CaseResult, score_case
from adk_ros.bench.mismatch.subprocesses import Subprocesses, Usage
from adk_ros.errors import UsageError
from adk_ros.mismatch.deployment.open_loop import FIRST_START_S, horizon_rmse
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.report.result_files import RESULT_FILE
from adk_ros.signals.channels import STATE_NAMES

HORIZON_S = 1.0
SCORED = "score.json"
LABEL = "label.json"

Progress = Callable[[float, float, str], None]


class CaseJob(NamedTuple):
    """A case to come: `write` makes it below a folder and returns where; `key` tells it apart."""

    name: str
    key: str
    write: Callable[[Path], Path]


def find_cases(folder: Path) -> list[Path]:
    """
    Return the cases in a folder, by name.

    Raises `UsageError` where there is none.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is no folder: give one that holds cases")
    cases = sorted(path.parent for path in folder.glob(f"*/{LABEL}"))
    if not cases:
        raise UsageError(f"{folder} holds no case: a folder with label.json and its recordings")
    return cases


def jobs_of(folder: Path) -> list[CaseJob]:
    """Return a job for each case of a folder."""
    return [
        CaseJob(case.name, _digest((case / LABEL).read_bytes()), partial(_existing_case, case))
        for case in find_cases(folder)
    ]


def _existing_case(case: Path, folder: Path) -> Path:
    """Where a case is that need not be made."""
    return case


def generated_jobs(limit: int) -> list[CaseJob]:
    """Return jobs that make cases of our own."""
    return [
        CaseJob(plan.name, _digest(repr(plan).encode()), plan.write)
        for plan in select_plans(limit)
    ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


@dataclass(frozen=True)
class MismatchBench:
    """
    Where reports go, how many cases run at a time, and whether finished ones are kept.

    `rivals`: other methods, run on each case as well.
    """

    out: Path
    at_once: int = 1
    resume: bool = False
    rivals: Baselines | None = None

    def run(self, jobs: Sequence[CaseJob], progress: Progress | None = None) -> list[CaseResult]:
        """
        Run and score all cases; in their order.

        Raises `UsageError` where a folder in `out` is in the way. Interrupted, it ends what it
        began and leaves the reports that are whole.
        """
        tell = progress or (lambda done, total, text: None)
        self._check(jobs)
        found = {job.name: s for job in jobs if (s := self._earlier(job)) is not None}
        todo = [job for job in jobs if job.name not in found]
        there = self.out.exists()
        self.out.mkdir(parents=True, exist_ok=True)
        children = Subprocesses()
        try:
            with tempfile.TemporaryDirectory(prefix=".concealed_", dir=self.out) as scratch:
                pool = ThreadPoolExecutor(self.at_once)
                try:
                    waiting = {
                        pool.submit(self._case, job, Path(scratch), children): job for job in todo
                    }
                    tell(len(found), len(jobs), "")
                    while waiting:
                        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                        for future in done:
                            job = waiting.pop(future)
                            found[job.name] = future.result()
                            tell(len(found), len(jobs), job.name)
                finally:
                    children.end()
                    if self.rivals is not None:
                        self.rivals.close()
                    pool.shutdown(wait=True, cancel_futures=True)
        except BaseException:
            if not there:
                with suppress(OSError):
                    self.out.rmdir()
            raise
        return [found[job.name] for job in jobs]

    def _check(self, jobs: Sequence[CaseJob]) -> None:
        for job in jobs:
            place = self.out / job.name
            if place.exists() and not (place / SCORED).is_file():
                raise UsageError(
                    f"{place} is there and no report of this command: name another --out"
                )

    def _earlier(self, job: CaseJob) -> CaseResult | None:
        """Return the score of an earlier run of the same case, if it is to be kept."""
        path = self.out / job.name / SCORED
        if not self.resume or not path.is_file():
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            earlier = CaseResult(**content["score"])
        except (ValueError, KeyError, TypeError):
            return None
        if self.rivals is not None and not earlier.baselines:
            return None
        return earlier if content["key"] == job.key else None

    def _case(self, job: CaseJob, scratch: Path, children: Subprocesses) -> CaseResult:
        folder = scratch / job.name
        folder.mkdir()
        case = job.write(folder)
        report = folder / "report"
        result = run_case(case, report, children)
        result.case = job.name
        if self.rivals is not None and not result.failure:
            result.baselines = self.rivals.compare_baselines(
                read_sensor_log(case / "recording", needs_imu=False),
                report,
                json.loads((case / LABEL).read_text(encoding="utf-8")),
                json.loads((report / RESULT_FILE).read_text(encoding="utf-8")),
            )
        if not result.failure:
            content = {"key": job.key, "score": asdict(result)}
            (report / SCORED).write_text(json.dumps(content, indent=1), encoding="utf-8")
            place = self.out / job.name
            if place.exists():
                shutil.rmtree(place)
            os.replace(report, place)
        shutil.rmtree(folder)
        return result


def run_case(case: Path, out: Path, children: Subprocesses | None = None) -> CaseResult:
    """Run the tool on one case and score its answer; the report goes into `out`."""
    arguments = [
        "mismatch", "--simulation", str(case / "simulation"),
        "--recording", str(case / "recording"), "--vehicle", str(case / "vehicle.yaml"),
        "--out", str(out),
    ]  # fmt: skip
    used = (children or Subprocesses()).adk(arguments)
    label = json.loads((case / LABEL).read_text(encoding="utf-8"))
    return _scored(case, label, out, used)


def _scored(case: Path, label: dict[str, object], out: Path, used: Usage) -> CaseResult:
    if used.status != 0:
        result = score_case(case.name, label, {"verdict": "failed"})
        result.failure = used.output or "it said nothing"
    else:
        answer = json.loads((out / RESULT_FILE).read_text(encoding="utf-8"))
        result = score_case(case.name, label, answer)
        result.removed = removed(case / "heldout", out)
    result.seconds, result.cpu_s, result.memory_mib = used.seconds, used.cpu_s, used.memory_mib
    return result


def removed(heldout: Path, report: Path) -> dict[str, float]:
    """
    Return by channel the share of the held-out error 1 s ahead that the correction removes.

    What can be removed is what lies above the noise with which odometry reports that channel;
    channels in which the simulation is already there (within 1.5 times) are left out.
    """
    if not heldout.exists():
        return {}
    evidence = read_sensor_log(heldout, needs_imu=False)
    before, after = (
        horizon_rmse(load_surrogate(report / name).content, evidence, HORIZON_S, FIRST_START_S)
        for name in ("simulation.yaml", "corrected.yaml")
    )
    floor = evidence.noise()[3:]
    return {
        name: float((before[i] - after[i]) / (before[i] - floor[i]))
        for i, name in enumerate(STATE_NAMES)
        if before[i] > 1.5 * floor[i]
    }
