# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Recordings of a real car: our default against the naive predictors, on what it has not seen.

Trained on the first 60 % of a recording, a tenth of that spread over it to validate on, tested on
the rest; and on the whole of each other recording. There is no truth: all is scored against the
measurement with hindsight, from rows whose past may be learned from.
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
JUDGED = (2, 3, 4)
"""Horizons that count: 0.5, 1 and 2 s."""
_STRIDE = 4


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
    """Train on one recording; "tests" are `trained on / tested on`."""
    outcome = Outcome(job)
    with outcome.clocked("reading"):
        records = [read_recording(path).record for path in plan.recordings]
    own = next(i for i, path in enumerate(plan.recordings) if path.name == job.about)
    cut = int(TRAINED_ON * len(records[own]))
    first, rest = records[own].rows(slice(0, cut)), records[own].rows(slice(cut, None))
    predictor = train_default(outcome, [first], plan, folder, tell)
    for i, record in enumerate(records):
        tested = rest if i == own else record
        with outcome.clocked("predicting"):
            found = against_naive(predictor, tested)
        name = f"{job.about} / {plan.recordings[i].name}"
        outcome.scores += [(name, who, item) for who, item in found.items()]
    return outcome


def against_naive(predictor: KoopmanPredictor, record: Record) -> dict[str, CaseScore]:
    """
    Score ours and the naive predictors from the same rows of a recording.

    :raises DataError: the record is too short.
    """
    rows = scorable_rows(record, HISTORY, AHEAD, _STRIDE)
    if not rows.size:
        raise DataError(f"{record.name}: no stretch of 2 s without a gap to test on")
    said: dict[str, FloatArray] = {ADK_ROS: predictor.predict(record, rows, AHEAD)}
    said |= naive_predictions(record, rows, AHEAD)
    return {name: _scored(record, rows, predicted) for name, predicted in said.items()}


def _scored(record: Record, rows: IntArray, predicted: FloatArray) -> CaseScore:
    item = score(record, rows, predicted)
    none = np.zeros((len(HORIZON_STEPS), 3), dtype=np.int64)
    count = np.full(len(HORIZON_STEPS), item.count)
    lost = np.full(len(HORIZON_STEPS), item.diverged)
    return CaseScore(item.rmse, item.worst, count, lost, none, none)


@dataclass(frozen=True)
class RecordingScores:
    """
    By `trained on / tested on`: RMSE over the best naive one's, mean over seeds, (5, 3).

    `rmse`: the means themselves, by predictor, (5, 3) SI.
    """

    ratios: dict[str, FloatArray]
    rmse: dict[str, dict[str, FloatArray]] = field(default_factory=dict)

    @staticmethod
    def of(outcomes: list[Outcome]) -> RecordingScores:
        """Put together what the jobs found."""
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

    def pairs(self, own: bool) -> dict[str, FloatArray]:
        """Those tested on the rest of their own recording, or those tested on another."""
        return {
            name: table for name, table in self.ratios.items()
            if (len(set(name.split(" / "))) == 1) == own
        }  # fmt: skip
