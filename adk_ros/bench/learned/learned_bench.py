# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run `adk bench learned`: learned vehicle models of other authors against adk_ros.

All are trained on the first 60 % of a recording and roll out from the same samples of the rest,
under the recorded commands. Errors are those against the recorded state, before it is used.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import read_recording
from adk_ros.bench.learned.learned_models import (
    DEEP_PACEJKA_GIVEN,
    EPOCHS,
    HISTORY,
    LearnedModels,
    Rollout,
    Training,
    chosen,
    find_code,
)
from adk_ros.bench.learned.sampled_drive import SAMPLE_NS, read_sampled, starts
from adk_ros.bench.paper.av21 import TRAINED_ON, find_recordings
from adk_ros.bench.paper.cases import AHEAD
from adk_ros.bench.paper.predictors import ADK_ROS, KoopmanPredictor
from adk_ros.bench.paper.training_jobs import BenchPlan, Outcome, TrainingJob, train_default
from adk_ros.errors import DataError, UsageError
from adk_ros.model.evaluation import sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.signals.score import DIVERGED, NAIVE_PREDICTORS
from adk_ros.train.train_settings import TrainSettings

HORIZONS_S = (0.04, 0.25, 0.5, 1.0, 2.0)
"""The first is one step of the learned models."""
REFRESHED = ", network at each step"
"""Appended to the name of a model whose coefficients do not stay those of the start."""
_STEPS_AHEAD = round(HORIZONS_S[-1] * 1e9 / SAMPLE_NS)
_TIMED_TICKS = 300

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True)
class LearnedPlan:
    """What to run; `epochs`: those that are not the published; no `models`: see `chosen`."""

    recordings: tuple[Path, ...]
    code: Path
    python: Path | None = None
    models: tuple[str, ...] = ()
    seeds: int = 3
    epochs: Mapping[str, int] = field(default_factory=dict)
    train: TrainSettings = field(default_factory=TrainSettings)


@dataclass(frozen=True)
class Effort:
    """Processor time to train, for one step and for one rollout of 2 s, s, by one thread."""

    train_s: float
    step_s: float
    rollout_s: float


@dataclass
class RecordingResult:
    """
    Errors on the rest of a recording, from `count` starts.

    `rmse`: by predictor, (5, 3) SI by horizon and channel, one for each seed. `effort` and
    `trainings` likewise.
    """

    name: str
    count: int
    rmse: dict[str, list[FloatArray]] = field(default_factory=dict)
    effort: dict[str, list[Effort]] = field(default_factory=dict)
    trainings: dict[str, list[Training]] = field(default_factory=dict)

    def mean(self, name: str) -> FloatArray:
        """Return the mean RMSE of a predictor over its seeds, (5, 3)."""
        return np.asarray(np.mean(self.rmse[name], axis=0))

    def naive(self) -> FloatArray:
        """Return the smallest RMSE of the naive predictors, (5, 3)."""
        found = [self.mean(name) for name in NAIVE_PREDICTORS if name in self.rmse]
        return np.asarray(np.min(found, axis=0))

    def best(self, model: str) -> FloatArray:
        """Return the smaller RMSE of both rollouts of a model, in each combination, (5, 3)."""
        names = [name for name in (model, model + REFRESHED) if name in self.rmse]
        return np.asarray(np.min([self.mean(name) for name in names], axis=0))

    def add(self, name: str, truth: FloatArray, predicted: FloatArray) -> None:
        """Add the errors of a predictor, (m, 5, 3)."""
        error = predicted - truth
        error = np.where(np.isfinite(error) & (np.abs(error) <= DIVERGED), error, DIVERGED)
        self.rmse.setdefault(name, []).append(np.sqrt(np.mean(error**2, axis=0)))


def run_learned(
    plan: LearnedPlan,
    scratch: Path,
    progress: Progress | None = None,
    keep: Callable[[list[RecordingResult]], None] | None = None,
) -> list[RecordingResult]:
    """
    Train and compare all on each recording.

    :param keep: called with the results so far after each learned model.
    :raises UsageError, DataError: an option, the other environment, or a recording is unusable.
    """
    code = find_code(plan.code)
    models = chosen(plan.models, code)
    if not 1 <= plan.seeds <= 100:
        raise UsageError(f"--seeds is {plan.seeds}: choose 1 to 100")
    total = len(plan.recordings) * plan.seeds * (1 + len(models))
    done = 0

    def tell(what: str) -> None:
        if progress is not None:
            progress(done, total, what)

    results: list[RecordingResult] = []
    for path in plan.recordings:
        case = _Case(path)
        result = RecordingResult(path.name, len(case.rows))
        results.append(result)
        case.score_naive(result)
        for seed in range(plan.seeds):
            tell(f"{path.name}: {ADK_ROS}")
            case.run_ours(result, plan, seed, scratch)
            done += 1
            with LearnedModels(scratch, plan.python) as worker:
                for model in models:
                    tell(f"{path.name}: {model}")
                    epochs = plan.epochs.get(model, EPOCHS[model])
                    case.run_learned(result, worker, model, code[model], epochs, seed)
                    done += 1
                    if keep is not None:
                        keep(results)
    tell("")
    return results


class _Case:
    """A recording with its split and its starts, at both samplings."""

    def __init__(self, path: Path) -> None:
        self.record = read_recording(path).record
        self.drive = read_sampled(path)
        self.cut = int(TRAINED_ON * len(self.record))
        boundary = int(np.searchsorted(self.drive.stamp_ns, self.record.stamp_ns[self.cut]))
        self.first = self.drive.rows(slice(0, boundary))
        self.rest = self.record.rows(slice(self.cut, None))
        self.rows, tick_ns = starts(self.drive, boundary, HISTORY, _STEPS_AHEAD)
        self.ticks = np.searchsorted(self.rest.stamp_ns, tick_ns)
        self.ticks = np.minimum(self.ticks, len(self.rest) - AHEAD - 1)
        here = self.rest.stamp_ns[self.ticks] == tick_ns
        here &= self.rest.episode[self.ticks] == self.rest.episode[self.ticks + AHEAD]
        self.rows, self.ticks = self.rows[here], self.ticks[here]
        if not self.rows.size:
            raise DataError(f"{path.name}: its last 40 % have no 3 s above 5 m/s to predict")
        ahead = np.arange(_STEPS_AHEAD + 1)
        self.truth = at_horizons(self.drive.x[self.rows[:, None] + ahead])

    def score_naive(self, result: RecordingResult) -> None:
        """Score persistence and linear extrapolation of the last two samples."""
        x, before = self.drive.x[self.rows], self.drive.x[self.rows - 1]
        seconds = np.array(HORIZONS_S)[:, None] / (SAMPLE_NS * 1e-9)
        for name, slope in zip(NAIVE_PREDICTORS[:2], (0.0 * x, x - before), strict=True):
            result.add(name, self.truth, x[:, None] + seconds * slope[:, None])

    def run_ours(self, result: RecordingResult, plan: LearnedPlan, seed: int, to: Path) -> None:
        """Train and score adk_ros."""
        outcome = Outcome(TrainingJob("recording", "recorded", seed, self.record.name))
        first = self.record.rows(slice(0, self.cut))
        with_settings = BenchPlan(train=plan.train)
        began_s = time.process_time()
        predictor = train_default(outcome, [first], with_settings, to, lambda _: None)
        train_s = time.process_time() - began_s
        ahead = predictor.run(self.rest, self.ticks[:0], self.ticks).ahead
        path = np.concatenate([self.rest.x[self.ticks][:, None], ahead], axis=1)
        offset = self.drive.stamp_ns[self.rows] - self.rest.stamp_ns[self.ticks]
        result.add(ADK_ROS, self.truth, _interpolated(path, offset, TICK_NS))
        step_s, rollout_s = time_ours(predictor, self.rest)
        result.effort.setdefault(ADK_ROS, []).append(Effort(train_s, step_s, rollout_s))

    def run_learned(
        self, result: RecordingResult, worker: LearnedModels, model: str, code: Path,
        epochs: int, seed: int,
    ) -> None:  # fmt: skip
        """Train and score a learned model, with both kinds of rollout."""
        training = worker.train(model, code, self.first, epochs, seed)
        result.trainings.setdefault(model, []).append(training)
        # With future speeds given, later steps would be given later ones.
        kinds = (False,) if model == DEEP_PACEJKA_GIVEN else (False, True)
        for refreshed in kinds:
            name = model + REFRESHED if refreshed else model
            rollout = worker.predict(model, self.drive, self.rows, _STEPS_AHEAD, refreshed)
            result.add(name, self.truth, self._at_horizons(rollout))
            effort = Effort(training.seconds, rollout.step_s, rollout.rollout_s)
            result.effort.setdefault(name, []).append(effort)

    def _at_horizons(self, rollout: Rollout) -> FloatArray:
        begin = self.drive.x[self.rows][:, None]
        return at_horizons(np.concatenate([begin, rollout.predicted], axis=1))


def at_horizons(path: FloatArray) -> FloatArray:
    """Return samples (m, n, 3) from a start on, interpolated at the horizons: (m, 5, 3)."""
    return _interpolated(path, np.zeros(len(path), dtype=np.int64), SAMPLE_NS)


def _interpolated(path: FloatArray, offset_ns: IntArray, period_ns: int) -> FloatArray:
    """Return `path` (m, n, 3), whose first row is at 0, at `offset_ns` (m,) plus the horizons."""
    at = (offset_ns[:, None] + np.array(HORIZONS_S) * 1e9) / period_ns
    below = np.clip(np.floor(at + 1e-9).astype(int), 0, path.shape[1] - 2)
    share = (at - below)[:, :, None]
    every = np.arange(len(path))[:, None]
    return np.asarray(path[every, below] * (1.0 - share) + path[every, below + 1] * share)


def time_ours(predictor: KoopmanPredictor, record: Record) -> tuple[float, float]:
    """Return the median processor time of a tick, and of one with 2 s ahead, s."""
    running = Predictor(predictor.model, predictor.online, horizon_steps=0)
    ticks, rollouts = [], []
    for row in range(min(_TIMED_TICKS, len(record) - AHEAD)):
        sample = sample_at(record, row)
        started = time.process_time()
        prediction = running.step(sample)
        ticks.append(time.process_time() - started)
        if prediction is not None:
            running.rollout(record.u[row : row + AHEAD])
            rollouts.append(time.process_time() - started)
    return float(np.median(ticks)), float(np.median(rollouts)) if rollouts else float("nan")


def plan_of(recordings: Path, code: Path) -> LearnedPlan:
    """
    Return the plan for two folders.

    :raises UsageError: one is missing.
    """
    for option, folder in (("--recordings", recordings), ("--code", code)):
        if not folder.is_dir():
            raise UsageError(f"{option} {folder} is not a folder")
    return LearnedPlan(find_recordings(recordings), code)
