# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance criteria of `adk bench confirm`: one line each, PASS or FAIL.

They are fixed before the drives are: see `confirmation_drives`.
"""

from __future__ import annotations

import numpy as np

from adk_ros.bench.paper.cases import CLEAN, NOISY
from adk_ros.bench.paper.criteria import COVERAGE, FAIL, INFO, PaperCriterion
from adk_ros.bench.paper.predictors import (
    ADK_ROS,
    MF,
    MF_CHOSEN,
    MF_PLAIN,
    MF_TUNED,
    NAIVE,
    ORACLE,
    PYKOOP,
    PYKOOPMAN,
    SWLS,
)
from adk_ros.bench.paper.ratios import geometric_mean, geometric_means
from adk_ros.bench.paper.scores import (
    CHANNELS,
    HORIZONS,
    Combination,
    ScoreTable,
    combinations_text,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.interval_scores import IntervalScore

MEAN_MOST = 0.25
"""Largest geometric mean of the ratios to the best naive predictor, as in `adk bench paper`."""
RATIO_MOST = 1.02
"""Largest ratio of one combination, mean over the seeds."""
LAST_MOST = {CLEAN: 0.05, NOISY: 0.04}
"""Largest geometric mean 2 s ahead."""
FAMILIES = {
    "7dof": (0.9, (MF, MF_PLAIN, MF_TUNED, MF_CHOSEN)),
    "koopman-libraries": (0.95, (PYKOOP, PYKOOPMAN)),
    "papers-method": (0.95, (SWLS,)),
}
"""Families of baselines: required share of combinations ahead of the best member."""


def confirmation_criteria(board: ScoreTable, without: str = "") -> list[PaperCriterion]:
    """Evaluate all criteria; `without`: the reason why the baseline libraries were not run."""
    return [
        _mean(board),
        *(_last(board, variant) for variant in board.variants()),
        _none_above(board),
        *(_ahead(board, name, without) for name in FAMILIES),
        _coverage(board, "coverage-known-commands", "intervals"),
        _coverage(board, "coverage-held-commands", "held"),
        _interval_score(board, "interval-score-known-commands", "intervals"),
        _interval_score(board, "interval-score-held-commands", "held"),
    ]


def _mean(board: ScoreTable) -> PaperCriterion:
    ratios = board.ratios(ADK_ROS)
    mean = geometric_mean([float(r.mean()) for r in ratios.values()])
    seeds = np.array([list(r) for r in ratios.values()])
    by_seed = [geometric_mean(column) for column in seeds.T.tolist()]
    text = f"{mean:.3f} of the best naive predictor's RMSE over {len(ratios)} combinations, "
    text += f"at most {MEAN_MOST:g} (seeds {', '.join(f'{s:.3f}' for s in by_seed)})"
    return PaperCriterion.judged(mean <= MEAN_MOST, "geometric-mean", text)


def _last(board: ScoreTable, variant: str) -> PaperCriterion:
    last = len(HORIZONS) - 1
    mean = geometric_means(board, ADK_ROS)[variant, last]
    text = f"{mean:.3f} of the best naive predictor's, at most {LAST_MOST[variant]:g}"
    plant = geometric_means(board, ORACLE).get((variant, last))
    if plant is not None:
        text += f"; the plant itself, from the same measurements: {plant:.4f}"
    return PaperCriterion.judged(mean <= LAST_MOST[variant], f"two-seconds-{variant}", text)


def _none_above(board: ScoreTable) -> PaperCriterion:
    ratios = {combo: float(r.mean()) for combo, r in board.ratios(ADK_ROS).items()}
    above = {combo: r for combo, r in ratios.items() if r > RATIO_MOST}
    figure = f"{len(above)} of {len(ratios)} combinations above {RATIO_MOST:g}"
    if above:
        figure += f": {_listed(above)}"
    return PaperCriterion.judged(not above, "none-above-naive", figure)


def _listed(values: dict[Combination, float]) -> str:
    return combinations_text(list(values), {c: f"{v:.2f}" for c, v in values.items()})


def _ahead(board: ScoreTable, family: str, without: str) -> PaperCriterion:
    least, members = FAMILIES[family]
    tables = [table for name in members if (table := board.against(ADK_ROS, name))]
    name = f"ahead-of-{family}"
    if not tables:
        return PaperCriterion(FAIL, name, f"not measured: {without or 'it was not run'}")
    # The worst ratio is that to the best member.
    ratios = {combo: max(t[combo] for t in tables if combo in t) for combo in tables[0]}
    behind = {combo: r for combo, r in ratios.items() if not r < 1.0}
    share = 1.0 - len(behind) / len(ratios)
    figure = f"{100.0 * share:.1f} % of {len(ratios)} combinations ahead of the best of "
    figure += f"{len(tables)}, at least {100.0 * least:.0f} %"
    if behind:
        figure += f"; behind: {_listed(behind)}"
    return PaperCriterion.judged(share >= least, name, figure)


def _intervals(board: ScoreTable, kind: str, variant: str) -> list[IntervalScore]:
    return [
        score
        for (v, _, name), items in board.scores.items()
        if v == variant and name == ADK_ROS
        for item in items
        if (score := getattr(item, kind)) is not None
    ]


def _coverage(board: ScoreTable, name: str, kind: str) -> PaperCriterion:
    low, high = COVERAGE
    outside, found = {}, []
    for variant in board.variants():
        scores = _intervals(board, kind, variant)
        if not scores:
            return PaperCriterion(FAIL, name, "not measured")
        covered = np.sum([s.covered for s in scores], axis=0)
        claimed = np.maximum(np.sum([s.claimed for s in scores], axis=0), 1)
        for (i, c), share in np.ndenumerate(covered / claimed):
            found.append(float(share))
            if not low <= share <= high:
                outside[Combination(variant, "all tests", i, c)] = 100.0 * float(share)
    figure = f"90 % intervals cover {100.0 * min(found):.1f} to {100.0 * max(found):.1f} %, "
    figure += f"{len(found) - len(outside)} of {len(found)} (variant, horizon, channel) within "
    figure += f"{100.0 * low:.0f} to {100.0 * high:.0f} %"
    if outside:
        shown = {combo: f"{value:.1f} %" for combo, value in outside.items()}
        figure += f"; outside: {combinations_text(list(outside), shown)}"
    return PaperCriterion.judged(not outside, name, figure)


def _interval_score(board: ScoreTable, name: str, kind: str) -> PaperCriterion:
    """Compare interval scores with those of the best naive predictor that knows its RMSE."""
    ratios: dict[Combination, float] = {}
    widths: list[FloatArray] = []
    for variant in board.variants():
        for test in board.tests():
            items = [getattr(x, kind) for x in board.scores.get((variant, test, ADK_ROS), [])]
            naive = [
                item.intervals.score
                for who in NAIVE
                for item in board.scores.get((variant, test, who), [])
                if item.intervals is not None
            ]
            if not naive or not items or any(x is None for x in items):
                continue
            table = np.mean([x.score for x in items], axis=0) / np.fmin.reduce(naive)
            widths.append(np.mean([x.width for x in items], axis=0))
            for (i, c), ratio in np.ndenumerate(table):
                if np.isfinite(ratio):
                    ratios[Combination(variant, test, i, c)] = float(ratio)
    if not ratios:
        return PaperCriterion(FAIL, name, "not measured")
    mean = geometric_mean(list(ratios.values()))
    last = np.nanmean(widths, axis=0)[-1]
    figure = f"{mean:.3f} of that of the best naive predictor with intervals from its RMSE "
    figure += "(geometric mean), below 1; mean width 2 s ahead "
    figure += ", ".join(f"{n} {w:.3g}" for n, w in zip(CHANNELS, last, strict=True)) + " (SI)"
    return PaperCriterion.judged(mean < 1.0, name, figure)


def by_horizon(board: ScoreTable) -> PaperCriterion:
    """Return the geometric means by variant and horizon, for information."""
    means = geometric_means(board, ADK_ROS)
    text = "; ".join(
        f"{variant} "
        + ", ".join(f"{HORIZONS[i]} {means[variant, i]:.3f}" for i in range(len(HORIZONS)))
        for variant in board.variants()
    )
    return PaperCriterion(INFO, "ratio-by-horizon", text)
