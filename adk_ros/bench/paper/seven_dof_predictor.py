# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's 7 DoF-MF as a predictor, with nominal or with identified vehicle parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.bench.paper.last_readings import predict_from_new_readings
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.identification.identify_vehicle import actuator_state_history, identify_vehicle
from adk_ros.plant.identification.vehicle_rollout import rollout
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle
from adk_ros.signals.channels import Record

_BATCH = 4096
_HISTORY, _STRIDE = 8, 20
"""Rows before the first one compared, and from one to the next, as on the tests."""


@dataclass(frozen=True)
class SevenDof:
    """Seven-degree-of-freedom model with Magic Formula tyres, on a flat road of friction `mu`."""

    vehicle: Vehicle
    mu: float = 1.0
    name: str = "7 DoF-MF"

    @staticmethod
    def tuned(
        vehicle: Vehicle, records: Sequence[Record], mu: float = 1.0, name: str = "7 DoF-MF tuned"
    ) -> SevenDof:
        """
        Identify the vehicle on `records`, starting from `vehicle`.

        :raises DataError: too few rollouts fit into the records.
        """
        return SevenDof(identify_vehicle(vehicle, records, mu=mu).vehicle, mu, name)

    def without_resistances(self, name: str = "7 DoF-MF, no resistances") -> SevenDof:
        """
        Return the model without rolling and air resistance, as the paper's (section 4.2.2).

        The paper gives no longitudinal tyre model; that of the vehicle stays.
        """
        changes = {"crr": 0.0, "cda": 0.0, "side_force_area": 0.0, "yaw_moment_volume": 0.0}
        return SevenDof(self.vehicle.model_copy(update=changes), self.mu, name)

    def better_of(self, other: SevenDof, record: Record, ahead: int) -> SevenDof:
        """
        Return the one of two models with the smaller errors on `record`.

        Compared is the geometric mean of the RMSE ratios over channels and steps 1 and `ahead`.
        """
        rows = np.arange(_HISTORY, len(record) - ahead - 1)
        rows = rows[record.episode[rows - _HISTORY] == record.episode[rows + ahead]][::_STRIDE]
        logs = 0.0
        steps = (1, ahead)
        for sign, model in ((1.0, self), (-1.0, other)):
            predicted = model.predict(record, rows, ahead)
            for step in steps:
                error = predicted[:, step - 1] - record.x_ref[rows + step]
                logs += sign * float(np.log(np.nanmean(error**2, axis=0)).sum())
        return self if logs < 0.0 else other

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """
        As `BenchPredictor.predict`.

        At a row that repeats an old reading, the prediction from the last new one goes on.
        """
        constants = self.vehicle.constants()
        reached = actuator_state_history(constants, record)

        def predict(_: IntArray, starts: IntArray, steps: int) -> FloatArray:
            out = np.empty((starts.shape[0], steps, 3))
            for first in range(0, starts.size, _BATCH):
                begin = starts[first : first + _BATCH]
                commands = record.u[begin[:, None] + np.arange(steps)]
                out[first : first + _BATCH] = rollout(
                    constants, record.x[begin], commands, actuators=reached[begin], mu=self.mu
                )
            return out

        return predict_from_new_readings(record, rows, ahead, predict)
