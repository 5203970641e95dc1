# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Predictors of the tables, except those of other libraries, and one pass over a test."""

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
MF_PLAIN, MF_CHOSEN = "7 DoF-MF, no resistances", "7 DoF-MF, chosen"
ADK_ROS, ORACLE = "adk_ros", "oracle (the plant)"
ALONE, NOT_ADAPTED = "adk_ros, offline model alone", "adk_ros without least squares"
ORACLE_ESTIMATED = "oracle from the estimated state"
LINEAR, LINEAR_ADAPTED = "least squares", "least squares, adapted"
PYKOOP, PYKOOPMAN = "pykoop", "pykoopman"
NAIVE = ("persistence", "straight line", "IMU integration")
PAPERS = (DK, MF, ALDK, RLS, FFRLS, SWLS)
"""Predictors of the paper, in its order."""
ORDER = (
    *PAPERS, MF_PLAIN, MF_TUNED, MF_CHOSEN, *NAIVE, LINEAR, LINEAR_ADAPTED, PYKOOP, PYKOOPMAN,
    ALONE, NOT_ADAPTED, ADK_ROS, ORACLE_ESTIMATED, ORACLE,
)  # fmt: skip
"""Order of the predictors in the tables."""
NOT_COMPARED = (ALONE, NOT_ADAPTED, ORACLE_ESTIMATED, ORACLE)
"""Rows that explain the errors of adk_ros and are no competitors: see `error_sources`."""
ORACLES = (ORACLE, ORACLE_ESTIMATED)
METHODS = {ALDK: "constant", RLS: "rls", FFRLS: "ffrls", SWLS: "swls"}

Tell = Callable[[float], None]
_PROGRESS_STRIDE = 500


@dataclass(frozen=True)
class PredictionsOnTest:
    """
    Predictions of one predictor on a test, SI.

    `one` (n, 3): one step ahead of each row; `ahead` (m, 80, 3): rollouts from the starts;
    `variance` (m, 5, 3): predicted error variance by horizon, None if the predictor has none.
    `held` (m, 80, 3) and `held_variance` (m, 5, 3): the same with the commands held, as the node
    publishes it.
    """

    one: FloatArray
    ahead: FloatArray
    variance: FloatArray | None = None
    held: FloatArray | None = None
    held_variance: FloatArray | None = None


@dataclass(frozen=True)
class NaivePredictor:
    """A model-free predictor."""

    name: str

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`."""
        functions = dict(
            zip(NAIVE, (persistence, linear_extrapolation, imu_integration), strict=True)
        )
        return functions[self.name](record, rows, ahead)


@dataclass(frozen=True)
class OraclePredictor:
    """The plant restarted from the measurements; the test begins at row `begin` of the drive."""

    drive: SimulatedDrive
    begin: int
    name: str = ORACLE

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`, but with exact knowledge of the plant and its state."""
        return oracle_rollout(self.drive, rows + self.begin, record.x[rows], ahead)


@dataclass(frozen=True)
class KoopmanPredictor:
    """A trained Koopman model, adapted with `online`."""

    name: str
    model: KoopmanModel
    online: OnlineSettings | None = None

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`, up to `AHEAD` steps."""
        return self.run(record, rows[:0], rows).ahead[:, :ahead]

    def run(
        self, record: Record, rows: IntArray, starts: IntArray, tell: Tell | None = None
    ) -> PredictionsOnTest:
        """
        Process the record once: one-step predictions at `rows`, rollouts from `starts`.

        The first step of a rollout equals the one-step prediction: its command is known.
        """
        one = np.full((len(record), 3), np.nan)
        last = int(max(rows[-1] if rows.size else -1, starts[-1] if starts.size else -1))
        ahead = np.full((starts.size, AHEAD, 3), np.nan)
        variance = np.full((starts.size, len(HORIZON_STEPS), 3), np.nan)
        held, held_variance = np.full_like(ahead, np.nan), np.full_like(variance, np.nan)
        start_of_row = np.full(len(record), -1)
        start_of_row[starts] = np.arange(starts.size)
        index = np.array(HORIZON_STEPS) - 1
        predictor = Predictor(self.model, self.online, horizon_steps=AHEAD)
        for row in range(last + 1):
            prediction = predictor.step(sample_at(record, row))
            if tell is not None and row % _PROGRESS_STRIDE == 0:
                tell(row / (last + 1))
            if prediction is None:
                continue
            one[row] = prediction.x
            if start_of_row[row] >= 0:
                start = start_of_row[row]
                held[start] = prediction.horizon
                published = prediction.horizon_covariance[index]
                held_variance[start] = np.diagonal(published, axis1=1, axis2=2)
                ahead[start] = predictor.rollout(record.u[row : row + AHEAD])
                table = predictor.horizon_covariance
                if len(table) >= AHEAD:
                    variance[start] = np.diagonal(table[index], axis1=1, axis2=2)
        return PredictionsOnTest(
            one[rows],
            ahead,
            variance if np.isfinite(variance).any() else None,
            held,
            held_variance if np.isfinite(held_variance).any() else None,
        )


def run(
    predictor: BenchPredictor | KoopmanPredictor,
    record: Record,
    rows: IntArray,
    starts: IntArray,
    tell: Tell | None = None,
) -> PredictionsOnTest:
    """Run a predictor on a test."""
    if isinstance(predictor, KoopmanPredictor):
        return predictor.run(record, rows, starts, tell)
    one = predictor.predict(record, rows, 1)[:, 0]
    return PredictionsOnTest(one, predictor.predict(record, starts, AHEAD))
