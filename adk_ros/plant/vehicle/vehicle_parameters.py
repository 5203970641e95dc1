# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Vehicle parameters: the schema of a vehicle YAML file, and the flat form for the kernels.

SI units and radians throughout. The five parameters of the paper's Table 1 are required; all
others have defaults typical of a passenger car. A file may leave out more, and that of a scale
model gets defaults of its size (`vehicle_completion`).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, NamedTuple, TypeVar

from pydantic import Field, model_validator

from adk_ros.files.yaml_file import FileModel, packaged, read, validate
from adk_ros.numerics.similarity import length_scale, time_scale
from adk_ros.plant.vehicle.chassis import Chassis
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.vehicle_completion import completed_vehicle

_MAX_WHEEL_RATE = 2000.0
"""Natural frequency of a wheel's spin against its tyre, rad/s: the limit of stable RK4 at 1 ms
(stability bound 2.8 / step, with margin for combined slip)."""
_SLIP_SPEED_MIN, _LOAD_MIN = 2.0, 10.0
"""`Constants.slip_speed_min`, m/s, and `load_min`, N, of a full-size vehicle."""
_LEAST = {
    "mass": (50.0, 3),
    "yaw_inertia": (10.0, 5),
    "cg_to_front_axle": (0.2, 1),
    "cg_to_rear_axle": (0.2, 1),
    "track_width": (0.3, 1),
    "wheel_radius": (0.1, 1),
}
_LEAST_OF_WHEELS = {"wheel_inertia": (0.3, 5)}
_LEAST_OF_TYRES = {"nominal_load": (100.0, 3), "relaxation_length_x": (0.05, 1)}
"""
Least value of a full-size vehicle, and the exponent with which it falls with the scale of lengths:
a mass in tonnes is refused, that of a scale model is not.
"""

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
    nominal_load: float = Field(default=5000.0, gt=0.0, le=2e5)
    """Wheel load at which `mu` and the stiffness apply, N."""
    load_sensitivity: float = Field(default=0.1, ge=0.0, le=0.5)
    """Relative loss of friction and of stiffness per load when the load doubles."""
    relaxation_length: float = Field(default=0.35, ge=0.0, le=5.0)
    """Travelled distance over which the lateral force builds up, m."""
    relaxation_length_x: float = Field(default=0.15, gt=0.0, le=5.0)
    """
    The same for the longitudinal force, m. A longer one makes the equation of the wheel's spin
    numerically less stiff.
    """


D = TypeVar("D", bound="Dimensions")


class Dimensions(FileModel):
    """Masses, lengths and wind coefficients of a vehicle, without tyres and driveline; SI."""

    mass: float = Field(gt=0.0, le=1e5)
    yaw_inertia: float = Field(gt=0.0, le=1e6)
    cg_to_front_axle: float = Field(ge=0.01, le=10.0)
    cg_to_rear_axle: float = Field(ge=0.01, le=10.0)
    track_width: float = Field(gt=0.0, le=5.0)
    cg_height: float = Field(default=0.53, ge=0.0, le=4.0)
    wheel_radius: float = Field(default=0.325, gt=0.0, le=1.5)
    side_force_area: float = Field(default=3.2, ge=0.0, le=100.0)
    """Side force over dynamic pressure and sine of the aerodynamic sideslip, m²."""
    yaw_moment_volume: float = Field(default=1.1, ge=-100.0, le=100.0)
    """Yaw moment over the same, m³; positive if the wind turns the nose away from it."""

    @property
    def length_scale(self) -> float:
        """Scale of lengths of the vehicle: 1 if it is full-size (`numerics.similarity`)."""
        return length_scale(self.cg_to_front_axle + self.cg_to_rear_axle)

    @model_validator(mode="after")
    def _plausible_for_size(self: D) -> D:
        _check_least(self, _LEAST, self.length_scale)
        return self


class Vehicle(Dimensions):
    """Vehicle with wheel torques and front steering; `base_link` at the centre of gravity."""

    name: str = "unnamed"
    wheel_inertia: float = Field(default=1.3, gt=0.0, le=100.0)
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
        _check_least(self, _LEAST_OF_WHEELS, self.length_scale)
        for axle, tyre in (("front", self.front_tyre), ("rear", self.rear_tyre)):
            _check_least(tyre, _LEAST_OF_TYRES, self.length_scale, f"{axle}_tyre.")
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
        size = self.length_scale
        return Constants(
            length_scale=size,
            slip_speed_min=_SLIP_SPEED_MIN * time_scale(size),
            load_min=_LOAD_MIN * size**3,
            **vehicle,
            **front,
            **rear,
        )


def _check_least(
    part: FileModel, least: dict[str, tuple[float, int]], size: float, prefix: str = ""
) -> None:
    """Raise `ValueError` for a value that is too small for a vehicle of this scale of lengths."""
    for name, (of_full_size, exponent) in least.items():
        low = of_full_size * size**exponent
        if getattr(part, name) < low:
            raise ValueError(
                f"{prefix}{name} should be at least {low:.3g} for a vehicle of this wheelbase, "
                f"got {getattr(part, name):g}"
            )


class Constants(NamedTuple):
    """
    Flat, immutable parameters for the kernels: fields of `Vehicle`, tyres with `_f`, `_r`.

    `length_scale` of the vehicle (`numerics.similarity`); `slip_speed_min`: smallest rolling speed
    in the denominator of the slips, m/s; `load_min`: smallest wheel load, N.
    """

    length_scale: float
    slip_speed_min: float
    load_min: float
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

    The file needs at least the mass and the wheelbase (`vehicle_completion`).

    :raises UsageError: the content is invalid; one line that names the file and the key.
    """
    name, content = read(source, "vehicle")
    return validate(name, completed_vehicle(name, content, Vehicle), Vehicle)
