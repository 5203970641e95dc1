# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the plant itself, started from the same sample, does no better than we do.

It takes the sample at its word, its noise and its being stale included. Who smooths noise can be
below it, most of all one step ahead: it is a floor for the model, not for the filter.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.predictors import ADK_ROS, ORACLE
from adk_ros.bench.paper.scores import Cell, ScoreTable

WITHIN = 0.03
"""Ours is at the floor if the floor's RMSE is not lower than ours by more than this share."""


def over_oracle(board: ScoreTable, cell: Cell) -> float:
    """
    Our RMSE over the floor's, mean of seeds; NaN where there is no such thing.

    Started from the truth the plant is exact, and so no floor to be compared with.
    """
    key = cell.variant, cell.test
    if cell.variant == CLEAN or (*key, ORACLE) not in board.scores:
        return float("nan")
    ours, floor = (
        board.rmse(*key, name)[cell.horizon, cell.channel] for name in (ADK_ROS, ORACLE)
    )
    return float(ours / max(floor, np.finfo(float).tiny))


def at_oracle(board: ScoreTable, cells: Iterable[Cell]) -> set[Cell]:
    """Those cells in which the floor is not better than ours by more than `WITHIN`."""
    return {cell for cell in cells if over_oracle(board, cell) <= 1.0 / (1.0 - WITHIN)}


def oracle_note(cells: set[Cell]) -> str:
    """What to add to a count of cells; nothing where none is at the floor."""
    if not cells:
        return ""
    return (
        f" ({len(cells)} of them at the floor, where the plant itself, started from the "
        f"same sample, does no better)"
    )


def marked(text: str, cell: Cell, cells: set[Cell]) -> str:
    """A cell's figure, with a word where it is at the floor."""
    return f"{text} at the floor" if cell in cells else text
