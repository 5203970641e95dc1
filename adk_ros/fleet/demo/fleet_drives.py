# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate the drives of a synthetic fleet, and the simulation that they are compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.demo.fleet_plan import FleetPlan, PlannedDrive
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle, nominal_vehicle_of
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.recording.simulated_sensors import simulate_faulty_sensors
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import ROAD_X, ROAD_Y, RoadPatch, Route, Segment
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.injected_drive import simulate_injected_drive
from adk_ros.plant.injection.injectors import changed_vehicle, plant_changes
from adk_ros.plant.scenario.random_routes import ROAD_STYLES, plan_route, random_route, spins
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

TOLERANCE = 0.004
"""Largest build tolerance drawn, relative: the prior deviation of the analysis."""
_BIAS = (0.003, 0.003, 1e-4)
"""Deviation of a car's IMU bias: a_x, a_y (m/s²), yaw rate (rad/s); half the analysis' prior."""
_MAP_SPACING_M = 5000.0
"""Distance between the routes in the map frame, m: more than a route's size."""
_LATERAL = 4.2
"""Lateral acceleration of the drivers on the routes, m/s²."""
_LATERAL_SIMULATED = 4.6
"""The same of the simulation, which must be driven at least as hard."""
_FURTHER_S = 120.0
"""Duration of a further drive of the simulation, s. By choice."""
_PLACE_KEYS = {
    "road_grade": ("grade", "grade"),
    "road_bank": ("bank", "bank"),
    "low_friction": ("mu", "mu_scale"),
}
_BLEND_M = 16.0
_PATH_SPACING_M = 10.0
"""Distance of the points that describe where a place is, m."""
_SLOWER, _TRIES = 0.9, 6
"""Speed factor from one try to the next without a spin, and most tries."""


@dataclass(frozen=True)
class Car:
    """A built car: its vehicle with tolerances, and the bias of its IMU (3,)."""

    vehicle: Vehicle
    bias: FloatArray


class FleetDrives:
    """The cars and routes of a plan, and their drives."""

    def __init__(self, plan: FleetPlan) -> None:
        self.plan = plan
        self.vehicle = load_vehicle(plan.vehicle)
        rng = np.random.default_rng([plan.seed, 182])
        styles = ("track", "town")
        self._styles = [ROAD_STYLES[styles[i % 2]] for i in range(plan.size.routes + 1)]
        self._segments = [random_route(rng, style) for style in self._styles]
        names = sorted({drive.car for drive in plan.drives})
        self.cars = {name: self._built(rng) for name in names}

    @property
    def nominal(self) -> NominalVehicle:
        """Masses and lengths of the simulated car."""
        return nominal_vehicle_of(self.vehicle)

    def _built(self, rng: np.random.Generator) -> Car:
        values = self.vehicle.model_dump()
        names = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle", "cda", "crr")
        for name in (*names, "wheel_radius"):
            values[name] *= 1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)
        for axle in ("front_tyre", "rear_tyre"):
            for name in ("mu", "b_y"):
                values[axle][name] *= 1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)
        return Car(Vehicle.model_validate(values), np.array(_BIAS) * rng.standard_normal(3))

    def route(self, i: int, factor: float = 1.0, lateral: float = _LATERAL) -> Route:
        """Return route `i` with the place effect, if it is there, driven at a speed factor."""
        segments, length = self._segments[i]
        place, patches = self.plan.place, []
        if place.route == i:
            key, parameter = _PLACE_KEYS[place.effect]
            patches = [
                RoadPatch.model_validate(
                    {
                        "start": place.begin * length,
                        "end": place.end * length,
                        "blend": _BLEND_M,
                        key: place.parameters[parameter],
                    }
                )
            ]
        return plan_route(segments, patches, self._styles[i], lateral, factor)

    def place_path(self) -> FloatArray:
        """Return points (n, 2) of the road that has the place effect, in the map frame, m."""
        place = self.plan.place
        route = self.route(place.route)
        rows = route.table.shape[0] - 1
        first, last = math.floor(place.begin * rows), math.ceil(place.end * rows)
        step = max(1, round(_PATH_SPACING_M / route.spacing))
        path = route.table[first : last + 1 : step, [ROAD_X, ROAD_Y]]
        path[:, 0] += _map_offset(place.route)
        return path

    def simulation(self) -> SensorLog:
        """Return the simulation: the nominal car on a separate road, without noise."""
        i = self.plan.size.routes
        segments: list[Segment] = self._segments[i][0]
        route = plan_route(segments, [], self._styles[i], _LATERAL_SIMULATED)
        return self._simulated(
            "simulation", route, self.plan.seed + 7, self.plan.size.simulation_s
        )

    def further_simulation(self, i: int) -> SensorLog:
        """Return a further drive of the simulation: the nominal car on route `i` of the fleet."""
        route = plan_route(self._segments[i][0], [], self._styles[i], _LATERAL)
        return self._simulated(f"route_{i + 1}", route, self.plan.seed + 8 + i, _FURTHER_S)

    def _simulated(self, name: str, route: Route, seed: int, duration_s: float) -> SensorLog:
        """Return a drive of the nominal car, without noise."""
        truth, commands, _ = simulate_injected_drive(
            self.vehicle, self.vehicle, route, InjectedChanges(), seed, duration_s
        )
        return simulate_faulty_sensors(name, truth, commands, {}, None)

    def drive(self, planned: PlannedDrive) -> SensorLog:
        """Return the recording of a planned drive; slower, if the car spins."""
        car = self.cars[planned.car]
        effects = self.plan.effects_of(planned)
        changes = plant_changes(effects, {}, 0.0)
        for tried in range(_TRIES):
            route = self.route(planned.route, _SLOWER**tried)
            truth, commands, _ = simulate_injected_drive(
                self.vehicle,
                changed_vehicle(car.vehicle, effects),
                route,
                changes,
                planned.seed,
                planned.duration_s,
                start=planned.start * route.length,
            )
            if not spins(truth[:, 4]):
                break
        effects.setdefault("imu_bias", dict(zip(("ax", "ay", "gyro"), car.bias, strict=True)))
        rng = np.random.default_rng([planned.seed, 183])
        log = simulate_faulty_sensors(planned.name, truth, commands, effects, rng)
        log.pose[:, 0] += _map_offset(planned.route)
        return replace(log, name=planned.name)


def _map_offset(route: int) -> float:
    """Return the x of a route's start in the map frame, m."""
    return _MAP_SPACING_M * (1 + route)
