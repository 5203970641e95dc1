# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the paper's tables share: boards of made-up scores, and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adk_ros.bench.paper.cases import CLEAN, PAPER_TESTS, TESTS, VARIANTS
from adk_ros.bench.paper.paper_results import FIVE, printed
from adk_ros.bench.paper.predictors import ADK_ROS, MF_TUNED, NAIVE, PYKOOP, PYKOOPMAN
from adk_ros.bench.paper.scores import CaseScore, ScoreTable
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.score import REPORT_SCALE


def case_score(
    rmse: FloatArray | float, worst: FloatArray | float = 9.0, covered: float = 0.9,
    diverged: int = 0, seconds: float = 1.0,
) -> CaseScore:  # fmt: skip
    """A score with the same RMSE in all cells, or with the given ones (5, 3)."""
    table = np.ones((5, 3))
    return CaseScore(
        rmse=table * rmse,
        worst=table * worst,
        count=np.full(5, 1000),
        diverged=np.full(5, diverged),
        covered=np.full((5, 3), round(1000 * covered)),
        claimed=np.full((5, 3), 1000),
        seconds=seconds,
    )


def board_of(
    by_name: Mapping[str, float | Sequence[float]], tests: Sequence[str] = TESTS,
    variants: Sequence[str] = VARIANTS,
) -> ScoreTable:  # fmt: skip
    """A board where each predictor has one RMSE everywhere, or one for each seed."""
    board = ScoreTable()
    for variant in variants:
        for test in tests:
            for name, rmse in by_name.items():
                for value in [rmse] if isinstance(rmse, int | float) else rmse:
                    board.add(variant, test, name, case_score(value))
    return board


def good_board(tests: Sequence[str] = TESTS) -> ScoreTable:
    """Ours at a tenth of the naive predictors, all rivals at a half."""
    rivals = dict.fromkeys((MF_TUNED, PYKOOP, PYKOOPMAN), 0.5)
    return board_of({name: 1.0 for name in NAIVE} | rivals | {ADK_ROS: (0.09, 0.1, 0.11)}, tests)


def papers_board() -> ScoreTable:
    """The paper's own figures as if they were ours, clean, one step ahead."""
    board = ScoreTable()
    for test in PAPER_TESTS:
        for name in FIVE:
            rmse, worst = (printed(test, name, what) / REPORT_SCALE for what in ("rmse", "max"))
            ones = np.ones((5, 1))
            board.add(CLEAN, test, name, case_score(ones * rmse, ones * worst))
    return board
