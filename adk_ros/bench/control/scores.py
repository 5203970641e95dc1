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
_STANDARD_ERRORS = 2.0
"""Standard errors over the seeds that a gap must exceed: usual for a confidence of about 95 %."""
_ONE_SEED = "one seed: chance not known"


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


def errors_by_seed(
    runs: Sequence[ScoredRun], controller: str, car: str, models: Sequence[str]
) -> FloatArray:
    """
    Return the RMS lateral error, m, averaged over manoeuvres, (models, seeds).

    Of the seeds with which all `models` were run, which may be none.
    """
    found: dict[int, dict[str, list[float]]] = {}
    for run in runs:
        if (run.controller, run.car) == (controller, car):
            by_model = found.setdefault(run.seed, {})
            by_model.setdefault(run.model, []).append(run.score.lateral_rms)
    complete = [by_model for by_model in found.values() if set(models) <= set(by_model)]
    table = [[float(np.mean(by_model[name])) for by_model in complete] for name in models]
    return np.array(table)


def criteria(runs: Sequence[ScoredRun]) -> list[Criterion]:
    """Return the targets that the runs allow to judge, by controller and car."""
    found = []
    controllers = list(dict.fromkeys(run.controller for run in runs))
    cars = list(dict.fromkeys(run.car for run in runs))
    for controller in controllers:
        for car in cars:
            models = (FROZEN, ADAPTED) if car == NOMINAL else (FROZEN, ADAPTED, PLANT)
            errors = errors_by_seed(runs, controller, car, models)
            if not errors.size:
                continue
            judge = _no_loss if car == NOMINAL else _gap_removed
            found.append(judge(f"{controller}, {car}", errors))
        times = [r.score.p99_ms for r in runs if (r.controller, r.model) == (controller, ADAPTED)]
        if times:
            worst = float(np.nanmax(times))
            text = f"{controller}: a cycle takes {worst:.1f} ms (largest p99), below 25 ms"
            found.append(Criterion(text, worst < _CYCLE_MS))
    return found


def _gap_removed(name: str, errors: FloatArray) -> Criterion:
    """Judge errors (3, seeds): without adaptation, with it, and of the plant."""
    frozen, adapted, limit = errors.mean(axis=1).tolist()
    figures = f"{frozen:.3f} m frozen, {adapted:.3f} m adapted, {limit:.3f} m with the plant"
    gaps = errors[0] - errors[2]
    by_chance = _STANDARD_ERRORS * _standard_error(gaps)
    if not gaps.mean() > by_chance:
        chance = _ONE_SEED if len(gaps) == 1 else f"a gap of {by_chance:.4f} m is chance"
        return Criterion(f"{name}: no gap to remove: {figures}; {chance}", None)
    removed = (frozen - adapted) / (frozen - limit)
    text = f"{name}: adaptation removes {removed:.0%} of the gap, at least 50 %: {figures}"
    return _judged(text, removed >= _REMOVED, errors)


def _no_loss(name: str, errors: FloatArray) -> Criterion:
    """Judge errors (2, seeds): without adaptation and with it."""
    frozen, adapted = errors.mean(axis=1).tolist()
    change = adapted / frozen - 1.0
    text = (
        f"{name}: adaptation changes the error by {change:+.0%}, at most +5 %: "
        f"{frozen:.3f} m frozen, {adapted:.3f} m adapted"
    )
    return _judged(text, change <= _NOMINAL_LOSS, errors)


def _judged(text: str, is_met: bool, errors: FloatArray) -> Criterion:
    """Return a verdict on errors (n, seeds); of one seed none: it may be chance."""
    if errors.shape[1] == 1:
        return Criterion(f"{text}; {_ONE_SEED}", None)
    return Criterion(text, is_met)


def _standard_error(values: FloatArray) -> float:
    """Return that of the mean of `values` (n,); 0 of a single one."""
    if len(values) == 1:
        return 0.0
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))
