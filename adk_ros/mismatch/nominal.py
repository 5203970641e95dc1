# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nominal vehicle of a simulation: masses and lengths, without tyres."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from adk_ros.mismatch.parameters import INDEX, usual
from adk_ros.plant.params import Dimensions, Vehicle
from adk_ros.plant.yaml_file import read, validate
from adk_ros.signals.channels import FloatArray


class Nominal(Dimensions):
    """Keys of `vehicle.yaml`; SI units."""

    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    """Of one wheel, kg m^2."""

    def parameters(self) -> FloatArray:
        """Return the parameter vector of this vehicle on middling tyres."""
        p = usual()
        for name, value in self.model_dump().items():
            p[INDEX[name]] = 4.0 * value if name == "wheel_inertia" else value
        return p


def nominal_of(vehicle: Vehicle) -> Nominal:
    """Return the masses and lengths of a vehicle."""
    return Nominal(**{key: getattr(vehicle, key) for key in Nominal.model_fields})


def load_nominal(path: str | Path) -> Nominal:
    """
    Load a nominal vehicle from a YAML file, or of one of the package's own, by file or name.

    Raises `UsageError`, one line naming the file and the key.
    """
    name, content = read(path, "vehicle")
    whole = Vehicle.model_fields.keys() - Nominal.model_fields.keys()
    if isinstance(content, dict) and not whole.isdisjoint(content):
        # A whole car, as `adk simulate` takes it: it may say of its tyres, or of its drag alone.
        return nominal_of(validate(name, content, Vehicle))
    return validate(name, content, Nominal)
