# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sentences about a set of lost combinations: where they are and how large the errors are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping

import numpy as np

from adk_ros.bench.paper import oracle_notes
from adk_ros.bench.paper.cases import CLEAN, NOISE, OWN_TESTS, PAPER_TESTS
from adk_ros.bench.paper.paper_tables import number
from adk_ros.bench.paper.predictors import ADK_ROS, NAIVE, ORACLE
from adk_ros.bench.paper.scores import CHANNELS, HORIZONS, UNITS, Combination, ScoreTable
from adk_ros.signals.score import REPORT_SCALE

KNOWN_ROADS = PAPER_TESTS[:5]
"""Tests on the road of the training drive: the same vehicle, or changed mass or inertia."""
OTHER_ROADS = (*PAPER_TESTS[5:], *OWN_TESTS)
SHOWN = 3
"""Number of combinations or tests that are named."""


def combination_location(
    board: ScoreTable, combos: Collection[Combination], begin: str
) -> list[str]:
    """Count combinations by variant, horizon and channel, and name the tests with the most."""
    every = list(board.ratios(ADK_ROS))

    def counted(key: Callable[[Combination], object], names: Mapping[object, str]) -> list[str]:
        hit, total = Counter(map(key, combos)), Counter(map(key, every))
        return [f"{name} {hit[k]} of {total[k]}" for k, name in names.items() if hit[k]]

    variants = counted(lambda c: c.variant, {v: v for v in board.variants()})
    horizons = counted(lambda c: c.horizon, dict(enumerate(HORIZONS)))
    channels = counted(lambda c: c.channel, dict(enumerate(CHANNELS)))
    hit = Counter(combo.test for combo in combos)
    total = Counter(combo.test for combo in every)
    most = ", ".join(f"{test} ({n} of {total[test]})" for test, n in hit.most_common(SHOWN))
    return [
        f"{begin} {len(combos)} combinations: {', '.join(variants)}; by horizon "
        f"{', '.join(horizons)}; by channel {', '.join(channels)}; most in {most}."
    ]


def distribution(board: ScoreTable, behind: Collection[Combination], baseline: str) -> str:
    """Say whether a baseline leads in distribution, out of distribution, or both."""
    every = board.against(ADK_ROS, baseline)
    shares, parts = [], []
    for tests, what in (
        (KNOWN_ROADS, "on the road of the training drive (nominal, and mass or inertia changed)"),
        (OTHER_ROADS, "on other roads, grip, wind or tyres"),
    ):
        total = sum(combo.test in tests for combo in every)
        if total:
            count = sum(combo.test in tests for combo in behind)
            shares.append(count / total)
            parts.append(f"{what} in {count} of {total} combinations")
    text = f"It leads {', '.join(parts)}"
    if len(shares) < 2:
        return f"{text}."
    known, other = shares
    if known > 1.5 * other:
        return f"{text}: mainly in distribution."
    if other > 1.5 * known:
        return f"{text}: mainly out of distribution."
    return f"{text}: about as often in distribution as out of it."


def divergence(board: ScoreTable, baseline: str) -> str:
    """Name the tests in which a baseline diverges."""
    found = []
    for variant, test, name in board.scores:
        if name == baseline:
            lost, count = board.diverged(variant, test, name)
            if lost.any():
                i = int(np.argmax(lost / np.maximum(count, 1)))
                found.append(f"{variant} {test} ({lost[i]} of {count[i]} at {HORIZONS[i]})")
    if not found:
        return "It diverges in no test."
    total = sum(name == baseline for _, _, name in board.scores)
    return f"It diverges in {len(found)} of the {total} clean and noisy tests: {', '.join(found)}."


def error_magnitudes(
    board: ScoreTable, combos: Collection[Combination], baseline: str | None = None
) -> list[str]:
    """Compare the errors of adk_ros with the sensor noise and with the errors of the oracle."""
    sentences = []
    noise = ", ".join(f"{v:.3g} {u}" for v, u in zip(NOISE * REPORT_SCALE, UNITS, strict=True))
    for variant in board.variants():
        part = [combo for combo in combos if combo.variant == variant]
        below = sum(_adk_ros_rmse(board, combo) <= NOISE[combo.channel] for combo in part)
        if part and below:
            what = "noise of the sensors" if variant != CLEAN else "noise that a sensor would add"
            sentences.append(
                f"In {below} of the {len(part)} {variant} combinations the RMSE of {ADK_ROS} is "
                f"below the {what} ({noise})."
            )
    ratios = np.array([oracle_notes.over_oracle(board, combo) for combo in combos])
    ratios = ratios[np.isfinite(ratios)]
    if ratios.size:
        at = oracle_notes.at_oracle(board, combos)
        share = f"in {len(at)} of {ratios.size} it is" if at else "in none of them is it"
        text = (
            f"On noisy tests the RMSE of {ADK_ROS} in these combinations is "
            f"{number(float(np.median(ratios)))} times that of the oracle in the median "
            f"({number(float(ratios.min()))} to {number(float(ratios.max()))}); {share} at the "
            f"oracle (the plant itself, started from the same sample, is no better)."
        )
        under = _below_oracle(board, at, baseline) if baseline is not None else 0
        if under:
            text += (
                f" In {under} of these {baseline} is better than the oracle, which is no bound "
                f"there: the oracle does not filter the noise of the sample."
            )
        sentences.append(text)
    if any(combo.variant == CLEAN for combo in combos):
        sentences.append("On clean tests the oracle is exact: the error is due to the model.")
    return sentences


def _below_oracle(board: ScoreTable, combos: Collection[Combination], name: str) -> int:
    """Return the number of combinations in which a predictor is better than the oracle."""
    return sum(
        bool((board.rmse(c.variant, c.test, name) < board.rmse(c.variant, c.test, ORACLE))
             [c.horizon, c.channel])
        for c in combos
    )  # fmt: skip


def worst_combinations(
    board: ScoreTable, ratios: Mapping[Combination, float], baseline: str | None = None
) -> str:
    """Name the largest ratios, with the RMSE of the other predictors and the sensor noise."""
    parts = []
    for combo in sorted(ratios, key=ratios.__getitem__, reverse=True)[:SHOWN]:

        def shown(name: str, combo: Combination = combo) -> str:
            rmse = board.rmse(combo.variant, combo.test, name)[combo.horizon, combo.channel]
            return number(float(rmse * REPORT_SCALE[combo.channel]))

        best = best_naive(board, combo)
        figures = [f"{name} {shown(name)}" for name in (ADK_ROS, baseline) if name]
        figures.append(f"{best} {shown(best)}")
        if combo.variant != CLEAN:
            if (combo.variant, combo.test, ORACLE) in board.scores:
                figures.append(f"oracle {shown(ORACLE)}")
            noise = float(NOISE[combo.channel] * REPORT_SCALE[combo.channel])
            figures.append(f"sensor noise {number(noise)}")
        parts.append(
            f"{combo.variant} {combo.test} {CHANNELS[combo.channel]} {HORIZONS[combo.horizon]}, "
            f"ratio {number(ratios[combo])} ({', '.join(figures)} {UNITS[combo.channel]})"
        )
    return f"The largest: {'; '.join(parts)}."


def _adk_ros_rmse(board: ScoreTable, combo: Combination) -> float:
    return float(board.rmse(combo.variant, combo.test, ADK_ROS)[combo.horizon, combo.channel])


def best_naive(board: ScoreTable, combo: Combination) -> str:
    """Return the name of the best naive predictor in a combination."""
    found = {
        name: float(board.rmse(combo.variant, combo.test, name)[combo.horizon, combo.channel])
        for name in NAIVE
        if (combo.variant, combo.test, name) in board.scores
    }
    return min(found, key=found.__getitem__)
