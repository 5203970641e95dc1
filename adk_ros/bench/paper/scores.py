# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of a predictor on a test, and the table of all scores."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adk_ros.bench.paper.cases import NOISY, VARIANTS, measured
from adk_ros.bench.paper.predictors import ADK_ROS, NAIVE, ORDER, PredictionsOnTest
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import STATE_NAMES, Record
from adk_ros.signals.interval_scores import (
    IntervalScore,
    score_intervals,
    with_own_error,
)
from adk_ros.signals.score import DIVERGED, HORIZON_STEPS, REPORT_SCALE, TICK_S, score

HORIZONS = ("1 step", "0.25 s", "0.5 s", "1 s", "2 s")
CHANNELS = ("v_x", "v_y", "yaw rate")
UNITS = ("km/h", "km/h", "deg/s")
_MIN_RMSE = 1e-12
"""Smallest RMSE in a denominator, SI: far below any measured error."""


def divergence_limits() -> str:
    """Return the errors from which on a prediction counts as diverged, in the tables' units."""
    speed, _, rate = DIVERGED * REPORT_SCALE
    return f"{speed:.0f} {UNITS[0]} or {rate:.0f} {UNITS[2]}"


@dataclass(frozen=True)
class CaseScore:
    """
    Errors of a predictor on one test, SI: `rmse`, `worst` (5, 3) by horizon and channel.

    `count` and `diverged` (5,): predictions, and how many of them diverged (see `signals.score`).
    `covered` of `claimed` (5, 3): measurements within the predicted 90 % interval, of all with
    such an interval. `seconds`: duration of the pass over the test. `intervals`: their scores, for
    predictors without intervals with their own RMSE; `held`: those of the published horizons,
    which hold the commands.
    """

    rmse: FloatArray
    worst: FloatArray
    count: IntArray
    diverged: IntArray
    covered: IntArray
    claimed: IntArray
    seconds: float = 0.0
    intervals: IntervalScore | None = None
    held: IntervalScore | None = None


def score_case(
    record: Record,
    rows: IntArray,
    starts: IntArray,
    passed: PredictionsOnTest,
    seconds: float = 0.0,
) -> CaseScore:
    """Score a pass over a test: one step ahead at all `rows`, longer horizons at `starts`."""
    parts = [score(record, rows, passed.one[:, None], (1,))]
    parts += [score(record, starts, passed.ahead, (step,)) for step in HORIZON_STEPS[1:]]
    index = np.array(HORIZON_STEPS)
    ahead = passed.ahead[:, index - 1]
    then = measured(record)[starts[:, None] + index]
    none = np.zeros((len(HORIZON_STEPS), 3), dtype=np.int64)
    if passed.variance is not None:
        known = score_intervals(ahead, passed.variance, then)
    else:
        known = replace(with_own_error(ahead, then), covered=none, claimed=none)
    held = None
    if passed.held is not None and passed.held_variance is not None:
        held = score_intervals(passed.held[:, index - 1], passed.held_variance, then)
    return CaseScore(
        rmse=np.concatenate([part.rmse for part in parts]),
        worst=np.concatenate([part.worst for part in parts]),
        count=np.array([part.count for part in parts]),
        diverged=np.array([part.diverged for part in parts]),
        covered=known.covered,
        claimed=known.claimed,
        seconds=seconds,
        intervals=known,
        held=held,
    )


class Combination(NamedTuple):
    """A combination of variant, test, horizon and channel, with one error each."""

    variant: str
    test: str
    horizon: int
    channel: int


@dataclass
class ScoreTable:
    """Scores by variant, test and predictor, one per seed."""

    scores: dict[tuple[str, str, str], list[CaseScore]] = field(default_factory=dict)

    def add(self, variant: str, test: str, name: str, item: CaseScore) -> None:
        """Add the score of one seed."""
        self.scores.setdefault((variant, test, name), []).append(item)

    def drop(self, *names: str) -> None:
        """Remove predictors."""
        self.scores = {key: items for key, items in self.scores.items() if key[2] not in names}

    def has(self, name: str) -> bool:
        """Whether there are scores of a predictor."""
        return any(key[2] == name for key in self.scores)

    def tests(self) -> list[str]:
        """Return the tests in the order of their scores."""
        return list(dict.fromkeys(key[1] for key in self.scores))

    def variants(self) -> list[str]:
        """Return the variants with scores, clean first."""
        return [v for v in VARIANTS if any(key[0] == v for key in self.scores)]

    def names(self) -> list[str]:
        """Return the predictors with scores, in the order of the tables."""
        return [name for name in ORDER if self.has(name)]

    def seeds(self, variant: str, test: str, name: str) -> list[CaseScore]:
        """Return the scores of all seeds; raise `KeyError` if the predictor was not run."""
        return self.scores[variant, test, name]

    def rmse(self, variant: str, test: str, name: str) -> FloatArray:
        """Return the mean over seeds, (5, 3) SI."""
        items = self.seeds(variant, test, name)
        return np.asarray(np.mean([item.rmse for item in items], axis=0))

    def worst(self, variant: str, test: str, name: str) -> FloatArray:
        """Return the mean over seeds of the largest errors, (5, 3) SI."""
        items = self.seeds(variant, test, name)
        return np.asarray(np.mean([item.worst for item in items], axis=0))

    def diverged(self, variant: str, test: str, name: str) -> tuple[IntArray, IntArray]:
        """Return the numbers of diverged and of all predictions, (5,), over all seeds."""
        items = self.seeds(variant, test, name)
        return (
            np.asarray(np.sum([item.diverged for item in items], axis=0)),
            np.asarray(np.sum([item.count for item in items], axis=0)),
        )

    def naive(self, variant: str, test: str) -> FloatArray:
        """Return the smallest RMSE of the naive predictors by horizon and channel, (5, 3) SI."""
        found = [
            self.rmse(variant, test, name)
            for name in NAIVE if (variant, test, name) in self.scores
        ]  # fmt: skip
        return np.asarray(np.maximum(np.min(found, axis=0), _MIN_RMSE))

    def ratios(self, name: str) -> dict[Combination, FloatArray]:
        """Return the RMSE divided by that of the best naive predictor, (seeds,) each."""
        result = {}
        for (variant, test, who), items in self.scores.items():
            if who == name:
                table = np.array([item.rmse for item in items]) / self.naive(variant, test)
                for combo in _combinations(variant, test):
                    result[combo] = np.asarray(table[:, combo.horizon, combo.channel])
        return result

    def against(self, name: str, baseline: str) -> dict[Combination, float]:
        """Return the RMSE of `name` over that of `baseline`, where both were run."""
        result = {}
        for variant, test, who in self.scores:
            if who == name and (variant, test, baseline) in self.scores:
                reference = np.maximum(self.rmse(variant, test, baseline), _MIN_RMSE)
                table = self.rmse(variant, test, name) / reference
                for combo in _combinations(variant, test):
                    result[combo] = float(table[combo.horizon, combo.channel])
        return result

    def coverage(self, variant: str | None = None, test: str | None = None) -> FloatArray:
        """Return the share (5, 3) of measurements in adk_ros's 90 % intervals; NaN if none."""
        chosen = [
            item
            for (v, t, name), items in self.scores.items()
            if name == ADK_ROS and variant in (None, v) and test in (None, t)
            for item in items
        ]
        covered = np.sum([item.covered for item in chosen], axis=0)
        claimed = np.sum([item.claimed for item in chosen], axis=0)
        return np.asarray(np.where(claimed > 0, covered / np.maximum(claimed, 1), np.nan))

    def write_csv(self, path: Path) -> None:
        """Write one line per combination and seed, in SI units and in those of the tables."""
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([
                "variant", "test", "predictor", "seed", "horizon_s", "channel", "rmse_si",
                "max_si", "rmse", "max", "unit", "predictions", "diverged", "coverage_90",
            ])  # fmt: skip
            for (variant, test, name), items in self.scores.items():
                for seed, item in enumerate(items):
                    for combo in _combinations(variant, test):
                        writer.writerow([variant, test, name, seed, *_row(item, combo)])


def _combinations(variant: str, test: str) -> Iterator[Combination]:
    for horizon in range(len(HORIZON_STEPS)):
        for channel in range(3):
            yield Combination(variant, test, horizon, channel)


def _row(item: CaseScore, combo: Combination) -> list[str]:
    i, c = combo.horizon, combo.channel
    rmse, worst, scale = item.rmse[i, c], item.worst[i, c], REPORT_SCALE[c]
    claimed = item.claimed[i, c]
    return [
        f"{HORIZON_STEPS[i] * TICK_S:g}", STATE_NAMES[c], f"{rmse:.6g}", f"{worst:.6g}",
        f"{rmse * scale:.6g}", f"{worst * scale:.6g}", UNITS[c], str(item.count[i]),
        str(item.diverged[i]), f"{item.covered[i, c] / claimed:.4f}" if claimed else "",
    ]  # fmt: skip


def combinations_text(
    combos: list[Combination], values: dict[Combination, str] | None = None
) -> str:
    """Combinations in words, those of a test together: `noisy winter (v_x 1 step; v_y 2 s)`."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for combo in sorted(combos, key=lambda c: (c.variant == NOISY, c.test, c.channel, c.horizon)):
        text = f"{CHANNELS[combo.channel]} {HORIZONS[combo.horizon]}"
        if values is not None:
            text += f" {values[combo]}"
        grouped.setdefault((combo.variant, combo.test), []).append(text)
    return ", ".join(f"{v} {t} ({'; '.join(texts)})" for (v, t), texts in grouped.items())
