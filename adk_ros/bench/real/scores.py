# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of `adk bench real`, and its acceptance criteria."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from adk_ros.bench.real.real_bench import OTHER_COURSE, Outcome, RealBench

MIN_NAMED = 0.9
"""Share of the injected faults that must be named."""
MAX_MEDIAN_ERROR = 0.1
"""Median of the relative errors of the sizes of named faults."""


@dataclass(frozen=True)
class Score:
    """
    Scores of a group of injected faults.

    `named`: share that is the change or among its candidates; `alone`: share with no other
    candidate. `median_error` of the sizes of the named ones, `inside`: share of these whose 90 %
    interval has the injected size; None without any. `false_claims`: changes of something else.
    `open`: share not named, of which the check says "not decidable".
    """

    group: str
    cases: int
    named: float
    alone: float
    median_error: float | None
    inside: float | None
    false_claims: int
    open: float


@dataclass(frozen=True)
class Criterion:
    """An acceptance criterion: its figure, its limit in words, and whether it is met."""

    name: str
    figure: float
    limit: str
    is_met: bool


def score(group: str, outcomes: Sequence[Outcome]) -> Score:
    """Return the scores of outcomes with injected faults."""
    named = [x for x in outcomes if x.is_named]
    errors = [x.error for x in named if x.error is not None]
    missed = [x for x in outcomes if not x.is_named]
    count = max(len(outcomes), 1)
    return Score(
        group,
        len(outcomes),
        len(named) / count,
        sum(x.is_alone for x in named) / count,
        float(np.median(errors)) if errors else None,
        sum(x.is_inside for x in named) / len(named) if named else None,
        sum(len(x.false_claims) for x in outcomes),
        sum(x.said == "not decidable" for x in missed) / count,
    )


def scores_by(result: RealBench, key: Callable[[Outcome], str]) -> list[Score]:
    """Return the scores of injected faults by a key, such as the fault or the vehicle."""
    injected = [x for x in result.outcomes if x.fault]
    groups = dict.fromkeys(key(x) for x in injected)
    return [score(group, [x for x in injected if key(x) == group]) for group in groups]


def untouched(result: RealBench) -> list[Outcome]:
    """Return the comparisons without an injected fault."""
    return [x for x in result.outcomes if not x.fault]


def criteria(result: RealBench) -> list[Criterion]:
    """
    Return the acceptance criteria; none is met without a case.

    Faults against a recording of another course do not count, claims on untouched ones do.
    """
    total = score("all", [x for x in result.outcomes if x.fault and x.kind != OTHER_COURSE])
    clean = untouched(result)
    claims = sum(len(x.false_claims) for x in clean)
    error = total.median_error
    return [
        Criterion("faults named", total.named, f"at least {MIN_NAMED:g}",
                  bool(total.cases) and total.named >= MIN_NAMED),
        Criterion("median error of size", float("nan") if error is None else error,
                  f"at most {MAX_MEDIAN_ERROR:g}",
                  error is not None and error <= MAX_MEDIAN_ERROR),
        Criterion("claims on untouched recordings", float(claims), "0",
                  bool(clean) and claims == 0),
    ]  # fmt: skip


def as_dict(result: RealBench) -> dict[str, object]:
    """Return what `adk bench real --json` prints."""
    return {
        "kind": "bench real",
        "by_fault": [asdict(x) for x in scores_by(result, lambda x: x.fault)],
        "by_vehicle": [asdict(x) for x in scores_by(result, lambda x: x.vehicle)],
        "by_kind": [asdict(x) for x in scores_by(result, lambda x: x.kind)],
        "untouched": [x.as_dict() for x in untouched(result)],
        "criteria": [asdict(x) for x in criteria(result)],
        "left_out": result.left_out,
        "refused": result.refused,
    }
