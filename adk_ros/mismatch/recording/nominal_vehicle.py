# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nominal vehicle of a simulation: masses and dimensions, without tyres."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from adk_ros.files.yaml_file import read, validate
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, Vehicle


class NominalVehicle(Dimensions):
    """Keys of `vehicle.yaml`, in SI units."""

    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    """Spin inertia of one wheel, kg m^2."""

    def parameters(self) -> FloatArray:
        """Return the surrogate's parameters (SIZE,) of this vehicle with typical tyres."""
        p = default_parameters()
        for name, value in self.model_dump().items():
            p[INDEX[name]] = 4.0 * value if name == "wheel_inertia" else value
        return p


def nominal_vehicle_of(vehicle: Vehicle) -> NominalVehicle:
    """Return the masses and dimensions of a vehicle."""
    return NominalVehicle(**{key: getattr(vehicle, key) for key in NominalVehicle.model_fields})


def load_nominal_vehicle(path: str | Path) -> NominalVehicle:
    """
    Load a nominal vehicle from a YAML file, or a packaged one by its name.

    :raises UsageError: the file is invalid; one line with file and key.
    """
    name, content = read(path, "vehicle")
    whole = Vehicle.model_fields.keys() - NominalVehicle.model_fields.keys()
    if isinstance(content, dict) and not whole.isdisjoint(content):
        # A complete vehicle file of `adk simulate`: tyres, or further keys such as drag.
        return nominal_vehicle_of(validate(name, content, Vehicle))
    return validate(name, content, NominalVehicle)
