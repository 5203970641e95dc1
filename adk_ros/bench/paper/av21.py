# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Real recordings: adk_ros against the naive predictors on held-out data.

Training on the first 60 % of a recording (a tenth of it for validation); tests on its remaining
40 % and on each other recording as a whole. The reference is the non-causal (two-sided) smoothed
measurement; predictions start at rows whose history is learnable.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from adk_ros.bags.recording import read_recording
from adk_ros.bench.paper.cases import AHEAD, HISTORY
from adk_ros.bench.paper.predictors import ADK_ROS, NAIVE, KoopmanPredictor
from adk_ros.bench.paper.scores import CaseScore
from adk_ros.bench.paper.training_jobs import (
    BenchPlan,
    NoteProgress,
    Outcome,
    TrainingJob,
    train_default,
)
from adk_ros.errors import DataError
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.signals.channels import Record
from adk_ros.signals.score import HORIZON_STEPS, naive_predictions, scorable_rows, score

TRAINED_ON = 0.6
"""Share of a recording that is trained on."""
JUDGED = (2, 3, 4)
"""Indices of the horizons in the criterion: 0.5, 1 and 2 s."""
_STRIDE = 4
"""Rows between two rollouts."""


def find_recordings(folder: Path) -> tuple[Path, ...]:
    """
    Return the recordings below `folder`: rosbag2 folders, or files.

    :raises DataError: there is none.
    """
    bags = {path.parent for path in folder.rglob("metadata.yaml")}
    bags |= {
        path for path in folder.rglob("*")
        if path.suffix in (".mcap", ".db3", ".bag") and path.parent not in bags
    }  # fmt: skip
    if not bags:
        raise DataError(f"{folder} holds no recording: no .mcap, .db3 or .bag below it")
    return tuple(sorted(bags))


def recording_job(job: TrainingJob, plan: BenchPlan, folder: Path, tell: NoteProgress) -> Outcome:
    """Train on one recording and test on all; tests are named `trained on / tested on`."""
    outcome = Outcome(job)
    with outcome.clocked("reading"):
        records = [read_recording(path).record for path in plan.recordings]
    trained = next(i for i, path in enumerate(plan.recordings) if path.name == job.about)
    cut = int(TRAINED_ON * len(records[trained]))
    first, rest = records[trained].rows(slice(0, cut)), records[trained].rows(slice(cut, None))
    predictor = train_default(outcome, [first], plan, folder, tell)
    for i, record in enumerate(records):
        tested = rest if i == trained else record
        with outcome.clocked("predicting"):
            found = against_naive(predictor, tested)
        name = f"{job.about} / {plan.recordings[i].name}"
        outcome.scores += [(name, who, item) for who, item in found.items()]
    return outcome


def against_naive(predictor: KoopmanPredictor, record: Record) -> dict[str, CaseScore]:
    """
    Score adk_ros and the naive predictors from the same rows of a recording.

    :raises DataError: the record is too short.
    """
    rows = scorable_rows(record, HISTORY, AHEAD, _STRIDE)
    if not rows.size:
        raise DataError(f"{record.name}: no stretch of 2 s without a gap to test on")
    predictions: dict[str, FloatArray] = {ADK_ROS: predictor.predict(record, rows, AHEAD)}
    predictions |= naive_predictions(record, rows, AHEAD)
    return {name: _scored(record, rows, predicted) for name, predicted in predictions.items()}


def _scored(record: Record, rows: IntArray, predicted: FloatArray) -> CaseScore:
    item = score(record, rows, predicted)
    none = np.zeros((len(HORIZON_STEPS), 3), dtype=np.int64)
    count = np.full(len(HORIZON_STEPS), item.count)
    lost = np.full(len(HORIZON_STEPS), item.diverged)
    return CaseScore(item.rmse, item.worst, count, lost, none, none)


@dataclass(frozen=True)
class RecordingScores:
    """
    Scores by `trained on / tested on`: ratio to the best naive RMSE, mean over seeds, (5, 3).

    `rmse`: the mean RMSE by predictor, (5, 3) SI.
    """

    ratios: dict[str, FloatArray]
    rmse: dict[str, dict[str, FloatArray]] = field(default_factory=dict)

    @staticmethod
    def of(outcomes: list[Outcome]) -> RecordingScores:
        """Collect the scores of the jobs."""
        found: dict[str, dict[str, list[CaseScore]]] = {}
        for outcome in outcomes:
            for test, name, item in outcome.scores:
                found.setdefault(test, {}).setdefault(name, []).append(item)
        ratios: dict[str, FloatArray] = {}
        rmse: dict[str, dict[str, FloatArray]] = {}
        for test, by_name in found.items():
            mean = {
                name: np.asarray(np.mean([item.rmse for item in items], axis=0))
                for name, items in by_name.items()
            }
            best = np.min([mean[name] for name in NAIVE if name in mean], axis=0)
            ratios[test] = np.asarray(mean[ADK_ROS] / np.maximum(best, 1e-12))
            rmse[test] = mean
        return RecordingScores(ratios, rmse)

    def pairs(self, same: bool) -> dict[str, FloatArray]:
        """Return the ratios of tests on the same recording, or on another one."""
        return {
            name: table for name, table in self.ratios.items()
            if (len(set(name.split(" / "))) == 1) == same
        }  # fmt: skip
