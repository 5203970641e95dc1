# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was missed by how much: one test's errors of one predictor, and the board of all."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adk_ros.bench.paper.cases import NOISY, VARIANTS, measured
from adk_ros.bench.paper.predictors import ADK_ROS, NAIVE, ORDER, PredictionsOnTest
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.signals.channels import STATE_NAMES, Record
from adk_ros.signals.score import HORIZON_STEPS, REPORT_SCALE, TICK_S, score

HORIZONS = ("1 step", "0.25 s", "0.5 s", "1 s", "2 s")
CHANNELS = ("v_x", "v_y", "yaw rate")
UNITS = ("km/h", "km/h", "deg/s")
_LEAST = 1e-12


@dataclass(frozen=True)
class CaseScore:
    """
    Errors of a predictor on one test, SI: `rmse`, `worst` (5, 3) by horizon and channel.

    `count` and `diverged` (5,): predictions made, and those of them that `signals.score` holds to
    have diverged. `covered` of `claimed` (5, 3): measurements within the 90 % interval given for
    them, and all for which one was given. `seconds`: what the pass took.
    """

    rmse: FloatArray
    worst: FloatArray
    count: IntArray
    diverged: IntArray
    covered: IntArray
    claimed: IntArray
    seconds: float = 0.0


def score_case(
    record: Record, rows: IntArray, starts: IntArray, passed: PredictionsOnTest, seconds: float = 0.0
) -> CaseScore:
    """Score a pass: one step ahead at all `rows`, further from the `starts`."""
    parts = [score(record, rows, passed.one[:, None], (1,))]
    parts += [score(record, starts, passed.ahead, (step,)) for step in HORIZON_STEPS[1:]]
    covered = np.zeros((len(HORIZON_STEPS), 3), dtype=np.int64)
    claimed = covered.copy()
    if passed.variance is not None:
        index = np.array(HORIZON_STEPS)
        error = passed.ahead[:, index - 1] - measured(record)[starts[:, None] + index]
        known = ~np.isnan(error) & np.isfinite(passed.variance)
        # One that diverged is as far from its interval as can be.
        known |= np.isfinite(passed.variance) & ~np.isfinite(passed.ahead[:, index - 1])
        within = np.abs(error) <= QUANTILE_90 * np.sqrt(passed.variance)
        claimed, covered = known.sum(axis=0), (known & within).sum(axis=0)
    return CaseScore(
        rmse=np.concatenate([part.rmse for part in parts]),
        worst=np.concatenate([part.worst for part in parts]),
        count=np.array([part.count for part in parts]),
        diverged=np.array([part.diverged for part in parts]),
        covered=covered,
        claimed=claimed,
        seconds=seconds,
    )


class Cell(NamedTuple):
    """A cell of the bars: which test, how far ahead, which channel."""

    variant: str
    test: str
    horizon: int
    channel: int


@dataclass
class ScoreTable:
    """Scores by variant, test and predictor, one a seed where there are several."""

    scores: dict[tuple[str, str, str], list[CaseScore]] = field(default_factory=dict)

    def add(self, variant: str, test: str, name: str, item: CaseScore) -> None:
        """Add one seed's score."""
        self.scores.setdefault((variant, test, name), []).append(item)

    def drop(self, *names: str) -> None:
        """Forget predictors."""
        self.scores = {key: items for key, items in self.scores.items() if key[2] not in names}

    def has(self, name: str) -> bool:
        """Whether a predictor took part."""
        return any(key[2] == name for key in self.scores)

    def tests(self) -> list[str]:
        """Tests in the order they came."""
        return list(dict.fromkeys(key[1] for key in self.scores))

    def variants(self) -> list[str]:
        """Variants there are, clean first."""
        return [v for v in VARIANTS if any(key[0] == v for key in self.scores)]

    def names(self) -> list[str]:
        """Predictors, as the tables list them."""
        return [name for name in ORDER if self.has(name)]

    def seeds(self, variant: str, test: str, name: str) -> list[CaseScore]:
        """Raises KeyError where that predictor was not run."""
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
        """Return how many predictions diverged and how many there were, (5,), over all seeds."""
        items = self.seeds(variant, test, name)
        return (
            np.asarray(np.sum([item.diverged for item in items], axis=0)),
            np.asarray(np.sum([item.count for item in items], axis=0)),
        )

    def naive(self, variant: str, test: str) -> FloatArray:
        """Smallest RMSE of any naive predictor, cell by cell, (5, 3) SI."""
        found = [
            self.rmse(variant, test, name)
            for name in NAIVE if (variant, test, name) in self.scores
        ]  # fmt: skip
        return np.asarray(np.maximum(np.min(found, axis=0), _LEAST))

    def ratios(self, name: str) -> dict[Cell, FloatArray]:
        """RMSE over the best naive predictor's in every cell, (seeds,)."""
        result = {}
        for (variant, test, who), items in self.scores.items():
            if who == name:
                table = np.array([item.rmse for item in items]) / self.naive(variant, test)
                for cell in _cells(variant, test):
                    result[cell] = np.asarray(table[:, cell.horizon, cell.channel])
        return result

    def against(self, name: str, rival: str) -> dict[Cell, float]:
        """RMSE of one predictor over another's in every cell that both have."""
        result = {}
        for variant, test, who in self.scores:
            if who == name and (variant, test, rival) in self.scores:
                theirs = np.maximum(self.rmse(variant, test, rival), _LEAST)
                table = self.rmse(variant, test, name) / theirs
                for cell in _cells(variant, test):
                    result[cell] = float(table[cell.horizon, cell.channel])
        return result

    def coverage(self, variant: str | None = None, test: str | None = None) -> FloatArray:
        """Share (5, 3) of measurements within our 90 % intervals; NaN where there are none."""
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
        """One line a cell and seed: SI units, and those of the tables."""
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([
                "variant", "test", "predictor", "seed", "horizon_s", "channel", "rmse_si",
                "max_si", "rmse", "max", "unit", "predictions", "diverged", "coverage_90",
            ])  # fmt: skip
            for (variant, test, name), items in self.scores.items():
                for seed, item in enumerate(items):
                    for cell in _cells(variant, test):
                        writer.writerow([variant, test, name, seed, *_row(item, cell)])


def _cells(variant: str, test: str) -> Iterator[Cell]:
    for horizon in range(len(HORIZON_STEPS)):
        for channel in range(3):
            yield Cell(variant, test, horizon, channel)


def _row(item: CaseScore, cell: Cell) -> list[str]:
    i, c = cell.horizon, cell.channel
    rmse, worst, scale = item.rmse[i, c], item.worst[i, c], REPORT_SCALE[c]
    claimed = item.claimed[i, c]
    return [
        f"{HORIZON_STEPS[i] * TICK_S:g}", STATE_NAMES[c], f"{rmse:.6g}", f"{worst:.6g}",
        f"{rmse * scale:.6g}", f"{worst * scale:.6g}", UNITS[c], str(item.count[i]),
        str(item.diverged[i]), f"{item.covered[i, c] / claimed:.4f}" if claimed else "",
    ]  # fmt: skip


def cells_text(cells: list[Cell], values: dict[Cell, str] | None = None) -> str:
    """Cells in words, those of a test together: `noisy winter (v_x 1 step; v_y 2 s)`."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for cell in sorted(cells, key=lambda c: (c.variant == NOISY, c.test, c.channel, c.horizon)):
        text = f"{CHANNELS[cell.channel]} {HORIZONS[cell.horizon]}"
        if values is not None:
            text += f" {values[cell]}"
        grouped.setdefault((cell.variant, cell.test), []).append(text)
    return ", ".join(f"{v} {t} ({'; '.join(texts)})" for (v, t), texts in grouped.items())
