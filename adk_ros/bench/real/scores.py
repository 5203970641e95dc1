# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acceptance criteria of `adk bench real`, and its results for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from adk_ros.bench.real.outcome import score, scores_by
from adk_ros.bench.real.real_bench import OTHER_COURSE, FaultOutcome, RealBench
from adk_ros.bench.real.real_predictions import (
    HORIZONS_S,
    MAX_GEOMETRIC_MEAN,
    MAX_RATIO,
    largest_ratio,
    mean_ratio,
)
from adk_ros.bench.real.withheld_attitude import MAX_LEFT

MIN_NAMED = 0.9
"""Share of the injected faults that must be named."""
MAX_MEDIAN_ERROR = 0.1
"""Median of the relative errors of the sizes of named faults, and of named terms."""
MIN_CORRELATION = 0.95
"""Correlation of the grade without an attitude with the attitude, on each recording."""


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


def faults(result: RealBench) -> list[FaultOutcome]:
    """Return the comparisons with an injected fault."""
    return [x for x in result.outcomes if x.fault]


def untouched(result: RealBench) -> list[FaultOutcome]:
    """Return the comparisons without an injected fault."""
    return [x for x in result.outcomes if not x.fault]


def criteria(result: RealBench) -> list[Criterion]:
    """
    Return the acceptance criteria; none is met without a case.

    Faults against a recording of another course do not count, claims on untouched ones do.
    """
    return [
        *_of_faults(result),
        *_of_terms(result),
        *_of_conditions(result),
        *_of_slopes(result),
        *_of_predictions(result),
        *_of_answers(result),
    ]


def _of_answers(result: RealBench) -> list[Criterion]:
    refused = [x for x in result.answers if x.is_refused and not x.may_be_refused]
    return [
        Criterion("refusals of recordings that are long enough", float(len(refused)), "0",
                  bool(result.answers) and not refused, len(result.answers)),
    ]  # fmt: skip


def _of_faults(result: RealBench) -> list[Criterion]:
    total = score("all", [x for x in faults(result) if x.kind != OTHER_COURSE])
    clean = untouched(result)
    claims = sum(len(x.false_claims) for x in clean)
    error = total.median_error
    return [
        Criterion("faults named", total.named, f"at least {MIN_NAMED:g}",
                  bool(total.cases) and total.named >= MIN_NAMED, total.cases),
        Criterion("median error of size", _or_nan(error), f"at most {MAX_MEDIAN_ERROR:g}",
                  error is not None and error <= MAX_MEDIAN_ERROR, total.cases),
        Criterion("claims on untouched recordings", float(claims), "0",
                  bool(clean) and claims == 0, len(clean)),
    ]  # fmt: skip


def _of_terms(result: RealBench) -> list[Criterion]:
    removed = [x for x in result.terms if x.term]
    complete = [x for x in result.terms if not x.term]
    terms = score("all", removed)
    error = terms.median_error
    wrong = sum(len(x.false_claims) for x in result.terms)
    return [
        Criterion("removed terms named", terms.named, f"at least {MIN_NAMED:g}",
                  bool(removed) and terms.named >= MIN_NAMED, len(removed)),
        Criterion("median error of removed terms", _or_nan(error),
                  f"at most {MAX_MEDIAN_ERROR:g}",
                  error is not None and error <= MAX_MEDIAN_ERROR, len(removed)),
        Criterion("other physics named, with and without a removed term", float(wrong), "0",
                  bool(complete) and wrong == 0, len(result.terms)),
    ]  # fmt: skip


def _of_conditions(result: RealBench) -> list[Criterion]:
    changed = [x for x in result.conditions if x.effects]
    named = score("all", changed).named
    wrong = sum(len(x.false_claims) for x in result.conditions)
    return [
        Criterion("changed conditions named", named, f"at least {MIN_NAMED:g}",
                  bool(changed) and named >= MIN_NAMED, len(changed)),
        Criterion("other physics named between two recordings", float(wrong), "0",
                  bool(result.conditions) and wrong == 0, len(result.conditions)),
    ]  # fmt: skip


def _of_slopes(result: RealBench) -> list[Criterion]:
    grades = [x for x in result.slopes if x.slope == "grade" and x.is_counted]
    least = min((x.correlation for x in grades), default=float("nan"))
    dominated = [x.v_x_error for x in grades if x.is_dominated]
    left = max((found / none for none, found, _ in dominated), default=float("nan"))
    return [
        Criterion("correlation of the grade without attitude", least,
                  f"at least {MIN_CORRELATION:g}", bool(grades) and least >= MIN_CORRELATION,
                  len(grades)),
        Criterion("share of the v_x error 1 s ahead that the grade without attitude leaves", left,
                  f"at most {MAX_LEFT:g}", bool(dominated) and left <= MAX_LEFT,
                  len(dominated)),
    ]  # fmt: skip


def _of_predictions(result: RealBench) -> list[Criterion]:
    found = result.predictions
    largest, where = largest_ratio(found)
    at = f" ({where})" if where else ""
    count = len(found) * len(HORIZONS_S)
    mean = mean_ratio(found)
    return [
        Criterion(f"largest ratio to the best naive predictor{at}", largest,
                  f"at most {MAX_RATIO:g}", largest <= MAX_RATIO, count),
        Criterion("geometric mean of the ratios 1 s ahead on the rest of the recordings", mean,
                  f"at most {MAX_GEOMETRIC_MEAN:g}", mean <= MAX_GEOMETRIC_MEAN, count),
    ]  # fmt: skip


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def as_dict(result: RealBench) -> dict[str, object]:
    """Return what `adk bench real --json` prints."""
    return {
        "kind": "bench real",
        "by_fault": [asdict(x) for x in scores_by(faults(result), lambda x: x.fault)],
        "by_vehicle": [asdict(x) for x in scores_by(faults(result), lambda x: x.vehicle)],
        "by_kind": [asdict(x) for x in scores_by(faults(result), lambda x: x.kind)],
        "removed_terms": [x.as_dict() for x in result.terms],
        "by_term": [asdict(x) for x in scores_by(result.terms, lambda x: x.term)],
        "conditions": [x.as_dict() for x in result.conditions],
        "slopes": [x.as_dict() for x in result.slopes],
        "predictions": [x.as_dict() for x in result.predictions],
        "answers": [x.as_dict() for x in result.answers],
        "untouched": [x.as_dict() for x in untouched(result)],
        "criteria": [asdict(x) | {"verdict": x.verdict} for x in criteria(result)],
        "left_out": result.left_out,
        "refused": result.refused,
    }
