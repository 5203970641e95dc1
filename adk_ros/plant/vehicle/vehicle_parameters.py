# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Vehicle parameters: the schema of a vehicle YAML file, and the flat form for the kernels.

SI units and radians throughout. The five parameters of the paper's Table 1 are required; all
others have defaults typical of a passenger car.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel, load, packaged
from adk_ros.plant.vehicle.chassis import Chassis
from adk_ros.plant.vehicle.sprung_mass import resolve

_MAX_WHEEL_RATE = 2000.0
"""Natural frequency of a wheel's spin against its tyre, rad/s: the limit of stable RK4 at 1 ms
(stability bound 2.8 / step, with margin for combined slip)."""

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Tyre(FileModel):
    """
    Magic Formula coefficients of the tyres of one axle: longitudinal `_x`, lateral `_y`.

    `D` is `mu` times the wheel load, reduced by the load sensitivity; the slip stiffness is
    `B C D`.
    """

    mu: float = Field(default=1.05, ge=0.05, le=3.0)
    """Peak force over wheel load at the nominal load, on a road of friction 1."""
    b_x: float = Field(default=12.0, ge=1.0, le=40.0)
    c_x: float = Field(default=1.6, ge=1.0, le=1.99)
    e_x: float = Field(default=-0.2, ge=-10.0, le=1.0)
    b_y: float = Field(default=10.5, ge=1.0, le=40.0)
    c_y: float = Field(default=1.4, ge=1.0, le=1.99)
    e_y: float = Field(default=-0.4, ge=-10.0, le=1.0)
    nominal_load: float = Field(default=5000.0, ge=100.0, le=2e5)
    """Wheel load at which `mu` and the stiffness apply, N."""
    load_sensitivity: float = Field(default=0.1, ge=0.0, le=0.5)
    """Relative loss of friction and of stiffness per load when the load doubles."""
    relaxation_length: float = Field(default=0.35, ge=0.0, le=5.0)
    """Travelled distance over which the lateral force builds up, m."""
    relaxation_length_x: float = Field(default=0.15, ge=0.05, le=5.0)
    """
    The same for the longitudinal force, m. A longer one makes the equation of the wheel's spin
    numerically less stiff.
    """


class Dimensions(FileModel):
    """Masses, lengths and wind coefficients of a vehicle, without tyres and driveline; SI."""

    mass: float = Field(ge=50.0, le=1e5)
    yaw_inertia: float = Field(ge=10.0, le=1e6)
    cg_to_front_axle: float = Field(ge=0.2, le=10.0)
    cg_to_rear_axle: float = Field(ge=0.2, le=10.0)
    track_width: float = Field(ge=0.3, le=5.0)
    cg_height: float = Field(default=0.53, ge=0.0, le=4.0)
    wheel_radius: float = Field(default=0.325, ge=0.1, le=1.5)
    side_force_area: float = Field(default=3.2, ge=0.0, le=100.0)
    """Side force over dynamic pressure and sine of the aerodynamic sideslip, m²."""
    yaw_moment_volume: float = Field(default=1.1, ge=-100.0, le=100.0)
    """Yaw moment over the same, m³; positive if the wind turns the nose away from it."""


class Vehicle(Dimensions):
    """Vehicle with wheel torques and front steering; `base_link` at the centre of gravity."""

    name: str = "unnamed"
    wheel_inertia: float = Field(default=1.3, ge=0.3, le=100.0)
    """Spin inertia of one wheel with its motor, kg·m²."""
    front_tyre: Tyre = Tyre(b_y=9.5)
    rear_tyre: Tyre = Tyre(b_y=11.5)
    roll_share_front: Share = 0.55
    """Front axle's share of the lateral load transfer (springs, anti-roll bars)."""
    load_lag: float = Field(default=0.05, ge=0.0, le=1.0)
    """Time constant of the wheel loads against the accelerations (body roll and pitch), s."""
    cda: float = Field(default=0.7, ge=0.0, le=20.0)
    """Drag area, m²."""
    crr: float = Field(default=0.012, ge=0.0, le=0.2)
    """Rolling resistance over wheel load."""
    max_drive_torque: float = Field(default=3000.0, gt=0.0, le=1e5)
    """Largest total drive torque of all motors, N·m."""
    max_brake_torque: float = Field(default=9000.0, gt=0.0, le=1e5)
    """Largest total brake torque of motors and brakes, N·m."""
    torque_split_front: Share = 0.5
    torque_lag: float = Field(default=0.03, ge=0.0, le=5.0)
    """Time constant of the motors' and brakes' response, s."""
    max_steer: float = Field(default=0.6, gt=0.0, le=1.2)
    """Largest road-wheel angle to either side, rad."""
    steer_lag: float = Field(default=0.03, ge=0.0, le=5.0)
    """Time constant of the steering actuator, s."""
    chassis: Chassis | None = None
    """Suspension and unsprung masses, used only by the fourteen-degree-of-freedom plant."""

    @model_validator(mode="after")
    def _resolvable(self) -> Vehicle:
        for axle, tyre in (("front", self.front_tyre), ("rear", self.rear_tyre)):
            stiffness = tyre.b_x * tyre.c_x * tyre.mu * max(tyre.nominal_load, 5.0 * self.mass)
            inertia = self.wheel_inertia * tyre.relaxation_length_x
            if self.wheel_radius * math.sqrt(stiffness / inertia) > _MAX_WHEEL_RATE:
                raise ValueError(
                    f"the {axle} wheels are too light for the stiffness of their tyres: raise "
                    f"wheel_inertia or {axle}_tyre.relaxation_length_x"
                )
        if self.chassis is not None:
            resolve(self)
        return self

    def chassis_or_default(self) -> Chassis:
        """Return the chassis section, or one without any value."""
        return Chassis() if self.chassis is None else self.chassis

    def constants(self) -> Constants:
        """Return the parameters in the flat form for the kernels."""
        vehicle = {name: getattr(self, name) for name in _VEHICLE_FIELDS}
        front = {f"{name}_f": getattr(self.front_tyre, name) for name in Tyre.model_fields}
        rear = {f"{name}_r": getattr(self.rear_tyre, name) for name in Tyre.model_fields}
        return Constants(**vehicle, **front, **rear)


class Constants(NamedTuple):
    """Flat, immutable parameters for the kernels: fields of `Vehicle`, tyres with `_f`, `_r`."""

    mass: float
    yaw_inertia: float
    cg_to_front_axle: float
    cg_to_rear_axle: float
    track_width: float
    cg_height: float
    wheel_radius: float
    wheel_inertia: float
    roll_share_front: float
    load_lag: float
    cda: float
    crr: float
    side_force_area: float
    yaw_moment_volume: float
    max_drive_torque: float
    max_brake_torque: float
    torque_split_front: float
    torque_lag: float
    max_steer: float
    steer_lag: float
    mu_f: float
    b_x_f: float
    c_x_f: float
    e_x_f: float
    b_y_f: float
    c_y_f: float
    e_y_f: float
    nominal_load_f: float
    load_sensitivity_f: float
    relaxation_length_f: float
    relaxation_length_x_f: float
    mu_r: float
    b_x_r: float
    c_x_r: float
    e_x_r: float
    b_y_r: float
    c_y_r: float
    e_y_r: float
    nominal_load_r: float
    load_sensitivity_r: float
    relaxation_length_r: float
    relaxation_length_x_r: float


_VEHICLE_FIELDS = tuple(name for name in Constants._fields if name in Vehicle.model_fields)


def vehicles() -> list[str]:
    """Return the names of the packaged vehicles."""
    return packaged("vehicle")


def load_vehicle(source: str | Path) -> Vehicle:
    """
    Load a vehicle from a YAML file, or a packaged vehicle by its name.

    :raises UsageError: the content is invalid; one line that names the file and the key.
    """
    return load(source, "vehicle", Vehicle)
