# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Predict real recordings: train on the first 60 % of each, test on its rest and on the others.

The reference is the measurement, smoothed in both directions. An error counts as its ratio to that
of the best naive predictor (`signals.score`) from the same rows.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import read_recording
from adk_ros.bench.paper.av21 import TRAINED_ON
from adk_ros.bench.paper.ratios import geometric_mean
from adk_ros.bench.paper.training_jobs import BenchPlan, Outcome, TrainingJob, train_default
from adk_ros.errors import DataError, UsageError
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.signals.channels import STATE_NAMES, TICK_NS, Record
from adk_ros.signals.score import HORIZON_STEPS
from adk_ros.train.held_out import score_held_out

HORIZONS_S = tuple(round(steps * TICK_NS * 1e-9, 3) for steps in HORIZON_STEPS)
"""Horizons of the ratios, s."""
KNOWN, HELD = "known", "held"
MAX_RATIO = 1.02
"""Largest ratio to the best naive predictor in any channel and horizon."""
MAX_GEOMETRIC_MEAN = 0.5
"""Geometric mean of the ratios 1 s ahead, over channels and vehicles, with commands known."""
_MEAN_AT_S = 1.0
_DECIMALS, _SHARED_NS = 6, 10**9
"""Digits by which samples are equal, and time for which they are no accident."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RatioOutcome:
    """
    Ratios of a channel to the best naive predictor by horizon, one number a seed.

    `trained_on`, `tested_on`: names of recordings; `commands`: "known" or "held". `ratios`: by
    `HORIZONS_S`, for each seed.
    """

    vehicle: str
    trained_on: str
    tested_on: str
    channel: str
    commands: str
    ratios: tuple[tuple[float, ...], ...]

    @property
    def mean(self) -> FloatArray:
        """Mean over the seeds by horizon, (5,)."""
        return np.asarray(np.mean(self.ratios, axis=0))

    @property
    def is_own(self) -> bool:
        """Whether the test is the rest of the recording that was trained on."""
        return self.trained_on == self.tested_on

    def as_dict(self) -> dict[str, object]:
        """Return the outcome for JSON."""
        return asdict(self) | {"horizons_s": HORIZONS_S, "mean": self.mean.tolist()}


@dataclass(frozen=True)
class _Table:
    """Ratios (steps, 3) of one training and test, NaN for channels that are not measured."""

    vehicle: str
    trained_on: str
    tested_on: str
    by_commands: dict[str, FloatArray]


def prediction_outcomes(
    bags: dict[str, list[Path]],
    plan: BenchPlan,
    refused: list[str],
    progress: Progress | None = None,
) -> list[RatioOutcome]:
    """
    Return the ratios for all vehicles.

    :param plan: training settings and number of seeds.
    :param refused: receives a line for each recording that cannot be trained on or tested on.
    """
    report = progress or (lambda done, total: None)
    count = sum(map(len, bags.values())) * plan.seeds
    tables: list[_Table] = []
    done = 0
    for vehicle, paths in bags.items():
        records: dict[str, Record] = {}
        for path in paths:
            try:
                records[path.name] = read_recording(path).record
            except (DataError, UsageError) as error:
                refused.append(f"{vehicle}, predictions: {error}")
        for trained in records:
            try:
                for seed in range(plan.seeds):
                    tables += _tested(vehicle, trained, records, plan, seed)
                    report(done + seed + 1, count)
            except (DataError, UsageError) as error:
                refused.append(f"{vehicle}, training on {trained}: {error}")
            done += plan.seeds
    return list(_by_channel(tables))


def _tested(
    vehicle: str, trained: str, records: dict[str, Record], plan: BenchPlan, seed: int
) -> Iterator[_Table]:
    """Train on the first part of a recording; yield the ratios on its rest and on the others."""
    whole = records[trained]
    cut = int(TRAINED_ON * len(whole))
    outcome = Outcome(TrainingJob("recording", seed=seed, about=trained))
    with tempfile.TemporaryDirectory(prefix="adk_bench_") as folder:
        first = whole.rows(slice(0, cut))
        predictor = train_default(outcome, [first], plan, Path(folder), _nothing)
    for name, record in records.items():
        tested = whole.rows(slice(cut, None)) if name == trained else record
        scored = score_held_out(predictor.model, [(tested, ~shared_rows(tested, first))])
        if scored is not None:
            by_commands = {KNOWN: scored.ratio, HELD: scored.ratio_held}
            yield _Table(vehicle, trained, name, by_commands)


def _by_channel(tables: Iterable[_Table]) -> Iterator[RatioOutcome]:
    """Yield the measured channels of each test, with all seeds."""

    def test(table: _Table) -> tuple[str, str, str]:
        return table.vehicle, table.trained_on, table.tested_on

    for (vehicle, trained, tested), seeds in groupby(sorted(tables, key=test), test):
        group = list(seeds)
        for c, channel in enumerate(STATE_NAMES):
            for commands in (KNOWN, HELD):
                ratios = np.array([table.by_commands[commands][:, c] for table in group])
                if np.isfinite(ratios).all():
                    rows = tuple(tuple(float(x) for x in row) for row in ratios)
                    yield RatioOutcome(vehicle, trained, tested, channel, commands, rows)


def largest_ratio(outcomes: Iterable[RatioOutcome]) -> tuple[float, str]:
    """Return the largest mean ratio, and where it is; NaN and "" without an outcome."""
    found = [
        (
            float(ratio),
            f"{x.vehicle}, {x.tested_on}, {x.channel} at {horizon_s:g} s, commands {x.commands}",
        )
        for x in outcomes
        for ratio, horizon_s in zip(x.mean, HORIZONS_S, strict=True)
    ]
    return max(found, default=(float("nan"), ""))


def mean_ratio(outcomes: Iterable[RatioOutcome]) -> float:
    """Return the geometric mean 1 s ahead with commands known, each vehicle with equal weight."""
    at = HORIZONS_S.index(_MEAN_AT_S)
    by_vehicle: dict[str, list[float]] = {}
    for x in outcomes:
        if x.commands == KNOWN and x.is_own:
            by_vehicle.setdefault(x.vehicle, []).append(float(x.mean[at]))
    if not by_vehicle:
        return float("nan")
    return geometric_mean([geometric_mean(ratios) for ratios in by_vehicle.values()])


def _nothing(share: float) -> None:
    """Ignore the progress of one training."""


def shared_rows(record: Record, other: Record) -> BoolArray:
    """
    Return which rows (n,) of a record another one has as well, for a second or longer.

    Published recordings may be cut from one drive, and overlap.
    """

    def samples(of: Record) -> list[bytes]:
        values = np.round(np.column_stack([of.x_ref, of.u]), _DECIMALS)
        return [row.tobytes() for row in np.ascontiguousarray(values)]

    known, own = set(samples(other)), samples(record)
    equal = np.array([row in known for row in own], dtype=bool)
    changes = np.flatnonzero(np.diff(np.concatenate([[False], equal, [False]]).astype(int)))
    shared = np.zeros(equal.size, dtype=bool)
    for begin, end in changes.reshape(-1, 2).tolist():
        # A car that stands still is no shared drive.
        different = len(set(own[begin:end]))
        shared[begin:end] = different * TICK_NS >= _SHARED_NS
    return shared
