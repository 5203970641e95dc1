# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What can be said of a set of cells in sentences: where they are, how large the errors are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping

import numpy as np

from adk_ros.bench.paper import oracle_notes
from adk_ros.bench.paper.cases import CLEAN, NOISE, OWN_TESTS, PAPER_TESTS
from adk_ros.bench.paper.paper_tables import number
from adk_ros.bench.paper.predictors import ADK_ROS, NAIVE, ORACLE
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, Cell, ScoreTable
from adk_ros.signals.score import REPORT_SCALE

KNOWN_ROADS = PAPER_TESTS[:5]
"""The training drive's own road: the same car, or one whose mass or inertia was changed."""
OTHER_ROADS = (*PAPER_TESTS[5:], *OWN_TESTS)
SHOWN = 3
"""Cells and tests that are named one by one."""


def cell_location(board: ScoreTable, cells: Collection[Cell], begin: str) -> list[str]:
    """How many cells of which variant, horizon, channel, and in which tests the most."""
    every = list(board.ratios(ADK_ROS))

    def counted(key: Callable[[Cell], object], names: Mapping[object, str]) -> list[str]:
        hit, total = Counter(map(key, cells)), Counter(map(key, every))
        return [f"{name} {hit[k]} of {total[k]}" for k, name in names.items() if hit[k]]

    variants = counted(lambda c: c.variant, {v: v for v in board.variants()})
    horizons = counted(lambda c: c.horizon, dict(enumerate(HORIZONS)))
    channels = counted(lambda c: c.channel, dict(enumerate(CHANNELS)))
    hit = Counter(cell.test for cell in cells)
    total = Counter(cell.test for cell in every)
    most = ", ".join(f"{test} ({n} of {total[test]})" for test, n in hit.most_common(SHOWN))
    return [
        f"{begin} {len(cells)} cells: {', '.join(variants)}; by horizon {', '.join(horizons)}; "
        f"by channel {', '.join(channels)}; most in {most}."
    ]


def distribution(board: ScoreTable, behind: Collection[Cell], rival: str) -> str:
    """Whether a rival leads where the drive is like the one it was fitted to, or everywhere."""
    every = board.against(ADK_ROS, rival)
    shares, parts = [], []
    for tests, what in (
        (KNOWN_ROADS, "on the road of the training drive (nominal, and mass or inertia changed)"),
        (OTHER_ROADS, "on other roads, grip, wind or tyres"),
    ):
        total = sum(cell.test in tests for cell in every)
        if total:
            count = sum(cell.test in tests for cell in behind)
            shares.append(count / total)
            parts.append(f"{what} in {count} of {total} cells")
    text = f"It leads {', '.join(parts)}"
    if len(shares) < 2:
        return f"{text}."
    known, other = shares
    if known > 1.5 * other:
        return f"{text}: a lead in distribution above all."
    if other > 1.5 * known:
        return f"{text}: a lead out of distribution above all."
    return f"{text}: about as often in distribution as out of it."


def divergence(board: ScoreTable, rival: str) -> str:
    found = []
    for variant, test, name in board.scores:
        if name == rival:
            lost, count = board.diverged(variant, test, name)
            if lost.any():
                i = int(np.argmax(lost / np.maximum(count, 1)))
                found.append(f"{variant} {test} ({lost[i]} of {count[i]} at {HORIZONS[i]})")
    if not found:
        return "It diverges in no test."
    total = sum(name == rival for _, _, name in board.scores)
    return f"It diverges in {len(found)} of the {total} clean and noisy tests: {', '.join(found)}."


def error_magnitudes(
    board: ScoreTable, cells: Collection[Cell], rival: str | None = None
) -> list[str]:
    """Our errors there beside the noise of the sensors and beside the floor's."""
    said = []
    noise = ", ".join(f"{v:.3g} {u}" for v, u in zip(NOISE * REPORT_SCALE, UNITS, strict=True))
    for variant in board.variants():
        part = [cell for cell in cells if cell.variant == variant]
        below = sum(_adk_ros_cells(board, cell) <= NOISE[cell.channel] for cell in part)
        if part and below:
            what = "noise of the sensors" if variant != CLEAN else "noise that a sensor would add"
            said.append(
                f"In {below} of the {len(part)} {variant} cells our RMSE is below the {what} "
                f"({noise})."
            )
    ratios = np.array([oracle_notes.over_oracle(board, cell) for cell in cells])
    ratios = ratios[np.isfinite(ratios)]
    if ratios.size:
        at = oracle_notes.at_oracle(board, cells)
        share = f"in {len(at)} of {ratios.size} it is" if at else "in none of them is it"
        text = (
            f"Noisy, our RMSE in these cells is {number(float(np.median(ratios)))} times the "
            f"floor's in the median ({number(float(ratios.min()))} to "
            f"{number(float(ratios.max()))}); {share} at the floor (the plant itself, started "
            f"from the same sample, does no better)."
        )
        under = _below_floor(board, at, rival) if rival is not None else 0
        if under:
            text += (
                f" In {under} of these {rival} is below the floor, so that it is no limit there: "
                f"the plant takes the sample at its word, and smoothing its noise can gain more."
            )
        said.append(text)
    if any(cell.variant == CLEAN for cell in cells):
        said.append("Clean, the floor is exact: what is missing there is our model's.")
    return said


def _below_floor(board: ScoreTable, cells: Collection[Cell], name: str) -> int:
    """In how many of the cells a predictor is below the floor."""
    return sum(
        bool((board.rmse(c.variant, c.test, name) < board.rmse(c.variant, c.test, ORACLE))
             [c.horizon, c.channel])
        for c in cells
    )  # fmt: skip


def worst_cells(board: ScoreTable, ratios: Mapping[Cell, float], rival: str | None = None) -> str:
    """The largest ratios with all that can be set beside them."""
    parts = []
    for cell in sorted(ratios, key=ratios.__getitem__, reverse=True)[:SHOWN]:

        def shown(name: str, cell: Cell = cell) -> str:
            rmse = board.rmse(cell.variant, cell.test, name)[cell.horizon, cell.channel]
            return number(float(rmse * REPORT_SCALE[cell.channel]))

        best = best_naive(board, cell)
        beside = [f"ours {shown(ADK_ROS)}", *([f"{rival} {shown(rival)}"] if rival else [])]
        beside.append(f"{best} {shown(best)}")
        if cell.variant != CLEAN:
            if (cell.variant, cell.test, ORACLE) in board.scores:
                beside.append(f"floor {shown(ORACLE)}")
            noise = float(NOISE[cell.channel] * REPORT_SCALE[cell.channel])
            beside.append(f"sensor noise {number(noise)}")
        parts.append(
            f"{cell.variant} {cell.test} {CHANNELS[cell.channel]} {HORIZONS[cell.horizon]}, "
            f"ratio {number(ratios[cell])} ({', '.join(beside)} {UNITS[cell.channel]})"
        )
    return f"The largest: {'; '.join(parts)}."


def _adk_ros_cells(board: ScoreTable, cell: Cell) -> float:
    return float(board.rmse(cell.variant, cell.test, ADK_ROS)[cell.horizon, cell.channel])


def best_naive(board: ScoreTable, cell: Cell) -> str:
    found = {
        name: float(board.rmse(cell.variant, cell.test, name)[cell.horizon, cell.channel])
        for name in NAIVE
        if (cell.variant, cell.test, name) in board.scores
    }
    return min(found, key=found.__getitem__)
