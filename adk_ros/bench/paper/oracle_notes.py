# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Combinations in which the oracle is no better than adk_ros.

The oracle (the plant restarted from the same sample) uses the sample as it is, with its noise and
its age. A predictor that filters the noise can be better, above all one step ahead: the oracle
bounds the model error, not the state estimation error.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from adk_ros.bench.paper.cases import CLEAN
from adk_ros.bench.paper.predictors import ADK_ROS, ORACLE
from adk_ros.bench.paper.scores import Combination, ScoreTable

WITHIN = 0.03
"""Relative difference within which adk_ros counts as equal to the oracle: about the spread between
seeds."""


def over_oracle(board: ScoreTable, combo: Combination) -> float:
    """
    Return the RMSE of adk_ros over that of the oracle, mean of seeds; NaN without an oracle.

    On clean tests the oracle is exact, and a ratio has no meaning.
    """
    key = combo.variant, combo.test
    if combo.variant == CLEAN or (*key, ORACLE) not in board.scores:
        return float("nan")
    adk_ros, oracle = (
        board.rmse(*key, name)[combo.horizon, combo.channel] for name in (ADK_ROS, ORACLE)
    )
    return float(adk_ros / max(oracle, np.finfo(float).tiny))


def at_oracle(board: ScoreTable, combos: Iterable[Combination]) -> set[Combination]:
    """Return the combinations in which the oracle is better by at most `WITHIN`."""
    return {combo for combo in combos if over_oracle(board, combo) <= 1.0 / (1.0 - WITHIN)}


def oracle_note(combos: set[Combination]) -> str:
    """Return the remark after a number of combinations, "" if none is at the oracle."""
    if not combos:
        return ""
    return (
        f" ({len(combos)} of them at the oracle, where the plant itself, started from the "
        f"same sample, is no better)"
    )


def marked(text: str, combo: Combination, combos: set[Combination]) -> str:
    """Append a remark to the figure of a combination that is at the oracle."""
    return f"{text} at the oracle" if combo in combos else text
