# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Further rows of the tables that say where the errors of adk_ros come from.

| row | what it leaves out |
| --- | --- |
| `ALONE` | all that is learned online but the observer, and the naive predictors |
| `NOT_ADAPTED` | windowed least squares |
| `ORACLE_ESTIMATED` | the error of the model: the plant, restarted from the estimated state |

The oracle from the measurement has the error of the measured start, the one from the estimated
state that of the observer. On clean tests both are nearly exact, since the start is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.bench.paper.predictors import (
    ALONE,
    NOT_ADAPTED,
    ORACLE_ESTIMATED,
    KoopmanPredictor,
    OraclePredictor,
)
from adk_ros.model.evaluation import observed_states
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.uncertainty.fallback import Fallback
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.signals.channels import Record


def reduced_predictors(full: KoopmanPredictor) -> list[KoopmanPredictor]:
    """Return the trained predictor without windowed least squares, and the model alone."""
    model = full.model
    fixed = replace(full.online or model.online, method="constant")
    none = np.zeros(3)
    alone = replace(
        model,
        observer_gains=replace(model.observer_gains, slow_gain=none, fast_gain=none),
        # Without it no rollout is monitored, and nothing is learned from one.
        mean_square_change=np.zeros((0, 3)),
        fallback=Fallback.none(),
    )
    return [KoopmanPredictor(NOT_ADAPTED, model, fixed), KoopmanPredictor(ALONE, alone, fixed)]


@dataclass(frozen=True)
class EstimatedStartOracle:
    """
    The plant restarted from the state that the observer of adk_ros estimates.

    `begin`: row of the drive at which the test begins.
    """

    drive: SimulatedDrive
    begin: int
    model: KoopmanModel
    name: str = ORACLE_ESTIMATED

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`, with exact knowledge of the plant and its other states."""
        count = int(rows.max()) + 1 if rows.size else 0
        estimated = replace(record, x=observed_states(self.model, record, count))
        return OraclePredictor(self.drive, self.begin).predict(estimated, rows, ahead)
