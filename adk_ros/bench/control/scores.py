# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scores of closed-loop runs, and the criteria on what adaptation gains.

Errors are by distance, every half metre of the scored part, so that a slow car counts as much as a
fast one. Where a run did not get to, its error is `LOST_M` and a gate is violated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.control.cars import NOMINAL
from adk_ros.bench.control.closed_loop import LOST_M, ClosedLoopRun
from adk_ros.bench.control.reference_path import ReferencePath
from adk_ros.numerics.arrays import FloatArray

KINEMATIC, DYNAMIC = "kinematic bicycle", "dynamic bicycle"
FROZEN, ADAPTED, PLANT = "without adaptation", "adk_ros", "plant (limit)"
MODELS = (KINEMATIC, DYNAMIC, FROZEN, ADAPTED, PLANT)
_CYCLE_MS = 25.0
_REMOVED, _NOMINAL_LOSS = 0.5, 0.05
"""Share of the gap that adaptation must remove on changed cars, and by how much the error on the
nominal car may grow."""


@dataclass(frozen=True)
class RunScore:
    """
    Score of a run: RMS and largest lateral error, m; RMS speed error, m/s; `completed`.

    `violations`: share of the gates' length at which the lateral error exceeds the tolerance.
    `p50_ms`, `p99_ms`: time per cycle.
    """

    lateral_rms: float
    lateral_max: float
    speed_rms: float
    violations: float
    completed: bool
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True)
class ScoredRun:
    """A run and its settings; `lateral` (m,): errors at arc lengths `s` (m,)."""

    manoeuvre: str
    car: str
    controller: str
    model: str
    seed: int
    score: RunScore
    s: FloatArray
    lateral: FloatArray


@dataclass(frozen=True)
class Criterion:
    """A target, with its figures in words; `is_met` is None where there is nothing to judge."""

    text: str
    is_met: bool | None


def errors_by_distance(run: ClosedLoopRun, path: ReferencePath) -> tuple[FloatArray, FloatArray]:
    """Return arc lengths (m,) and lateral errors (m,), `LOST_M` where the run did not get to."""
    s = np.arange(path.begin, path.end, path.route.spacing)
    if not len(run.s):
        return s, np.full_like(s, LOST_M)
    # A car that slides may go back: the error at a place is that of the first passage.
    furthest = np.maximum.accumulate(run.s)
    is_new = np.diff(furthest, prepend=-np.inf) > 0.0
    lateral = np.interp(s, furthest[is_new], run.lateral[is_new])
    if not run.completed:
        lateral[s > furthest[-1]] = LOST_M
    return s, lateral


def score_run(run: ClosedLoopRun, path: ReferencePath) -> RunScore:
    """Return the score of a run along `path`."""
    s, lateral = errors_by_distance(run, path)
    tolerance = path.tolerance_at(s)
    in_gate = np.isfinite(tolerance)
    size = np.abs(lateral)
    times_ms = 1e3 * run.cycle_s if len(run.cycle_s) else np.full(1, np.nan)
    speed = run.speed_error if len(run.speed_error) else np.full(1, np.nan)
    return RunScore(
        lateral_rms=float(np.sqrt(np.mean(lateral**2))),
        lateral_max=float(size.max()),
        speed_rms=float(np.sqrt(np.mean(speed**2))),
        violations=float(np.mean(size[in_gate] > tolerance[in_gate])) if in_gate.any() else 0.0,
        completed=run.completed,
        p50_ms=float(np.median(times_ms)),
        p99_ms=float(np.percentile(times_ms, 99)),
    )


def mean_error(runs: Sequence[ScoredRun], controller: str, model: str, car: str) -> float:
    """Return the RMS lateral error, m, averaged over manoeuvres and seeds; NaN without runs."""
    found = [
        run.score.lateral_rms
        for run in runs
        if (run.controller, run.model, run.car) == (controller, model, car)
    ]
    return float(np.mean(found)) if found else float("nan")


def criteria(runs: Sequence[ScoredRun]) -> list[Criterion]:
    """Return the targets that the runs allow to judge, by controller and car."""
    found = []
    controllers = list(dict.fromkeys(run.controller for run in runs))
    cars = list(dict.fromkeys(run.car for run in runs))
    for controller in controllers:
        for car in cars:
            frozen, adapted, limit = (
                mean_error(runs, controller, model, car) for model in (FROZEN, ADAPTED, PLANT)
            )
            if car == NOMINAL and np.isfinite(frozen + adapted):
                found.append(_no_loss(controller, frozen, adapted))
            elif np.isfinite(frozen + adapted + limit):
                found.append(_gap_removed(f"{controller}, {car}", frozen, adapted, limit))
        times = [r.score.p99_ms for r in runs if (r.controller, r.model) == (controller, ADAPTED)]
        if times:
            worst = float(np.nanmax(times))
            text = f"{controller}: a cycle takes {worst:.1f} ms (largest p99), below 25 ms"
            found.append(Criterion(text, worst < _CYCLE_MS))
    return found


def _gap_removed(name: str, frozen: float, adapted: float, limit: float) -> Criterion:
    figures = f"{frozen:.3f} m frozen, {adapted:.3f} m adapted, {limit:.3f} m with the plant"
    if frozen <= limit:
        return Criterion(f"{name}: no gap to remove: {figures}", None)
    removed = (frozen - adapted) / (frozen - limit)
    text = f"{name}: adaptation removes {removed:.0%} of the gap, at least 50 %: {figures}"
    return Criterion(text, removed >= _REMOVED)


def _no_loss(controller: str, frozen: float, adapted: float) -> Criterion:
    change = adapted / frozen - 1.0
    text = (
        f"{controller}, {NOMINAL}: adaptation changes the error by {change:+.0%}, at most +5 %: "
        f"{frozen:.3f} m frozen, {adapted:.3f} m adapted"
    )
    return Criterion(text, change <= _NOMINAL_LOSS)
