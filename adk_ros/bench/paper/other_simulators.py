# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Test drives in simulators of other families than the one of the training drive.

A sprung car with brush tyres (`plant.injection.sprung_car`) and the multi-body model of
commonroad-vehicle-models (`bench.vehicles.multibody`), which share no equation with the 14-DoF
vehicle. Car, route and speed are drawn from a seed; the road is flat and dry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.bench.vehicles.vehicle_family import Drive, family_of
from adk_ros.plant.injection.injected_changes import STEPS_PER_COMMAND, InjectedChanges
from adk_ros.plant.scenario.random_routes import ROAD_STYLES, random_route, slower_routes, spins
from adk_ros.signals.channels import TICK_NS, Record

SPRUNG_CAR = "spring_car"
DESCRIPTIONS = {
    SPRUNG_CAR: "sprung car with brush tyres, about 2.1 t",
    MULTI_BODY: "multi-body model of commonroad-vehicle-models, about 1.2 t",
}
_V_Y = 4
_STATE, _FORCE = [3, _V_Y, 2], [0, 1]
"""Columns of the truth: v_x, v_y, yaw rate; a_x, a_y."""


@dataclass(frozen=True)
class OtherDrive:
    """A drive of `seconds` of a random car in a simulator, a key of `DESCRIPTIONS`."""

    plant: str
    style: str
    seed: int
    seconds: float

    def truth(self, name: str, seconds: float | None = None) -> Record:
        """
        Simulate the drive; `seconds`: another duration.

        :raises UsageError: the multi-body model is not installed.
        :raises DataError: the car spins at every speed that is tried.
        """
        duration = self.seconds if seconds is None else seconds
        rng = np.random.default_rng(self.seed)
        roads = ROAD_STYLES[self.style]
        family = family_of(self.plant)
        car = family.random_vehicle(rng, True)
        segments, _ = random_route(rng, roads)
        lateral = float(rng.uniform(*roads.lateral))
        for route, _ in slower_routes(name, segments, [], roads, lateral):
            drive = Drive(route, InjectedChanges(), self.seed, duration)
            truth, commands = family.drive(car, car, drive)
            if not spins(truth[:, _V_Y]):
                break
        ticks = truth[::STEPS_PER_COMMAND]
        n = min(len(ticks), len(commands))
        x, zeros = ticks[:n, _STATE], np.zeros(n, dtype=np.int64)
        stamps = np.arange(n, dtype=np.int64) * TICK_NS
        return Record(
            stamps, x, commands[:n].copy(), ticks[:n, _FORCE], zeros, x.copy(), zeros.copy(), name
        )
