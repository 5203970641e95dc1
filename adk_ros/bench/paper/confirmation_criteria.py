# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance criteria of `adk bench confirm`: one line each, PASS or FAIL.

They are fixed before the drives are: see `confirmation_drives`.
"""

from __future__ import annotations

import numpy as np

from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.criterion import FAIL, INFO, Criterion
from adk_ros.bench.paper.interval_criteria import (
    ComparedIntervals,
    compared_intervals,
    coverage_by_test_criterion,
    coverage_criterion,
    interval_score_criterion,
    interval_width_criterion,
    pooled_intervals_coverage,
)
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    ALDK,
    FFRLS,
    MF,
    MF_CHOSEN,
    MF_PLAIN,
    MF_TUNED,
    NAIVE,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
    RLS,
    SWLS,
)
from adk_ros.bench.paper.ratios import geometric_mean, geometric_means, tests_note
from adk_ros.bench.paper.scores import (
    HORIZONS,
    Combination,
    ScoreTable,
    combinations_text,
)
from adk_ros.signals.interval_scores import IntervalScore
from adk_ros.signals.score import HORIZON_STEPS

MEAN_MOST = 0.25
"""Largest geometric mean of the ratios to the best naive predictor, as in `adk bench paper`."""
RATIO_MOST = 1.02
"""Largest ratio of one combination, mean over the seeds."""
LAST_MOST = {CLEAN: 0.05, NOISY: 0.04}
"""Largest geometric mean 2 s ahead."""
FAMILIES = {
    "7dof": (0.9, (MF, MF_PLAIN, MF_TUNED, MF_CHOSEN)),
    "koopman-libraries": (0.95, (PYKOOP, PYKOOPMAN)),
    "papers-method": (0.95, (ALDK, RLS, FFRLS, SWLS)),
}
"""
Families of baselines: required share of combinations ahead of the best member.

DK is no member: `adk bench confirm` does not train it, since the paper's method is ALDK, which
adds the acceleration loss, with its online methods.
"""


def confirmation_criteria(board: ScoreTable, stride: int, without: str = "") -> list[Criterion]:
    """
    Evaluate all criteria.

    :param stride: ticks from one predicted start to the next.
    :param without: the reason why the baseline libraries were not run.
    """
    return [
        _mean(board),
        *(_last(board, variant) for variant in board.variants()),
        _none_above(board),
        *(_ahead(board, name, without) for name in FAMILIES),
        _coverage(board, "coverage-known-commands", "intervals"),
        _coverage(board, "coverage-held-commands", "held"),
        _coverage_by_test(board, "coverage-by-test-known-commands", "intervals", stride),
        _coverage_by_test(board, "coverage-by-test-held-commands", "held", stride),
        *(
            judge(f"{name}-{commands}-commands", _compared(board, kind))
            for name, judge in (
                ("interval-width", interval_width_criterion),
                ("interval-score", interval_score_criterion),
            )
            for commands, kind in (("known", "intervals"), ("held", "held"))
        ),
    ]


def _mean(board: ScoreTable) -> Criterion:
    ratios = board.ratios(ADK_ROS)
    mean = geometric_mean([float(r.mean()) for r in ratios.values()])
    seeds = np.array([list(r) for r in ratios.values()])
    by_seed = [geometric_mean(column) for column in seeds.T.tolist()]
    text = f"{mean:.3f} of the best naive predictor's RMSE over {len(ratios)} combinations, "
    text += f"at most {MEAN_MOST:g} (seeds {', '.join(f'{s:.3f}' for s in by_seed)})"
    return Criterion.judged(mean <= MEAN_MOST, "geometric-mean", text)


def _last(board: ScoreTable, variant: str) -> Criterion:
    last = len(HORIZONS) - 1
    mean = geometric_means(board, ADK_ROS)[variant, last]
    text = f"{mean:.3f} of the best naive predictor's, at most {LAST_MOST[variant]:g}"
    plant = geometric_means(board, ORACLE).get((variant, last))
    if plant is not None:
        text += f"; the plant itself, from the same measurements: {plant:.4f}"
        text += tests_note(board, ORACLE)
    return Criterion.judged(mean <= LAST_MOST[variant], f"two-seconds-{variant}", text)


def _none_above(board: ScoreTable) -> Criterion:
    ratios = {combo: float(r.mean()) for combo, r in board.ratios(ADK_ROS).items()}
    above = {combo: r for combo, r in ratios.items() if r > RATIO_MOST}
    figure = f"{len(above)} of {len(ratios)} combinations above {RATIO_MOST:g}"
    if above:
        figure += f": {_listed(above)}"
    return Criterion.judged(not above, "none-above-naive", figure)


def _listed(values: dict[Combination, float]) -> str:
    return combinations_text(list(values), {c: f"{v:.2f}" for c, v in values.items()})


def _ahead(board: ScoreTable, family: str, without: str) -> Criterion:
    least, members = FAMILIES[family]
    tables = [table for name in members if (table := board.against(ADK_ROS, name))]
    name = f"ahead-of-{family}"
    if not tables:
        return Criterion(FAIL, name, f"not measured: {without or 'it was not run'}")
    # The worst ratio is that to the best member.
    ratios: dict[Combination, float] = {}
    for table in tables:
        for combo, ratio in table.items():
            ratios[combo] = max(ratio, ratios.get(combo, ratio))
    behind = {combo: r for combo, r in ratios.items() if not r < 1.0}
    share = 1.0 - len(behind) / len(ratios)
    figure = f"{100.0 * share:.1f} % of {len(ratios)} combinations ahead of the best of "
    figure += f"{len(tables)}, at least {100.0 * least:.0f} %"
    if behind:
        figure += f"; behind: {_listed(behind)}"
    return Criterion.judged(share >= least, name, figure)


def _coverage(board: ScoreTable, name: str, kind: str) -> Criterion:
    found: dict[Combination, float] = {}
    for variant in board.variants():
        scores = [
            x for test in board.tests() for x in _intervals(board, variant, test, ADK_ROS, kind)
        ]
        if not scores:
            return coverage_criterion(name, {}, "")
        for (i, c), share in np.ndenumerate(pooled_intervals_coverage(scores)):
            found[Combination(variant, "all tests", i, c)] = float(share)
    return coverage_criterion(name, found, "variant, horizon, channel")


def _coverage_by_test(board: ScoreTable, name: str, kind: str, stride: int) -> Criterion:
    found: dict[Combination, tuple[float, float]] = {}
    # Predictions that overlap have part of their errors in common.
    overlapping = np.maximum(np.array(HORIZON_STEPS) / stride, 1.0)
    for variant in board.variants():
        for test in board.tests():
            scores = _intervals(board, variant, test, ADK_ROS, kind)
            if not scores:
                continue
            # All trainings predict the same drive with the same noise, which adds none.
            claimed = np.mean([score.claimed for score in scores], axis=0)
            count = claimed / overlapping[:, None]
            for (i, c), share in np.ndenumerate(pooled_intervals_coverage(scores)):
                if count[i, c] > 0.0:
                    found[Combination(variant, test, i, c)] = float(share), float(count[i, c])
    return coverage_by_test_criterion(name, found)


def _intervals(
    board: ScoreTable, variant: str, test: str, who: str, kind: str
) -> list[IntervalScore]:
    """Return the interval scores of a predictor, of all seeds that have them."""
    items = board.scores.get((variant, test, who), [])
    return [score for item in items if (score := getattr(item, kind)) is not None]


def _compared(board: ScoreTable, kind: str) -> list[ComparedIntervals]:
    """Return the intervals of adk_ros and of the naive predictors, by variant and test."""
    tests = []
    for variant in board.variants():
        for test in board.tests():
            items = [getattr(x, kind) for x in board.scores.get((variant, test, ADK_ROS), [])]
            naive = [
                x for who in NAIVE for x in _intervals(board, variant, test, who, "intervals")
            ]
            if naive and items and all(x is not None for x in items):
                tests.append(compared_intervals(items, naive))
    return tests


def by_horizon(board: ScoreTable) -> Criterion:
    """Return the geometric means by variant and horizon, for information."""
    means = geometric_means(board, ADK_ROS)
    text = "; ".join(
        f"{variant} "
        + ", ".join(f"{HORIZONS[i]} {means[variant, i]:.3f}" for i in range(len(HORIZONS)))
        for variant in board.variants()
    )
    return Criterion(INFO, "ratio-by-horizon", text)
