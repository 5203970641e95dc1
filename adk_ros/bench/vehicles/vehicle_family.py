# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Families of simulated vehicles: random vehicle, build tolerances, injected effects, and drives.

The built-in simulators share their parameters (`BuiltInFamily`); the multi-body model of
commonroad-vehicle-models has its own (`MultibodyFamily`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from adk_ros.bench.vehicles import multibody, multibody_changes
from adk_ros.bench.vehicles.multibody import MULTI_BODY, MultibodyVehicle
from adk_ros.bench.vehicles.multibody_drive import simulate_multibody_drive
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle, nominal_vehicle_of
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import Route
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.injected_drive import simulate_injected_drive
from adk_ros.plant.injection.injectors import changed_vehicle
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle

TOLERANCE = 0.004
"""
Largest build tolerance drawn, relative: `criteria.TOLERANCE_SIGMA`, the prior standard deviation
of `adk mismatch`. The 1.2 % on its pages is the bound of the fit, three times as much.
"""

Effects = dict[str, dict[str, float]]


class Drive(NamedTuple):
    """A drive to simulate; `changes.onset` also switches from `before` and `route` to `later`."""

    route: Route
    changes: InjectedChanges
    seed: int
    seconds: float
    start: float = 0.0
    """Arc length of the start, m."""
    before: Any = None
    """The car before the onset; None: the same car."""
    later: Route | None = None
    """The road from the onset on; None: the same road."""


class VehicleFamily(Protocol):
    """What the generator of cases needs of a family; vehicles are objects of the family."""

    def random_vehicle(self, rng: np.random.Generator, windy: bool) -> Any:
        """Return a random vehicle; `windy`: with drag, without which a headwind has no effect."""

    def with_tolerances(self, rng: np.random.Generator, vehicle: Any) -> Any:
        """Return the vehicle with random build tolerances."""

    def changed(self, vehicle: Any, effects: Effects) -> Any:
        """Return the vehicle with all effects that are changes of its parameters."""

    def nominal(self, vehicle: Any) -> NominalVehicle:
        """Return masses and lengths of the vehicle."""

    def drive(self, driver: Any, car: Any, drive: Drive) -> tuple[FloatArray, FloatArray]:
        """Return truth and commands of a drive of `car`; `driver` is the driver's model of it."""


def family_of(plant: str) -> VehicleFamily:
    """Return the family of a plant."""
    return MultibodyFamily() if plant == MULTI_BODY else BuiltInFamily(plant)


@dataclass(frozen=True)
class BuiltInFamily:
    """Vehicles of this package, simulated by one of `injected_drive.PLANTS`."""

    plant: str

    def random_vehicle(self, rng: np.random.Generator, windy: bool) -> Vehicle:
        """
        Return a random vehicle.

        The ranges, by choice, are those of a passenger car of 2 t around the vehicle `imdv`.
        """
        u = rng.uniform
        tyre = {
            "mu": u(0.95, 1.1),
            "b_y": u(9.0, 11.0),
            "c_y": u(1.3, 1.5),
            "nominal_load": 5300.0,
            "load_sensitivity": u(0.05, 0.15),
            "relaxation_length": u(0.0, 0.35),
        }
        drag = bool(rng.random() < 0.6) or windy
        return Vehicle.model_validate(
            {
                "mass": u(1900.0, 2250.0),
                "yaw_inertia": u(3300.0, 3900.0),
                "cg_to_front_axle": u(1.26, 1.34),
                "cg_to_rear_axle": u(1.3, 1.42),
                "track_width": 1.7,
                "cg_height": u(0.49, 0.59),
                "wheel_radius": 0.325,
                "wheel_inertia": 1.3,
                "cda": 0.7 * drag,
                "crr": 0.01 * drag,
                "load_lag": u(0.0, 0.06),
                "torque_lag": u(0.0, 0.03),
                "steer_lag": u(0.0, 0.03),
                "front_tyre": tyre,
                "rear_tyre": {**tyre, "b_y": tyre["b_y"] * u(1.05, 1.2)},
            }
        )

    def with_tolerances(self, rng: np.random.Generator, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle with random build tolerances."""
        names = (
            "mass",
            "yaw_inertia",
            "cg_to_front_axle",
            "cg_to_rear_axle",
            "cda",
            "crr",
            "wheel_radius",
        )
        values = vehicle.model_dump()
        for name in names:
            values[name] *= 1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)
        for axle in ("front_tyre", "rear_tyre"):
            for name in ("mu", "b_y"):
                values[axle][name] *= 1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)
        return Vehicle.model_validate(values)

    def changed(self, vehicle: Vehicle, effects: Effects) -> Vehicle:
        """Return the vehicle with all effects that are changes of its parameters."""
        return changed_vehicle(vehicle, effects)

    def nominal(self, vehicle: Vehicle) -> NominalVehicle:
        """Return masses and lengths of the vehicle."""
        return nominal_vehicle_of(vehicle)

    def drive(self, driver: Vehicle, car: Vehicle, drive: Drive) -> tuple[FloatArray, FloatArray]:
        """Return truth and commands of a drive."""
        truth, commands, _ = simulate_injected_drive(
            driver, car, drive.route, drive.changes, drive.seed, drive.seconds, self.plant,
            drive.start, drive.before, drive.later,
        )  # fmt: skip
        return truth, commands


@dataclass(frozen=True)
class MultibodyFamily:
    """Vehicles of the multi-body model; their effects act always, on a flat and dry road."""

    def random_vehicle(self, rng: np.random.Generator, windy: bool) -> MultibodyVehicle:
        """
        Return the package's BMW 320i with other masses, lengths, tyres and drag.

        The ranges are by choice; the rear tyres are not softer, which keeps it stable at speed.
        """
        u = rng.uniform
        base = multibody.base_vehicle()
        p, tyre = base.body, base.front
        sprung = p["m_s"] * u(0.95, 1.2)
        mass = sprung + p["m_uf"] + p["m_ur"]
        stiffness, grip = tyre["p_ky1"] * u(0.9, 1.05), tyre["p_dy1"] * u(0.95, 1.05)
        drag = bool(rng.random() < 0.6) or windy
        vehicle = base.changed(
            {
                "m": mass,
                "m_s": sprung,
                "I_z": p["I_z"] * mass / p["m"] * u(0.95, 1.1),
                "a": p["a"] * u(0.98, 1.02),
                "b": p["b"] * u(0.98, 1.02),
            },
            {"p_ky1": stiffness, "p_dy1": grip},
            {"p_ky1": stiffness * u(1.0, 1.12), "p_dy1": grip},
        )
        return MultibodyVehicle(vehicle.body, vehicle.front, vehicle.rear, 0.6 * drag, 0.01 * drag)

    def with_tolerances(
        self, rng: np.random.Generator, vehicle: MultibodyVehicle
    ) -> MultibodyVehicle:
        """Return the vehicle with random build tolerances."""

        def drawn(values: dict[str, float], names: tuple[str, ...]) -> dict[str, float]:
            return {x: values[x] * (1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)) for x in names}

        body = drawn(vehicle.body, ("m_s", "I_z", "a", "b", "R_w"))
        body["m"] = vehicle.body["m"] + body["m_s"] - vehicle.body["m_s"]
        tyre = ("p_ky1", "p_dy1")
        built = vehicle.changed(body, drawn(vehicle.front, tyre), drawn(vehicle.rear, tyre))
        drag = drawn({"cda": vehicle.cda, "crr": vehicle.crr}, ("cda", "crr"))
        return MultibodyVehicle(built.body, built.front, built.rear, **drag)

    def changed(self, vehicle: MultibodyVehicle, effects: Effects) -> MultibodyVehicle:
        """Return the vehicle with all effects that are changes of its parameters."""
        return multibody_changes.changed_multibody(vehicle, effects)

    def nominal(self, vehicle: MultibodyVehicle) -> NominalVehicle:
        """Return masses and lengths of the vehicle."""
        return vehicle.nominal()

    def drive(
        self, driver: MultibodyVehicle, car: MultibodyVehicle, drive: Drive
    ) -> tuple[FloatArray, FloatArray]:
        """Return truth and commands of a drive."""
        return simulate_multibody_drive(
            driver, car, drive.route, drive.changes, drive.seed, drive.seconds, drive.start
        )
