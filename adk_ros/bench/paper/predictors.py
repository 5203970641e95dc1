# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Predictors of the tables that are no libraries of others, and one pass of any over a test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.paper.cases import AHEAD
from adk_ros.bench.paper.contract import BenchPredictor
from adk_ros.model.evaluate import sample_at
from adk_ros.model.model import Model
from adk_ros.model.online import OnlineSettings
from adk_ros.model.predictor import Predictor
from adk_ros.plant.floor import floor_rollout
from adk_ros.plant.heard import Drive
from adk_ros.signals.channels import FloatArray, IntArray, Record
from adk_ros.signals.score import HORIZON_STEPS, imu_integration, persistence, straight_line

DK, ALDK, RLS, FFRLS, SWLS = "DK", "ALDK", "ALDK-RLS", "ALDK-FFRLS", "ALDK-SWLS"
MF, MF_TUNED = "7 DoF-MF", "7 DoF-MF tuned"
OURS, FLOOR = "adk_ros", "floor (the plant)"
LINEAR, LINEAR_ADAPTED = "least squares", "least squares, adapted"
PYKOOP, PYKOOPMAN = "pykoop", "pykoopman"
NAIVE = ("persistence", "straight line", "IMU integration")
PAPERS = (DK, MF, ALDK, RLS, FFRLS, SWLS)
"""The paper's own, in its order."""
ORDER = (
    *PAPERS, MF_TUNED, *NAIVE, LINEAR, LINEAR_ADAPTED, PYKOOP, PYKOOPMAN, OURS, FLOOR,
)  # fmt: skip
"""As the tables list them."""
METHODS = {ALDK: "constant", RLS: "rls", FFRLS: "ffrls", SWLS: "swls"}

Tell = Callable[[float], None]
_TOLD_EVERY = 500


@dataclass(frozen=True)
class Passed:
    """
    What a predictor said on its way through a test, SI.

    `one` (n, 3) of the rows' next ticks, `ahead` (m, 80, 3) from the starts, and, of one that
    says how sure it is, the `variance` (m, 5, 3) it gave there to its errors by horizon.
    """

    one: FloatArray
    ahead: FloatArray
    variance: FloatArray | None = None


@dataclass(frozen=True)
class Naive:
    """One of those that need no model."""

    name: str

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`."""
        functions = dict(zip(NAIVE, (persistence, straight_line, imu_integration), strict=True))
        return functions[self.name](record, rows, ahead)


@dataclass(frozen=True)
class Floor:
    """The plant itself from the same measurements; the test begins at row `begin` of the drive."""

    drive: Drive
    begin: int
    name: str = FLOOR

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`, but that it knows the plant."""
        return floor_rollout(self.drive, rows + self.begin, record.x[rows], ahead)


@dataclass(frozen=True)
class Koopman:
    """A trained model, adapted by `online` as it goes."""

    name: str
    model: Model
    online: OnlineSettings | None = None

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`; its steps are 1 to `AHEAD`."""
        return self.run(record, rows[:0], rows).ahead[:, :ahead]

    def run(
        self, record: Record, rows: IntArray, starts: IntArray, tell: Tell | None = None
    ) -> Passed:
        """
        Go through the record once: one-step predictions at `rows`, roll-outs from `starts`.

        One step is the same either way: it is made under the command in force, which is known.
        """
        one = np.full((len(record), 3), np.nan)
        last = int(max(rows[-1] if rows.size else -1, starts[-1] if starts.size else -1))
        ahead = np.full((starts.size, AHEAD, 3), np.nan)
        variance = np.full((starts.size, len(HORIZON_STEPS), 3), np.nan)
        place = np.full(len(record), -1)
        place[starts] = np.arange(starts.size)
        index = np.array(HORIZON_STEPS) - 1
        predictor = Predictor(self.model, self.online, horizon_steps=0)
        for row in range(last + 1):
            prediction = predictor.step(sample_at(record, row))
            if tell is not None and row % _TOLD_EVERY == 0:
                tell(row / (last + 1))
            if prediction is None:
                continue
            one[row] = prediction.x
            if place[row] >= 0:
                ahead[place[row]] = predictor.roll_out(record.u[row : row + AHEAD])
                table = predictor.horizon_covariance
                if len(table) >= AHEAD:
                    variance[place[row]] = np.diagonal(table[index], axis1=1, axis2=2)
        return Passed(one[rows], ahead, variance if np.isfinite(variance).any() else None)


def run(
    predictor: BenchPredictor | Koopman,
    record: Record,
    rows: IntArray,
    starts: IntArray,
    tell: Tell | None = None,
) -> Passed:
    """Take a predictor through a test."""
    if isinstance(predictor, Koopman):
        return predictor.run(record, rows, starts, tell)
    one = predictor.predict(record, rows, 1)[:, 0]
    return Passed(one, predictor.predict(record, starts, AHEAD))
