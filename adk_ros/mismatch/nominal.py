# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nominal vehicle of a simulation: masses and lengths, without tyres."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from adk_ros.mismatch.parameters import INDEX, usual
from adk_ros.plant.params import Vehicle
from adk_ros.plant.yaml_file import FileModel, read, validate
from adk_ros.signals.channels import FloatArray


class Nominal(FileModel):
    """Keys of `vehicle.yaml`; SI units. `wheel_inertia` is of one wheel."""

    mass: float = Field(ge=50.0, le=1e5)
    yaw_inertia: float = Field(ge=10.0, le=1e6)
    cg_to_front_axle: float = Field(ge=0.2, le=10.0)
    cg_to_rear_axle: float = Field(ge=0.2, le=10.0)
    track_width: float = Field(ge=0.3, le=5.0)
    cg_height: float = Field(default=0.53, ge=0.0, le=4.0)
    wheel_radius: float = Field(default=0.325, ge=0.1, le=1.5)
    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    side_force_area: float = Field(default=3.2, ge=0.0, le=100.0)
    yaw_moment_volume: float = Field(default=1.1, ge=-100.0, le=100.0)

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
