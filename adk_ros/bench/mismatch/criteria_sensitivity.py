# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of the answers to each criterion of a decision: halved and doubled.

A case in which no decision changes has the same answer with the other value. The others are
analysed again (`vary`), so that the score of each value is known on all cases.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from adk_ros.bench.mismatch.case_jobs import CaseJob
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.mismatch_bench import run_case
from adk_ros.bench.mismatch.subprocesses import Subprocesses

VARIED = "varied.jsonl"
"""File of scores in the output folder: criterion, factor, key of the case, score."""
HALF, DOUBLE = 0.5, 2.0
_KEYS = {HALF: "changed_by_half", DOUBLE: "changed_by_double"}

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, order=True)
class Change:
    """A criterion multiplied by `factor`, and a case in which that changes a decision."""

    criterion: str
    factor: float
    case: str


def changes(answers: dict[str, dict[str, Any]], pattern: str = "*") -> list[Change]:
    """
    Return all changes of the criteria that a pattern selects.

    `answers`: the content of mismatch.json by case; `pattern`: names with *, separated by commas.
    """
    wanted = [x.strip() for x in pattern.split(",")]
    return sorted(
        Change(criterion, factor, case)
        for case, answer in answers.items()
        for criterion, counts in _criteria(answer).items()
        for factor, key in _KEYS.items()
        if counts[key] and any(fnmatchcase(criterion, x) for x in wanted)
    )


def vary(
    found: Sequence[Change],
    jobs: Sequence[CaseJob],
    workers: int,
    store: Path,
    progress: Progress,
) -> dict[Change, float]:
    """
    Analyse the changed cases with the other value of the criterion; return the scores.

    Each score is added to the file `store`; those in it, of the same case and code, are reused.
    """
    by_name = {job.name: job for job in jobs}
    processes = Subprocesses()
    out = _stored(store, found, by_name)
    todo = [change for change in found if change not in out]
    try:
        with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(workers) as pool:

            def run(i: int, change: Change) -> float:
                folder = Path(scratch) / str(i)
                folder.mkdir()
                job = by_name[change.case]
                factors = {change.criterion: change.factor}
                result = run_case(
                    job.write(folder), folder / "report", processes, job.write_noise_free, factors
                )
                shutil.rmtree(folder)
                return result.right

            progress(len(out), len(found), "")
            for change, right in zip(todo, pool.map(run, range(len(todo)), todo), strict=True):
                out[change] = right
                with store.open("a", encoding="utf-8") as file:
                    key = by_name[change.case].key
                    file.write(json.dumps([change.criterion, change.factor, key, right]) + "\n")
                progress(len(out), len(found), f"{change.criterion} x {change.factor:g}")
    finally:
        processes.end()
    return out


def _stored(store: Path, found: Sequence[Change], jobs: dict[str, CaseJob]) -> dict[Change, float]:
    """Return the scores in a file that belong to these changes."""
    if not store.is_file():
        return {}
    scores: dict[tuple[str, float, str], float] = {}
    for line in store.read_text(encoding="utf-8").splitlines():
        with suppress(ValueError, TypeError):  # A last line that was cut off.
            criterion, factor, key, right = json.loads(line)
            scores[criterion, factor, key] = right
    keys = {change: (change.criterion, change.factor, jobs[change.case].key) for change in found}
    return {change: scores[key] for change, key in keys.items() if key in scores}


def sensitivity_lines(
    results: Sequence[CaseResult],
    answers: dict[str, dict[str, Any]],
    varied: dict[Change, float],
) -> list[str]:
    """
    Return a line per criterion: in how many cases it decides, and what another value changes.

    Also the change in the sum of the scores of those that are `varied`.
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
            analysed = [x for x in cases if x in varied]
            if analysed:
                gained = sum(varied[x] - scores[x.case] for x in analysed)
                text += f", {gained:+.2f} right in {len(analysed)} of them"
            parts.append(text)
        lines.append(f"{name} decides in {deciding} of {len(answers)} cases; {'; '.join(parts)}")
    return lines


def _criteria(answer: dict[str, Any]) -> dict[str, dict[str, int]]:
    criteria: dict[str, dict[str, int]] = answer["selection"].get("criteria", {})
    return criteria
