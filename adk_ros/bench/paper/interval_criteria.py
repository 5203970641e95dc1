# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance criteria of 90 % intervals: coverage, interval score and width.

Coverage is that of the measurement: the predictor's covariances describe measured minus predicted
state. Score and width are compared with those of the naive predictor that is best in the same
test, horizon and channel, with intervals from its RMSE on this test, see `with_own_error`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from adk_ros.bench.paper.criterion import FAIL, Criterion
from adk_ros.bench.paper.ratios import geometric_mean
from adk_ros.bench.paper.scores import CHANNELS, Combination, combinations_text
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.interval_scores import IntervalScore

COVERAGE = 0.85, 0.95
"""Admissible coverage of the 90 % intervals."""
_CLAIMED, _ROUNDING = 0.9, 1e-9
_BY_CHANCE = 0.05
"""Share of the runs with exact intervals, by choice, in which a test may lie outside by chance."""
_NOT_MEASURED = "not measured"


class ComparedIntervals(NamedTuple):
    """
    Intervals on one test and those of the best naive predictor, by horizon and channel (5, 3), SI.

    `width` and `score` are means over the seeds; `naive_width` and `naive_score` the smallest ones
    of the naive predictors.
    """

    width: FloatArray
    score: FloatArray
    naive_width: FloatArray
    naive_score: FloatArray


def compared_intervals(
    ours: Sequence[IntervalScore], naive: Sequence[IntervalScore]
) -> ComparedIntervals:
    """Compare the intervals of all seeds with those of the naive predictors, one or more each."""
    return ComparedIntervals(
        width=np.asarray(np.mean([item.width for item in ours], axis=0)),
        score=np.asarray(np.mean([item.score for item in ours], axis=0)),
        naive_width=np.asarray(np.fmin.reduce([item.width for item in naive])),
        naive_score=np.asarray(np.fmin.reduce([item.score for item in naive])),
    )


def pooled_intervals_coverage(scores: Sequence[IntervalScore]) -> FloatArray:
    """Return the share (5, 3) of the measurements of all tests that lie within."""
    covered = np.sum([s.covered for s in scores], axis=0)
    claimed = np.sum([s.claimed for s in scores], axis=0)
    return np.asarray(covered / np.maximum(claimed, 1))


def coverage_criterion(name: str, coverage: Mapping[Combination, float], of: str) -> Criterion:
    """Judge each coverage, a share; `of`: what the combinations are of, for the text."""
    if not coverage:
        return Criterion(FAIL, name, _NOT_MEASURED)
    low, high = COVERAGE
    outside = {combo: share for combo, share in coverage.items() if not low <= share <= high}
    least, most = (100.0 * f(coverage.values()) for f in (min, max))
    figure = f"90 % intervals cover {least:.1f} to {most:.1f} %, "
    figure += f"{len(coverage) - len(outside)} of {len(coverage)} ({of}) within "
    figure += f"{100.0 * low:.0f} to {100.0 * high:.0f} %"
    if outside:
        shown = {combo: f"{100.0 * share:.1f} %" for combo, share in outside.items()}
        figure += f"; outside: {combinations_text(list(outside), shown)}"
    return Criterion.judged(not outside, name, figure)


def coverage_by_test_criterion(
    name: str, tests: Mapping[Combination, tuple[float, float]]
) -> Criterion:
    """
    Judge the coverage of each test; `tests`: coverage and number of independent predictions.

    A coverage may differ from 90 % by as much as the pooled one, or by what chance explains if
    that is more: z sqrt(0.9 * 0.1 / n) for n independent predictions, where a normal variable
    exceeds z in size with probability 0.05 / N for N comparisons (Bonferroni), so that exact
    intervals fail in 5 % of the runs at most.
    """
    if not tests:
        return Criterion(FAIL, name, _NOT_MEASURED)
    z = NormalDist().inv_cdf(1.0 - 0.5 * _BY_CHANCE / len(tests))
    chance = z * math.sqrt(_CLAIMED * (1.0 - _CLAIMED))
    margin, shown = {}, {}
    for combo, (share, count) in tests.items():
        allowed = max(COVERAGE[1] - _CLAIMED, chance / math.sqrt(count))
        margin[combo] = allowed - abs(share - _CLAIMED)
        least, most = max(_CLAIMED - allowed, 0.0), min(_CLAIMED + allowed, 1.0)
        shown[combo] = f"{100.0 * share:.1f} %, allowed {100.0 * least:.1f} to {100.0 * most:.1f}"
    outside = [combo for combo in tests if not margin[combo] >= -_ROUNDING]
    shares = [share for share, _ in tests.values()]
    worst = min(margin, key=margin.__getitem__)
    figure = f"90 % intervals cover {100.0 * min(shares):.1f} to {100.0 * max(shares):.1f} %, "
    figure += f"{len(tests) - len(outside)} of {len(tests)} (variant, test, horizon, channel) "
    figure += f"within 5 points or chance, the worst {combinations_text([worst], shown)}"
    if outside:
        figure += f"; outside: {combinations_text(outside, shown)}"
    return Criterion.judged(not outside, name, figure)


def interval_score_criterion(name: str, tests: Sequence[ComparedIntervals]) -> Criterion:
    """Judge the geometric mean of the interval scores over those of the best naive predictor."""
    mean = _mean_ratio([test.score / test.naive_score for test in tests])
    if mean is None:
        return Criterion(FAIL, name, _NOT_MEASURED)
    last = np.nanmean([test.width for test in tests], axis=0)[-1]
    figure = f"{mean:.3f} of that of the best naive predictor with intervals from its RMSE "
    figure += f"(geometric mean), below 1; mean width 2 s ahead {_by_channel(last)} (SI)"
    return Criterion.judged(mean < 1.0, name, figure)


def interval_width_criterion(name: str, tests: Sequence[ComparedIntervals]) -> Criterion:
    """Judge the geometric mean of the widths over those of the best naive predictor."""
    ratios = [test.width / test.naive_width for test in tests]
    mean = _mean_ratio(ratios)
    if mean is None:
        return Criterion(FAIL, name, _NOT_MEASURED)
    figure = f"{mean:.3f} of that of the best naive predictor with intervals from its RMSE "
    figure += "(geometric mean), below 1; 2 s ahead "
    figure += _by_channel(np.exp(np.nanmean(np.log(ratios), axis=0))[-1])
    return Criterion.judged(mean < 1.0, name, figure)


def _mean_ratio(tables: Sequence[FloatArray]) -> float | None:
    """Return the geometric mean of all finite ratios (5, 3), None without one."""
    finite = [float(x) for table in tables for x in table.ravel() if np.isfinite(x)]
    return geometric_mean(finite) if finite else None


def _by_channel(values: FloatArray) -> str:
    return ", ".join(f"{n} {value:.3g}" for n, value in zip(CHANNELS, values, strict=True))
