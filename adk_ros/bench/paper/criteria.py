# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance criteria of the default predictor: one line each, PASS or FAIL.

They count combinations of variant, test, horizon and channel, over all ten tests (seven of the
paper, three additional ones). A ratio is the RMSE divided by that of the best naive predictor in
the same combination.
"""

from __future__ import annotations

import re

import numpy as np

from adk_ros.bench.paper import oracle_notes
from adk_ros.bench.paper.av21 import JUDGED, RecordingScores
from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.criterion import FAIL, INFO, Criterion
from adk_ros.bench.paper.interval_criteria import COVERAGE
from adk_ros.bench.paper.paper_results import TABLES, effect
from adk_ros.bench.paper.predictors import ADK_ROS, ALDK, MF_TUNED, PYKOOP, PYKOOPMAN, SWLS
from adk_ros.bench.paper.ratios import geometric_mean
from adk_ros.bench.paper.scores import (
    CHANNELS,
    HORIZONS,
    Combination,
    ScoreTable,
    combinations_text,
)
from adk_ros.numerics.arrays import FloatArray

MEAN_MOST = 0.25
"""Largest geometric mean of all ratios: a quarter of the best model-free error."""
AHEAD_LEAST = 0.9
"""Smallest share of combinations in which adk_ros must be better than a baseline."""
_LONG = 100
"""Characters from which on a list of combinations is dropped from a short text."""


def evaluate_paper_criteria(
    board: ScoreTable, recorded: RecordingScores | None, without: str = ""
) -> list[Criterion]:
    """Evaluate all criteria; `without`: the reason why the baseline libraries were not run."""
    return [
        _mean(board),
        _none_above(board),
        *(_peer(board, name, without) for name in (PYKOOP, PYKOOPMAN)),
        _ahead(board, MF_TUNED, "ahead-of-tuned-7dof"),
        *_coverage(board),
        *_recordings(recorded),
        _effect(board),
    ]


def brief(text: str) -> str:
    """Return a criterion's text without a long list of combinations at its end."""
    head, colon, combos = text.partition(": ")
    if not colon or len(combos) <= _LONG:
        return text
    complete, _, last = head.rpartition("; ")
    # Drop a last clause such as "; outside" whose list was removed.
    return head if re.search(r"\d", last) else complete


def _mean(board: ScoreTable) -> Criterion:
    ratios = board.ratios(ADK_ROS)
    mean = geometric_mean([float(r.mean()) for r in ratios.values()])
    parts = {
        v: geometric_mean([float(r.mean()) for c, r in ratios.items() if c.variant == v])
        for v in board.variants()
    }
    text = ", ".join(f"{variant} {value:.3f}" for variant, value in parts.items())
    return Criterion.judged(
        mean <= MEAN_MOST, "geometric-mean",
        f"{mean:.3f} of the best naive predictor's RMSE over {len(ratios)} combinations, at most "
        f"{MEAN_MOST} ({text})",
    )  # fmt: skip


def lost_combinations(board: ScoreTable) -> dict[Combination, FloatArray]:
    """Return the lost combinations: even the best seed is above the best naive predictor."""
    return {combo: r for combo, r in board.ratios(ADK_ROS).items() if r.min() > 1.0}


def behind_of(board: ScoreTable, baseline: str) -> dict[Combination, float]:
    """Return the combinations in which a baseline is at least as good, with the RMSE ratio."""
    return {combo: r for combo, r in board.against(ADK_ROS, baseline).items() if not r < 1.0}


def _none_above(board: ScoreTable) -> Criterion:
    ratios = board.ratios(ADK_ROS)
    lost = lost_combinations(board)
    within = [combo for combo, r in ratios.items() if r.min() <= 1.0 < r.mean()]
    at_oracle = oracle_notes.at_oracle(board, [*lost, *within])
    figure = f"{len(lost)} of {len(ratios)} combinations exceed 1.0 in all seeds"
    if lost:
        figure += oracle_notes.oracle_note(at_oracle & set(lost))
        shown = {c: oracle_notes.marked(_spread(r), c, at_oracle) for c, r in lost.items()}
        figure += f": {combinations_text(list(lost), shown)}"
    if within:
        shown = {c: oracle_notes.marked(_spread(ratios[c]), c, at_oracle) for c in within}
        figure += "; above 1 in the mean but not for all seeds: "
        figure += combinations_text(within, shown)
    return Criterion.judged(not lost, "no-combination-above-1", figure)


def _spread(ratio: FloatArray) -> str:
    # A value just above 1 must not be rounded to 1.
    digits = 3 if abs(ratio - 1.0).min() < 0.01 else 2
    if ratio.size == 1:
        return f"{ratio[0]:.{digits}f}"
    return f"{ratio.mean():.{digits}f} ({ratio.min():.{digits}f} to {ratio.max():.{digits}f})"


def _peer(board: ScoreTable, name: str, without: str) -> Criterion:
    if not board.has(name):
        return Criterion(FAIL, f"ahead-of-{name}", f"not measured: {without or 'it was not run'}")
    return _ahead(board, name, f"ahead-of-{name}")


def _ahead(board: ScoreTable, baseline: str, name: str) -> Criterion:
    ratios = board.against(ADK_ROS, baseline)
    if not ratios:
        return Criterion(FAIL, name, "not measured: it was not run")
    behind = behind_of(board, baseline)
    share = 1.0 - len(behind) / len(ratios)
    figure = f"{100.0 * share:.1f} % of {len(ratios)} combinations, "
    figure += f"at least {100.0 * AHEAD_LEAST:.0f} %"
    if behind:
        at_oracle = oracle_notes.at_oracle(board, behind)
        shown = {c: oracle_notes.marked(f"{r:.2f}", c, at_oracle) for c, r in behind.items()}
        figure += f"; behind in {len(behind)}{oracle_notes.oracle_note(at_oracle)}: "
        figure += combinations_text(list(behind), shown)
    return Criterion.judged(share >= AHEAD_LEAST, name, figure)


def pooled_coverage(board: ScoreTable) -> dict[Combination, float]:
    """Return the coverage of the 90 % intervals over all tests and seeds, NaN if unknown."""
    return {
        Combination(variant, "all tests", i, c): float(board.coverage(variant)[i, c])
        for variant in board.variants()
        for i in range(len(HORIZONS))
        for c in range(3)
    }


def _coverage(board: ScoreTable) -> list[Criterion]:
    """Check the coverage by variant, horizon and channel, over all tests and seeds."""
    low, high = COVERAGE
    pooled = pooled_coverage(board)
    known = [value for value in pooled.values() if value == value]
    if not known:
        return [Criterion(FAIL, "coverage", "not measured: the model gave no covariance")]
    outside = {combo: value for combo, value in pooled.items() if not low <= value <= high}
    figure = (
        f"90 % intervals cover {100.0 * min(known):.1f} to {100.0 * max(known):.1f} % on the "
        f"held-out drives, {len(pooled) - len(outside)} of {len(pooled)} (variant, horizon, "
        f"channel) within {100.0 * low:.0f} to {100.0 * high:.0f} %"
    )
    if outside:
        figure += f"; outside: {_percent(outside)}"
    by_test = {
        Combination(variant, test, i, c): float(board.coverage(variant, test)[i, c])
        for variant in board.variants()
        for test in board.tests()
        for i in range(len(HORIZONS))
        for c in range(3)
    }
    lost = {combo: value for combo, value in by_test.items() if not low <= value <= high}
    detail = f"{len(by_test) - len(lost)} of {len(by_test)} combinations within"
    if lost:
        detail += f"; outside: {_percent(lost)}"
    return [
        Criterion.judged(not outside, "coverage", figure),
        Criterion(INFO, "coverage-by-combination", detail),
    ]


def _percent(values: dict[Combination, float]) -> str:
    return combinations_text(list(values), {c: f"{100.0 * v:.1f} %" for c, v in values.items()})


def _recordings(recorded: RecordingScores | None) -> list[Criterion]:
    if recorded is None:
        return [Criterion(FAIL, "av21", "not measured: give --recordings DIR")]
    same, other = recorded.pairs(same=True), recorded.pairs(same=False)
    results = []
    total, lost = _lost(same)
    figure = f"below the best naive predictor in {total - len(lost)} of {total} combinations"
    figure += f" of {len(same)} recordings (0.5, 1, 2 s)"
    if lost:
        figure += f"; not below: {', '.join(lost)}"
    results.append(Criterion.judged(not lost, "av21", figure))
    if other:
        total, lost = _lost(other)
        figure = f"{total - len(lost)} of {total} combinations, trained on one recording and"
        figure += " tested on another"
        if lost:
            figure += f"; not below: {', '.join(lost)}"
        results.append(Criterion(INFO, "av21-across", figure))
    return results


def _lost(tables: dict[str, FloatArray]) -> tuple[int, list[str]]:
    lost = [
        f"{name} {CHANNELS[c]} {HORIZONS[i]} {table[i, c]:.2f}"
        for name, table in tables.items()
        for c in range(3)
        for i in JUDGED
        if table[i, c] >= 1.0
    ]
    # A channel that a recording does not measure has no ratio.
    judged = [table[list(JUDGED)] for table in tables.values()]
    return sum(int(np.isfinite(each).sum()) for each in judged), lost


def papers_effect(board: ScoreTable) -> dict[Combination, tuple[float, float]]:
    """Return the reduction of RMSE from ALDK to SWLS here and in the paper: one step, clean."""
    found = {}
    for test in (test for pair in list(TABLES.values())[1:] for test in pair):
        if (CLEAN, test, SWLS) not in board.scores:
            continue
        reduction = 1.0 - board.rmse(CLEAN, test, SWLS)[0] / board.rmse(CLEAN, test, ALDK)[0]
        for c, (here, there) in enumerate(zip(reduction, effect(test), strict=True)):
            found[Combination(CLEAN, test, 0, c)] = float(here), float(there)
    return found


def _effect(board: ScoreTable) -> Criterion:
    """Check that adaptation reduces the RMSE by as much as in the paper's tables."""
    found = papers_effect(board)
    if not found:
        return Criterion(FAIL, "papers-effect", "not measured: ALDK-SWLS was not run")
    short = [
        f"{combo.test} {CHANNELS[combo.channel]} {100.0 * here:.2f} % "
        f"(paper {100.0 * there:.2f} %)"
        for combo, (here, there) in found.items() if not here >= there
    ]  # fmt: skip
    figure = (
        f"ALDK-SWLS's one-step RMSE below ALDK's by at least the paper's relative reduction in "
        f"{len(found) - len(short)} of {len(found)} entries of Tables 4 to 8"
    )
    if short:
        figure += f"; less: {', '.join(short)}"
    return Criterion.judged(not short, "papers-effect", figure)
