# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How right the published horizons are, and their covariances: commands held, and planned.

A planner is played that publishes the commands of the recording every 0.1 s: exactly and over the
whole horizon, exactly and over half a second, with an error that lasts from plan to plan, or those
of another part of the drive (a plan that nobody carries out). The samples are those of
`adk replay`.

RMSE is that of predicted minus reference states, as everywhere. A covariance is one of measured
minus predicted state (`Predictor.horizon_covariance`), so its intervals are compared with the
samples, noise included, and not with the smooth reference.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adk_ros.bags.recording import read_recording
from adk_ros.bench.paper.cases import measured
from adk_ros.bench.paper.criterion import Criterion
from adk_ros.bench.paper.interval_criteria import (
    ComparedIntervals,
    compared_intervals,
    coverage_criterion,
    interval_score_criterion,
    interval_width_criterion,
    pooled_intervals_coverage,
)
from adk_ros.bench.paper.scores import Combination
from adk_ros.bench.runtime.synthetic_feed import bench_model
from adk_ros.errors import DataError, UsageError
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.planned_horizon import PlannedHorizon
from adk_ros.model.pose_horizon import pose_covariance, pose_horizon
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.offline.export import write_bag
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.signals.channels import STATE_NAMES, TICK_NS, Record
from adk_ros.signals.command_plan import CommandPlan
from adk_ros.signals.interval_scores import IntervalScore, score_intervals, with_own_error
from adk_ros.signals.score import (
    HORIZON_STEPS,
    best_naive,
    naive_predictions,
    scorable_rows,
    score,
)

HELD, EXACT, SHORT = "held", "planned", "short plan"
INEXACT, OTHER = "inexact plan", "another drive's plan"
KINDS = (HELD, EXACT, SHORT, INEXACT, OTHER)
CRITERION_NAMES = {
    HELD: "held", EXACT: "planned", SHORT: "short-plan", INEXACT: "inexact-plan",
    OTHER: "another-drives-plan",
}  # fmt: skip
SEEDS = (1, 2, 3)
"""
Of the drives. In one of three minutes a coverage at 2 s rests on 85 horizons that do not overlap,
and has a standard deviation of 3 %: too much to be judged.
"""
_STEPS = max(HORIZON_STEPS)
_PLAN_TICKS = 4
"""Ticks between plans: 10 Hz, a usual rate of planners."""
_PLAN_LENGTH = _STEPS + _PLAN_TICKS + 1
"""Points of a plan that covers the horizon until the next one comes."""
_SHORT_PLAN_LENGTH = round(0.5e9) // TICK_NS + 1
"""Points of a plan that ends 0.5 s after its stamp, a quarter of the horizon; by choice."""
_TIMEOUT_S = 0.5
"""The node's default."""
_OFFSET = 0.05
"""Standard deviation of an inexact plan's offset, in units of the command's spread in training."""
_SETTLED = 400
"""Samples, 10 s, before the first that counts: the covariances are those of validation until the
monitored horizons have ended."""


@dataclass(frozen=True)
class HorizonQuality:
    """
    Quality by scored horizon and state (5, 3).

    `ratio`: RMSE over that of the best naive predictor, geometric mean over the drives; `coverage`
    of the 90 % intervals, over all drives; `width` of them and `interval_score` (see
    `signals.interval_scores`), SI, means. `path_coverage` and `path_rmse` of x, y (m) and heading
    (rad), from the exact pose, in the axes of the start. `followed`: share of the starts whose
    horizon follows the plan as far as the plan reaches.
    """

    ratio: list[list[float]]
    coverage: list[list[float]]
    width: list[list[float]]
    interval_score: list[list[float]]
    path_coverage: list[list[float]]
    path_rmse: list[list[float]]
    followed: float


class _DriveScores(NamedTuple):
    """Scores on one drive; as in `HorizonQuality`, and `compared` with the naive predictors."""

    ratio: FloatArray
    intervals: IntervalScore
    compared: ComparedIntervals
    path: IntervalScore
    path_rmse: FloatArray
    followed: float


class _Scored(NamedTuple):
    """
    What a drive is scored against.

    `rows` of the starts; `naive` (5, 3): RMSE of the best naive predictor; `naive_intervals` of
    each; `measurements` and `poses` (n, 5, 3) at the scored horizons.
    """

    record: Record
    rows: IntArray
    naive: FloatArray
    naive_intervals: list[IntervalScore]
    measurements: FloatArray
    poses: FloatArray


class _Made(NamedTuple):
    """
    Horizons and their variances (n, 80, 3), paths and theirs at the scored steps (n, 5, 3).

    `followed`: share of the starts whose horizon follows the plan as far as the plan reaches.
    """

    horizons: FloatArray
    variances: FloatArray
    paths: FloatArray
    path_variances: FloatArray
    followed: float


def check_duration(seconds: float) -> None:
    """Raise `UsageError` for a drive of which too little would be scored, or too long a one."""
    if not 30.0 <= seconds <= 3600.0:
        raise UsageError(f"--duration {seconds:g} is out of range: choose 30 to 3600 s")


def bench_plans(
    model_path: Path | None,
    seconds: float = 180.0,
    seeds: Sequence[int] = SEEDS,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """
    Run it on simulated drives that no training has seen, one per seed.

    :raises DataError: a drive is too short to score.
    """
    model = bench_model(model_path)
    records = []
    for seed in seeds:
        drive = simulate(load_scenario("town"), seed=seed, duration_s=seconds)
        with tempfile.TemporaryDirectory() as folder:
            write_bag(drive, Path(folder) / "bag")
            records.append(read_recording(Path(folder) / "bag").record)
    return measure_plans(model, records, progress) | {"seeds": list(seeds)}


def measure_plans(
    model: KoopmanModel,
    records: Sequence[Record],
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """
    Return, by kind of plan, the `HorizonQuality`; `criteria` with verdict, name and figure.

    :raises DataError: no start of a record can be scored.
    """
    drives = [_scored(model, record) for record in records]
    result: dict[str, Any] = {
        "horizons_s": [n * TICK_NS * 1e-9 for n in HORIZON_STEPS],
        "states": list(STATE_NAMES),
        "starts": sum(int(drive.rows.size) for drive in drives),
    }
    scores: dict[str, list[_DriveScores]] = {}
    for number, kind in enumerate(KINDS):
        for n, drive in enumerate(drives):
            if progress is not None:
                progress(number * len(drives) + n, len(KINDS) * len(drives))
            made = _horizons(model, drive.record, drive.rows, kind)
            scores.setdefault(kind, []).append(_drive_scores(drive, made))
        result[kind] = asdict(_quality(scores[kind]))
    return result | {"criteria": [vars(item) for item in _criteria(scores)]}


def _scored(model: KoopmanModel, record: Record) -> _Scored:
    rows = scorable_rows(record, model.history + 1, _STEPS)
    rows = rows[rows >= _SETTLED]
    if not rows.size:
        raise DataError("the drive is too short: a start needs 10 s before it and 2 s after it")
    index = np.array(HORIZON_STEPS)
    naive = naive_predictions(record, rows, _STEPS)
    then = measured(record)[rows[:, None] + index]
    return _Scored(
        record,
        rows,
        best_naive({name: score(record, rows, x) for name, x in naive.items()}),
        [with_own_error(x[:, index - 1], then) for x in naive.values()],
        then,
        np.array([_driven(record, int(row))[index - 1] for row in rows]),
    )


def _criteria(scores: dict[str, list[_DriveScores]]) -> list[Criterion]:
    """Judge the intervals of each kind of plan: coverage, width and interval score."""
    found = []
    for kind, drives in scores.items():
        coverage = {
            Combination(kind, "all drives", i, c): float(share)
            for (i, c), share in np.ndenumerate(
                pooled_intervals_coverage([drive.intervals for drive in drives])
            )
        }
        name, compared = CRITERION_NAMES[kind], [drive.compared for drive in drives]
        found += [
            coverage_criterion(f"coverage-{name}", coverage, "horizon, channel"),
            interval_width_criterion(f"interval-width-{name}", compared),
            interval_score_criterion(f"interval-score-{name}", compared),
        ]
    return found


def _horizons(model: KoopmanModel, record: Record, rows: IntArray, kind: str) -> _Made:
    predictor = Predictor(model, horizon_steps=_STEPS, withhold_implausible=True)
    planned = PlannedHorizon(model, _STEPS, _TIMEOUT_S)
    index = {int(row): i for i, row in enumerate(rows)}
    horizons, variances = np.full((2, rows.size, _STEPS, 3), np.nan)
    paths, path_variances = np.full((2, rows.size, len(HORIZON_STEPS), 3), np.nan)
    scored = np.array(HORIZON_STEPS) - 1
    follows, rng = 0, np.random.default_rng(0)
    plan: CommandPlan | None = None
    for row in range(int(rows[-1]) + 1):
        sample = sample_at(record, row)
        prediction = predictor.step(sample)
        if prediction is None:
            planned.interrupt()
            continue
        if kind != HELD and row % _PLAN_TICKS == 0:
            plan = _plan(model, record, row, kind, rng)
            planned.take(plan)
        prediction = planned.apply(predictor, prediction, sample)
        i = index.get(row)
        if i is not None:
            horizon, covariance = prediction.horizon, prediction.horizon_covariance
            horizons[i], variances[i] = horizon, np.einsum("hcc->hc", covariance)
            path = pose_horizon(np.zeros(3), predictor.present_state, horizon)
            spread = pose_covariance(path, horizon, covariance)
            paths[i], path_variances[i] = path[scored], np.einsum("hcc->hc", spread)[scored]
            if plan is not None:
                follows += 0 < max(prediction.planned_steps) == _reach(plan, sample.stamp_ns)
    return _Made(horizons, variances, paths, path_variances, follows / rows.size)


def _plan(
    model: KoopmanModel, record: Record, row: int, kind: str, rng: np.random.Generator
) -> CommandPlan:
    first = (row + len(record) // 2) % (len(record) - _PLAN_LENGTH) if kind == OTHER else row
    length = _SHORT_PLAN_LENGTH if kind == SHORT else _PLAN_LENGTH
    commands = record.u[first : first + length]
    if kind == INEXACT:
        commands = commands + _OFFSET * rng.normal(size=2) * model.scaling.u_scale
    stamp_ns = int(record.stamp_ns[row])
    times_ns = stamp_ns + TICK_NS * np.arange(len(commands), dtype=np.int64)
    return CommandPlan(stamp_ns, times_ns, commands)


def _reach(plan: CommandPlan, stamp_ns: int) -> int:
    """Return the steps of a horizon from a sample on that a plan covers, its last point's too."""
    return min(_STEPS, -((stamp_ns - int(plan.times_ns[-1])) // TICK_NS) + 1)


def _drive_scores(drive: _Scored, made: _Made) -> _DriveScores:
    at = np.array(HORIZON_STEPS) - 1
    found = score_intervals(made.horizons[:, at], made.variances[:, at], drive.measurements)
    return _DriveScores(
        ratio=score(drive.record, drive.rows, made.horizons).rmse / drive.naive,
        intervals=found,
        compared=compared_intervals([found], drive.naive_intervals),
        path=score_intervals(made.paths, made.path_variances, drive.poses),
        path_rmse=np.sqrt(np.nanmean((made.paths - drive.poses) ** 2, axis=0)),
        followed=made.followed,
    )


def _quality(drives: Sequence[_DriveScores]) -> HorizonQuality:
    return HorizonQuality(
        ratio=np.exp(np.mean([np.log(drive.ratio) for drive in drives], axis=0)).tolist(),
        coverage=pooled_intervals_coverage([drive.intervals for drive in drives]).tolist(),
        width=np.mean([drive.intervals.width for drive in drives], axis=0).tolist(),
        interval_score=np.mean([drive.intervals.score for drive in drives], axis=0).tolist(),
        path_coverage=pooled_intervals_coverage([drive.path for drive in drives]).tolist(),
        path_rmse=np.mean([drive.path_rmse for drive in drives], axis=0).tolist(),
        followed=float(np.mean([drive.followed for drive in drives])),
    )


def _driven(record: Record, row: int) -> FloatArray:
    """Return the poses (steps, 3) that the measured velocities lead to, from a row on."""
    x = record.x_ref[row : row + _STEPS + 1]
    return pose_horizon(np.zeros(3), x[0], x[1:])
