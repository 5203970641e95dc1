# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of the answers to each criterion of a decision: halved and doubled.

The cases in which a decision changes are analysed again with the other value (`varied_job`). A
criterion that takes part in no recorded decision, such as the prior of a nuisance parameter, can
change any case: where it is named, all of them are analysed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from itertools import product
from typing import Any

from adk_ros.bench.mismatch.case_jobs import CaseJob
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.errors import UsageError
from adk_ros.mismatch.library import criteria as library

VARIED = "varied"
"""Folder of the reports with another value, in the output folder."""
HALF, DOUBLE = 0.5, 2.0
_KEYS = {HALF: "changed_by_half", DOUBLE: "changed_by_double"}


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
    recorded = [
        Change(criterion, factor, case)
        for case, answer in answers.items()
        for criterion, counts in _criteria(answer).items()
        for factor, key in _KEYS.items()
        if counts[key] and any(fnmatchcase(criterion, x) for x in wanted)
    ]
    named = (set(wanted) & set(criterion_names())) - _recorded(answers)
    return sorted(
        recorded + [Change(*x) for x in product(named, _KEYS, answers)]  # Any case may change.
    )


def criterion_names() -> list[str]:
    """Return the names of all criteria of `library.criteria`, sorted."""
    return sorted(name for name in vars(library) if name.isupper())


def check_pattern(pattern: str) -> None:
    """
    Refuse a pattern of which a part selects no criterion.

    :raises UsageError: it names the part, and criteria that are spelt nearly as it is.
    """
    names = criterion_names()
    for part in (x.strip() for x in pattern.split(",")):
        if not any(fnmatchcase(name, part) for name in names):
            near = get_close_matches(part.upper(), names, 3, 0.5)
            hint = f": did you mean {' or '.join(near)}?" if near else ""
            raise UsageError(f"--vary: no criterion is named {part}{hint}")


def varied_job(change: Change, job: CaseJob) -> CaseJob:
    """Return the job that analyses a changed case with the other value of the criterion."""
    criterion, factor = change.criterion, change.factor
    return job._replace(
        name=f"{job.name}_{criterion.lower()}_{factor:g}",
        key=f"{job.key}_{criterion}_{factor:g}",
        factors={criterion: factor},
    )


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
    lines = [
        f"{name}, in no recorded decision: {factor:g} times gives "
        f"{sum(scores[x.case] for x in cases):g} -> {sum(varied[x] for x in cases):g} right of "
        f"{len(cases)}"
        for name in sorted({x.criterion for x in varied} - _recorded(answers))
        for factor in _KEYS
        if (cases := [x for x in varied if (x.criterion, x.factor) == (name, factor)])
    ]
    for name in sorted(_recorded(answers)):
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


def _recorded(answers: dict[str, dict[str, Any]]) -> set[str]:
    return {name for answer in answers.values() for name in _criteria(answer)}


def _criteria(answer: dict[str, Any]) -> dict[str, dict[str, int]]:
    criteria: dict[str, dict[str, int]] = answer["selection"].get("criteria", {})
    return criteria
