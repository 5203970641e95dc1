# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of the answers to each criterion of a decision: halved and doubled.

A case in which no decision changes has the same answer with the other value. The others are
analysed again (`vary`), so that the score of each value is known on all cases.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adk_ros.bench.mismatch.case_jobs import CaseJob
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.mismatch_bench import run_case
from adk_ros.bench.mismatch.subprocesses import Subprocesses

HALF, DOUBLE = 0.5, 2.0
_KEYS = {HALF: "changed_by_half", DOUBLE: "changed_by_double"}

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, order=True)
class Change:
    """A criterion multiplied by `factor`, and a case in which that changes a decision."""

    criterion: str
    factor: float
    case: str


def changes(answers: dict[str, dict[str, Any]]) -> list[Change]:
    """Return all changes; `answers`: the content of mismatch.json by case."""
    return sorted(
        Change(criterion, factor, case)
        for case, answer in answers.items()
        for criterion, counts in _criteria(answer).items()
        for factor, key in _KEYS.items()
        if counts[key]
    )


def vary(
    found: Sequence[Change], jobs: Sequence[CaseJob], workers: int, progress: Progress
) -> dict[Change, CaseResult]:
    """Analyse the changed cases with the other value of the criterion and score the answers."""
    by_name = {job.name: job for job in jobs}
    processes = Subprocesses()
    out: dict[Change, CaseResult] = {}
    try:
        with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(workers) as pool:

            def run(i: int, change: Change) -> CaseResult:
                folder = Path(scratch) / str(i)
                folder.mkdir()
                job = by_name[change.case]
                factors = {change.criterion: change.factor}
                return run_case(
                    job.write(folder), folder / "report", processes, job.write_noise_free, factors
                )

            progress(0, len(found), "")
            results = pool.map(run, range(len(found)), found)
            for change, result in zip(found, results, strict=True):
                out[change] = result
                progress(len(out), len(found), f"{change.criterion} x {change.factor:g}")
    finally:
        processes.end()
    return out


def sensitivity_lines(
    results: Sequence[CaseResult],
    answers: dict[str, dict[str, Any]],
    varied: dict[Change, CaseResult] | None,
) -> list[str]:
    """
    Return a line per criterion: in how many cases it decides, and what another value changes.

    With `varied`, also the change in the sum of the scores of all cases.
    """
    scores = {result.case: result.right for result in results}
    found = changes(answers)
    lines = []
    for name in sorted({x for answer in answers.values() for x in _criteria(answer)}):
        deciding = sum(name in _criteria(answer) for answer in answers.values())
        parts = []
        for factor, word in ((HALF, "halved"), (DOUBLE, "doubled")):
            cases = [x for x in found if (x.criterion, x.factor) == (name, factor)]
            text = f"{word}: a decision changes in {len(cases)}"
            if varied is not None and cases:
                gained = sum(varied[x].right - scores[x.case] for x in cases)
                text += f", {gained:+.2f} right"
            parts.append(text)
        lines.append(f"{name} decides in {deciding} of {len(answers)} cases; {'; '.join(parts)}")
    return lines


def _criteria(answer: dict[str, Any]) -> dict[str, dict[str, int]]:
    criteria: dict[str, dict[str, int]] = answer["selection"].get("criteria", {})
    return criteria
