# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Nominal vehicle of a simulation: masses and dimensions, without tyres.

A file may leave out what a data sheet does not tell. Of the mass and the wheelbase the rest is
assumed as of a vehicle of that size (`plant.vehicle.vehicle_completion`), and identified from the
simulation where that tells.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr

from adk_ros.files.yaml_file import read, validate
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import time_scale
from adk_ros.plant.vehicle.vehicle_completion import completed_dimensions, completed_vehicle
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, Vehicle


class NominalVehicle(Dimensions):
    """Keys of `vehicle.yaml`, in SI units."""

    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    """Spin inertia of one wheel, kg m^2."""
    _assumed: frozenset[str] = PrivateAttr(default=frozenset())
    _is_simulated: bool = PrivateAttr(default=False)

    @property
    def assumed(self) -> frozenset[str]:
        """Names of the values that the file does not give."""
        return self._assumed

    @property
    def is_simulated(self) -> bool:
        """Whether the simulation was made from this vehicle, so that its mass is right."""
        return self._is_simulated

    def parameters(self) -> FloatArray:
        """Return the surrogate's parameters (SIZE,) of this vehicle with typical tyres."""
        p = default_parameters()
        for name, value in self.model_dump().items():
            p[INDEX[name]] = 4.0 * value if name == "wheel_inertia" else value
        for name in ("roll_frequency", "pitch_frequency"):
            p[INDEX[name]] /= time_scale(self.length_scale)
        return p


def nominal_vehicle_of(vehicle: Vehicle, *, is_simulated: bool = False) -> NominalVehicle:
    """
    Return the masses and dimensions of a vehicle.

    `is_simulated`: whether the simulation was made from it.
    """
    out = NominalVehicle(**{key: getattr(vehicle, key) for key in NominalVehicle.model_fields})
    out._is_simulated = is_simulated
    return out


def load_nominal_vehicle(path: str | Path) -> NominalVehicle:
    """
    Load a nominal vehicle from a YAML file, or a packaged one by its name.

    The file needs at least the mass and the wheelbase; `NominalVehicle.assumed` is what it lacks.

    :raises UsageError: the file is invalid; one line with file and key.
    """
    name, content = read(path, "vehicle")
    whole = Vehicle.model_fields.keys() - NominalVehicle.model_fields.keys()
    if not whole.isdisjoint(content):
        # A complete vehicle file of `adk simulate`: tyres, or further keys such as drag.
        filled = completed_vehicle(name, content, Vehicle)
        return nominal_vehicle_of(validate(name, filled, Vehicle))
    return _completed(name, content)


def _completed(name: str, content: dict[str, Any]) -> NominalVehicle:
    """Return a vehicle with the values that its file leaves out."""
    filled = completed_dimensions(name, content, NominalVehicle)
    vehicle = validate(name, filled, NominalVehicle)
    vehicle._assumed = frozenset(filled) - frozenset(content)
    return vehicle
