# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""RMSE divided by that of the best naive predictor: means over tests and channels, and by test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.paper_tables import NONE, Table, number, strong
from adk_ros.bench.paper.predictors import ADK_ROS, NOT_COMPARED, ORACLES
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, Combination, ScoreTable


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean, a zero counting as 1e-12."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-12)))))


def geometric_means(board: ScoreTable, name: str) -> dict[tuple[str, int], float]:
    """
    Return geometric means by variant and horizon, over tests and channels; seeds averaged first.

    There is none for the oracles on clean tests, where their errors are rounding errors.
    """
    gathered: dict[tuple[str, int], list[float]] = {}
    for combo, ratio in board.ratios(name).items():
        if name in ORACLES and combo.variant == CLEAN:
            continue
        gathered.setdefault((combo.variant, combo.horizon), []).append(float(ratio.mean()))
    return {key: geometric_mean(values) for key, values in gathered.items()}


def lost_tests(board: ScoreTable, name: str) -> dict[tuple[str, int], int]:
    """Return by variant and horizon the number of tests with a diverged prediction."""
    return {
        (variant, i): sum(
            bool(board.diverged(variant, test, name)[0][i])
            for test in board.tests()
            if (variant, test, name) in board.scores
        )
        for variant in board.variants()
        for i in range(len(HORIZONS))
    }


def tests_note(board: ScoreTable, name: str) -> str:
    """Return on how many tests a predictor was run if not on all: its means are of these."""
    tests = board.tests()
    run = {test for _, test, who in board.scores if who == name}
    return f" ({len(run)} of {len(tests)} tests)" if len(run) < len(tests) else ""


def mean_text(mean: float | None, lost: int) -> str:
    """Format a geometric mean with three digits, as a lower bound if predictions diverged."""
    if mean is None:
        return NONE
    text = f"{mean:#.3g}" if 1e-4 <= mean < 0.9995 else number(mean)
    return f"> {text} ({lost})" if lost else text


def summary_table(board: ScoreTable) -> Table:
    """Return the table of geometric means over tests and channels."""
    header = ["predictor"]
    header += [f"{v} {h}" for v in board.variants() for h in HORIZONS]
    rows = []
    names = board.names()
    means = {name: geometric_means(board, name) for name in names}
    lost = {name: lost_tests(board, name) for name in names}
    keys = [(v, i) for v in board.variants() for i in range(len(HORIZONS))]
    for name in names:
        label = name + tests_note(board, name)
        rows.append([label, *(mean_text(means[name].get(k), lost[name][k]) for k in keys)])
    columns = [
        {n: means[n][key] for n in names if key in means[n] and not lost[n][key]} for key in keys
    ]
    title = (
        "RMSE divided by that of the best naive predictor: geometric mean over all tests and "
        "channels; > a (n): predictions diverged in n tests"
    )
    best = best_cells(names, columns)
    return Table("summary", title, header, rows, strong(names), best)


def best_cells(
    names: Sequence[str], columns: Sequence[Mapping[str, float]]
) -> frozenset[tuple[int, int]]:
    """
    Return (row, column) of the lowest ratio in each column; column 0 holds the names.

    Rows of `NOT_COMPARED` and ratios of 1 or more are excluded. `columns` must not contain lower
    bounds.
    """
    found = set()
    for j, column in enumerate(columns):
        real = {name: value for name, value in column.items() if name not in NOT_COMPARED}
        least = min(real, key=real.__getitem__, default=None)
        if least is not None and real[least] < 1.0:
            found.add((names.index(least), j + 1))
    return frozenset(found)


def ratio_tables(board: ScoreTable) -> list[Table]:
    """Return one table per variant: the ratio of adk_ros by test, channel and horizon."""
    result = []
    ratios = board.ratios(ADK_ROS)
    for variant in board.variants():
        header = ["test", *(f"{c} {h}" for c in CHANNELS for h in HORIZONS)]
        rows = [
            [test, *(
                number(float(ratios[Combination(variant, test, i, c)].mean()))
                for c in range(len(CHANNELS)) for i in range(len(HORIZONS))
            )]
            for test in board.tests() if (variant, test, ADK_ROS) in board.scores
        ]  # fmt: skip
        title = f"{ADK_ROS}, {variant}: RMSE divided by that of the best naive predictor, by test"
        result.append(Table(f"ratios_{variant}", title, header, rows))
    return result
