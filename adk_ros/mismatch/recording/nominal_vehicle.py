# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nominal vehicle of a simulation: masses and lengths, without tyres."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from adk_ros.files.yaml_file import read, validate
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, Vehicle


class NominalVehicle(Dimensions):
    """Keys of `vehicle.yaml`; SI units."""

    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    """Of one wheel, kg m^2."""

    def parameters(self) -> FloatArray:
        """Return the parameter vector of this vehicle on middling tyres."""
        p = default_parameters()
        for name, value in self.model_dump().items():
            p[INDEX[name]] = 4.0 * value if name == "wheel_inertia" else value
        return p


def nominal_vehicle_of(vehicle: Vehicle) -> NominalVehicle:
    """Return the masses and lengths of a vehicle."""
    return NominalVehicle(**{key: getattr(vehicle, key) for key in NominalVehicle.model_fields})


def load_nominal_vehicle(path: str | Path) -> NominalVehicle:
    """
    Load a nominal vehicle from a YAML file, or of one of the package's own, by file or name.

    Raises `UsageError`, one line naming the file and the key.
    """
    name, content = read(path, "vehicle")
    whole = Vehicle.model_fields.keys() - NominalVehicle.model_fields.keys()
    if isinstance(content, dict) and not whole.isdisjoint(content):
        # A whole car, as `adk simulate` takes it: it may say of its tyres, or of its drag alone.
        return nominal_vehicle_of(validate(name, content, Vehicle))
    return validate(name, content, NominalVehicle)
