# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of `adk bench real`, and its acceptance criteria."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from adk_ros.bench.real.real_bench import OTHER_COURSE, Outcome, RealBench
from adk_ros.bench.real.removed_terms import TermOutcome
from adk_ros.mismatch.inference.result import UNKNOWN

MIN_NAMED = 0.9
"""Share of the injected faults that must be named."""
MAX_MEDIAN_ERROR = 0.1
"""Median of the relative errors of the sizes of named faults, and of named terms."""
MIN_CORRELATION = 0.95
"""Correlation of the grade without an attitude with the attitude, on each recording."""


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
    """
    An acceptance criterion: its figure, its limit in words, and whether it is met.

    `cases` that it rests on: without any it is neither met nor missed.
    """

    name: str
    figure: float
    limit: str
    is_met: bool
    cases: int

    @property
    def verdict(self) -> str:
        """PASS, FAIL, or NONE without a case."""
        return ("PASS" if self.is_met else "FAIL") if self.cases else "NONE"


@dataclass(frozen=True)
class TermScore:
    """
    Scores of a group of removed terms, or of nothing removed.

    `named`, `alone`, `median_error`, `inside`, `false_claims` as in `Score`; `unexplained`: share
    of the results that say that something unknown is missing.
    """

    group: str
    cases: int
    named: float
    alone: float
    median_error: float | None
    inside: float | None
    false_claims: int
    unexplained: float


def term_score(group: str, outcomes: Sequence[TermOutcome]) -> TermScore:
    """Return the scores of results after the removal of a term."""
    named = [x for x in outcomes if x.is_named]
    errors = [x.error for x in named if x.error is not None]
    count = max(len(outcomes), 1)
    return TermScore(
        group,
        len(outcomes),
        len(named) / count,
        sum(x.is_alone for x in named) / count,
        float(np.median(errors)) if errors else None,
        sum(x.is_inside for x in named) / len(named) if named else None,
        sum(len(x.false_claims) for x in outcomes),
        sum(x.verdict == UNKNOWN for x in outcomes) / count,
    )


def term_scores_by(result: RealBench, key: Callable[[TermOutcome], str]) -> list[TermScore]:
    """Return the scores of removed terms by a key, such as the term or the vehicle."""
    groups = dict.fromkeys(key(x) for x in result.terms)
    return [term_score(group, [x for x in result.terms if key(x) == group]) for group in groups]


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
    removed = [x for x in result.terms if x.term]
    complete = [x for x in result.terms if not x.term]
    terms = term_score("all", removed)
    wrong = sum(len(x.false_claims) for x in result.terms)
    grades = [x for x in result.slopes if x.slope == "grade" and x.is_counted]
    least = min((x.correlation for x in grades), default=float("nan"))
    return [
        Criterion("faults named", total.named, f"at least {MIN_NAMED:g}",
                  bool(total.cases) and total.named >= MIN_NAMED, total.cases),
        Criterion("median error of size", _or_nan(error),
                  f"at most {MAX_MEDIAN_ERROR:g}",
                  error is not None and error <= MAX_MEDIAN_ERROR, total.cases),
        Criterion("claims on untouched recordings", float(claims), "0",
                  bool(clean) and claims == 0, len(clean)),
        Criterion("removed terms named", terms.named, f"at least {MIN_NAMED:g}",
                  bool(removed) and terms.named >= MIN_NAMED, len(removed)),
        Criterion("median error of removed terms", _or_nan(terms.median_error),
                  f"at most {MAX_MEDIAN_ERROR:g}",
                  terms.median_error is not None and terms.median_error <= MAX_MEDIAN_ERROR,
                  len(removed)),
        Criterion("other physics named, with and without a removed term", float(wrong), "0",
                  bool(complete) and wrong == 0, len(result.terms)),
        Criterion("correlation of the grade without attitude", least,
                  f"at least {MIN_CORRELATION:g}", bool(grades) and least >= MIN_CORRELATION,
                  len(grades)),
    ]  # fmt: skip


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def as_dict(result: RealBench) -> dict[str, object]:
    """Return what `adk bench real --json` prints."""
    return {
        "kind": "bench real",
        "by_fault": [asdict(x) for x in scores_by(result, lambda x: x.fault)],
        "by_vehicle": [asdict(x) for x in scores_by(result, lambda x: x.vehicle)],
        "by_kind": [asdict(x) for x in scores_by(result, lambda x: x.kind)],
        "removed_terms": [x.as_dict() for x in result.terms],
        "by_term": [asdict(x) for x in term_scores_by(result, lambda x: x.term)],
        "slopes": [x.as_dict() for x in result.slopes],
        "untouched": [x.as_dict() for x in untouched(result)],
        "criteria": [asdict(x) | {"verdict": x.verdict} for x in criteria(result)],
        "left_out": result.left_out,
        "refused": result.refused,
    }
