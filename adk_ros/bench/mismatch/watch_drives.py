# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives for the watch: cars of the generated cases, with an effect that sets in while they drive.

The surrogate model is identified from a drive of the nominal vehicle; the car that is watched has
build tolerances. Nothing of the surrogate model is in the plants.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from adk_ros.bench.vehicles.vehicle_family import Drive, family_of
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.recording.simulated_sensors import simulate_faulty_sensors
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.injectors import FULL, plant_changes, scale_strength
from adk_ros.plant.scenario.random_routes import (
    ROAD_STYLES,
    plan_route,
    random_route,
    slower_routes,
    spins,
)
from adk_ros.signals.channels import Reading, Source

SIMULATED_S = 150.0
"""Duration of the simulation that the surrogate model is identified from, s."""

EVENTS: dict[str, str] = {
    "payload on": "payload",
    "front tyres lose pressure": "front_tyre_stiffness",
    "rear tyres lose pressure": "rear_tyre_stiffness",
    "a brake drags": "brake_drag_one_side",
    "rain": "low_friction",
    "IMU tilted": "imu_tilt",
    "steering lags": "steering_lag",
}
"""Event on the road -> effect of the catalogue, of the size in `injectors.FULL`."""


_Stamped = tuple[int, int, int, list[float]]


@dataclass(frozen=True)
class WatchedDrive:
    """
    A drive to watch; `effect` with `strength` sets in at `onset_s`, unless it is empty.

    `family`: first number of all seeds, so that the drives of different purposes share none.
    """

    plant: str
    family: int
    seed: int
    seconds: float
    road_style: str = "track"
    effect: str = ""
    strength: float = 1.0
    onset_s: float = 0.0
    effects: dict[str, dict[str, float]] = field(default_factory=dict)

    def injected(self) -> dict[str, dict[str, float]]:
        """Return the effects with their parameters."""
        if not self.effect:
            return self.effects
        return {self.effect: scale_strength(self.effect, self.strength, FULL[self.effect])}

    def simulate(self) -> tuple[SurrogateModel, SensorLog]:
        """Return the surrogate model of the nominal car, and the drive of the real one."""
        rng = np.random.default_rng([self.family, self.seed])
        family, roads = family_of(self.plant), ROAD_STYLES[self.road_style]
        vehicle = family.random_vehicle(rng, False)
        simulated, _ = random_route(rng, roads)
        segments, _ = random_route(rng, roads)
        lateral = float(rng.uniform(*roads.lateral))
        drive_seed = int(rng.integers(1 << 30))
        route = plan_route(simulated, [], roads, lateral)
        drive = Drive(route, InjectedChanges(), drive_seed, SIMULATED_S)
        truth, commands = family.drive(vehicle, vehicle, drive)
        simulation = simulate_faulty_sensors("simulation", truth, commands, {}, None)
        surrogate, _ = surrogate_of(
            simulation, simulation, family.nominal(vehicle), lambda done, text: None
        )
        built = family.with_tolerances(rng, vehicle)
        effects = self.injected()
        car = family.changed(built, effects)
        friction = effects.get("low_friction", {}).get("mu_scale", 1.0)
        changes = plant_changes(effects, {}, self.onset_s)
        for route, later in slower_routes("drive", segments, [], roads, lateral, friction):
            drive = Drive(route, changes, drive_seed + 1, self.seconds, 0.0, built, later)
            truth, commands = family.drive(vehicle, car, drive)
            if not spins(truth[:, 4]):
                break
        log = simulate_faulty_sensors(
            "drive", truth, commands, as_sensor_faults(effects), rng, 1.0, self.onset_s
        )
        return surrogate, log


def as_sensor_faults(effects: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Return the effects with a tilt as a bias: the simulated sensors give a bias an onset."""
    if "imu_tilt" not in effects:
        return effects
    tilt = effects["imu_tilt"]
    bias = {
        "ax": -GRAVITY * float(np.sin(tilt["pitch"])),
        "ay": GRAVITY * float(np.sin(tilt["roll"])),
        "gyro": 0.0,
    }
    return {**{k: v for k, v in effects.items() if k != "imu_tilt"}, "imu_bias": bias}


def readings_of(log: SensorLog) -> Iterator[tuple[Reading, tuple[float, float, float] | None]]:
    """Yield the readings of a log in the order of their stamps, odometry with its pose."""
    offset_ns = log.start_ns + 1_000_000_000

    def stamped(source: Source, at_s: FloatArray, values: FloatArray) -> Iterator[_Stamped]:
        stamps = offset_ns + np.round(at_s * 1e9).astype(np.int64)
        for i, (stamp, row) in enumerate(zip(stamps.tolist(), values.tolist(), strict=True)):
            yield stamp, int(source), i, row

    streams = (
        stamped(Source.IMU, log.imu_s, log.imu),
        stamped(Source.ODOMETRY, log.odometry_s, np.column_stack([log.odometry, log.pose])),
        stamped(Source.COMMAND, log.command_s, log.command),
    )
    for stamp, source, _, row in heapq.merge(*streams):
        reading = Reading(Source(source), stamp, tuple(row[:3]))
        yield reading, (row[3], row[4], row[5]) if source == Source.ODOMETRY else None
