# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers for tests of the paper benchmark: tables of synthetic scores, and records."""

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
    """Return a score with the same RMSE for all horizons and channels, or the given (5, 3)."""
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
    """Return scores where each predictor has one RMSE everywhere, or one for each seed."""
    board = ScoreTable()
    for variant in variants:
        for test in tests:
            for name, rmse in by_name.items():
                for value in [rmse] if isinstance(rmse, int | float) else rmse:
                    board.add(variant, test, name, case_score(value))
    return board


def good_board(tests: Sequence[str] = TESTS) -> ScoreTable:
    """Return scores: adk_ros at a tenth of the naive predictors, all baselines at a half."""
    baselines = dict.fromkeys((MF_TUNED, PYKOOP, PYKOOPMAN), 0.5)
    scores = dict.fromkeys(NAIVE, 1.0) | baselines | {ADK_ROS: (0.09, 0.1, 0.11)}
    return board_of(scores, tests)


def papers_board() -> ScoreTable:
    """Return scores with the figures of the paper, clean, one step ahead."""
    board = ScoreTable()
    for test in PAPER_TESTS:
        for name in FIVE:
            rmse, worst = (printed(test, name, what) / REPORT_SCALE for what in ("rmse", "max"))
            ones = np.ones((5, 1))
            board.add(CLEAN, test, name, case_score(ones * rmse, ones * worst))
    return board
