# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Predictors of the tables that are no libraries of others, and one pass of any over a test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.paper.cases import AHEAD
from adk_ros.bench.paper.predictor_protocol import BenchPredictor
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.evaluation import sample_at
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.scenario.oracle import oracle_rollout
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.signals.channels import Record
from adk_ros.signals.score import HORIZON_STEPS, imu_integration, linear_extrapolation, persistence

DK, ALDK, RLS, FFRLS, SWLS = "DK", "ALDK", "ALDK-RLS", "ALDK-FFRLS", "ALDK-SWLS"
MF, MF_TUNED = "7 DoF-MF", "7 DoF-MF tuned"
ADK_ROS, ORACLE = "adk_ros", "floor (the plant)"
LINEAR, LINEAR_ADAPTED = "least squares", "least squares, adapted"
PYKOOP, PYKOOPMAN = "pykoop", "pykoopman"
NAIVE = ("persistence", "straight line", "IMU integration")
PAPERS = (DK, MF, ALDK, RLS, FFRLS, SWLS)
"""The paper's own, in its order."""
ORDER = (
    *PAPERS, MF_TUNED, *NAIVE, LINEAR, LINEAR_ADAPTED, PYKOOP, PYKOOPMAN, ADK_ROS, ORACLE,
)  # fmt: skip
"""As the tables list them."""
METHODS = {ALDK: "constant", RLS: "rls", FFRLS: "ffrls", SWLS: "swls"}

Tell = Callable[[float], None]
_PROGRESS_STRIDE = 500


@dataclass(frozen=True)
class PredictionsOnTest:
    """
    What a predictor said on its way through a test, SI.

    `one` (n, 3) of the rows' next ticks, `ahead` (m, 80, 3) from the starts, and, of one that
    says how sure it is, the `variance` (m, 5, 3) it gave there to its errors by horizon.
    """

    one: FloatArray
    ahead: FloatArray
    variance: FloatArray | None = None


@dataclass(frozen=True)
class NaivePredictor:
    """One of those that need no model."""

    name: str

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`."""
        functions = dict(
            zip(NAIVE, (persistence, linear_extrapolation, imu_integration), strict=True)
        )
        return functions[self.name](record, rows, ahead)


@dataclass(frozen=True)
class OraclePredictor:
    """The plant itself from the same measurements; the test begins at row `begin` of the drive."""

    drive: SimulatedDrive
    begin: int
    name: str = ORACLE

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`, but that it knows the plant."""
        return oracle_rollout(self.drive, rows + self.begin, record.x[rows], ahead)


@dataclass(frozen=True)
class KoopmanPredictor:
    """A trained model, adapted by `online` as it goes."""

    name: str
    model: KoopmanModel
    online: OnlineSettings | None = None

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`; its steps are 1 to `AHEAD`."""
        return self.run(record, rows[:0], rows).ahead[:, :ahead]

    def run(
        self, record: Record, rows: IntArray, starts: IntArray, tell: Tell | None = None
    ) -> PredictionsOnTest:
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
            if tell is not None and row % _PROGRESS_STRIDE == 0:
                tell(row / (last + 1))
            if prediction is None:
                continue
            one[row] = prediction.x
            if place[row] >= 0:
                ahead[place[row]] = predictor.rollout(record.u[row : row + AHEAD])
                table = predictor.horizon_covariance
                if len(table) >= AHEAD:
                    variance[place[row]] = np.diagonal(table[index], axis1=1, axis2=2)
        return PredictionsOnTest(one[rows], ahead, variance if np.isfinite(variance).any() else None)


def run(
    predictor: BenchPredictor | KoopmanPredictor,
    record: Record,
    rows: IntArray,
    starts: IntArray,
    tell: Tell | None = None,
) -> PredictionsOnTest:
    """Take a predictor through a test."""
    if isinstance(predictor, KoopmanPredictor):
        return predictor.run(record, rows, starts, tell)
    one = predictor.predict(record, rows, 1)[:, 0]
    return PredictionsOnTest(one, predictor.predict(record, starts, AHEAD))
