# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's 7 DoF-MF as a predictor, with nominal or with identified vehicle parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.identification.identify_vehicle import actuator_state_history, identify_vehicle
from adk_ros.plant.identification.vehicle_rollout import rollout
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle
from adk_ros.signals.channels import Record

_BATCH = 4096


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

    def predict(self, record: Record, rows: IntArray, ahead: int) -> FloatArray:
        """As `BenchPredictor.predict`."""
        constants = self.vehicle.constants()
        at_start = actuator_state_history(constants, record)[rows]
        out = np.empty((rows.shape[0], ahead, 3))
        for first in range(0, rows.shape[0], _BATCH):
            part = slice(first, first + _BATCH)
            commands = record.u[rows[part, None] + np.arange(ahead)]
            out[part] = rollout(
                constants, record.x[rows[part]], commands, actuators=at_start[part], mu=self.mu
            )
        return out
