# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Nominal vehicle of a simulation: masses and dimensions, without tyres.

A file may leave out what a data sheet does not tell. Of the mass and the wheelbase the rest is
assumed as of a vehicle of that size, and identified from the simulation where that tells:

- yaw inertia m l_f l_r: the dynamic index of road vehicles is close to one (T. D. Gillespie,
  "Fundamentals of Vehicle Dynamics", 1992, chapter 6);
- centre of gravity, track width, its height and the wheel radius in the shares of the wheelbase
  that the car of the defaults has (2.7 m; 1.3, 1.6, 0.53 and 0.325 m).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import read, validate
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, Vehicle

WHEELBASE = "wheelbase"
"""Key that may stand for the two distances of the axles from the centre of gravity."""
_FRONT_SHARE = 1.3 / 2.7
_SHARES_OF_WHEELBASE = {
    "track_width": 1.6 / 2.7,
    "cg_height": 0.53 / 2.7,
    "wheel_radius": 0.325 / 2.7,
}
_DISTANCES = ("cg_to_front_axle", "cg_to_rear_axle")


class NominalVehicle(Dimensions):
    """Keys of `vehicle.yaml`, in SI units."""

    wheel_inertia: float = Field(default=1.3, ge=0.0, le=100.0)
    """Spin inertia of one wheel, kg m^2."""
    _assumed: frozenset[str] = PrivateAttr(default=frozenset())

    @property
    def assumed(self) -> frozenset[str]:
        """Names of the values that the file does not give."""
        return self._assumed

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

    The file needs at least the mass and the wheelbase; `NominalVehicle.assumed` is what it lacks.

    :raises UsageError: the file is invalid; one line with file and key.
    """
    name, content = read(path, "vehicle")
    whole = Vehicle.model_fields.keys() - NominalVehicle.model_fields.keys()
    if not whole.isdisjoint(content):
        # A complete vehicle file of `adk simulate`: tyres, or further keys such as drag.
        return nominal_vehicle_of(validate(name, content, Vehicle))
    if "mass" not in content:
        raise UsageError(f"{name}: mass: missing; a vehicle file needs the mass and the wheelbase")
    if WHEELBASE not in content and not content.keys() >= set(_DISTANCES):
        raise UsageError(
            f"{name}: {WHEELBASE}: missing; give it, or cg_to_front_axle and cg_to_rear_axle"
        )
    return _completed(name, content)


def _completed(name: str, content: dict[str, Any]) -> NominalVehicle:
    """Return a vehicle with the values that its file leaves out."""
    given = dict(content)
    for key in ("mass", *_DISTANCES):
        if key in given and not _is_number(given[key]):
            raise UsageError(f"{name}: {key}: expected a number, got {given[key]!r:.40}")
    wheelbase = given.pop(WHEELBASE, None)
    filled = {**given, **_axles(name, given, wheelbase)}
    front, rear = (filled[key] for key in _DISTANCES)
    if min(front, rear, filled["mass"]) > 0.0:
        filled.setdefault("yaw_inertia", float(filled["mass"] * front * rear))
        if "track_width" not in given or "yaw_inertia" not in given:
            # A file with all required keys keeps the defaults of the others.
            for key, share in _SHARES_OF_WHEELBASE.items():
                filled.setdefault(key, float(share * (front + rear)))
    vehicle = validate(name, filled, NominalVehicle)
    vehicle._assumed = frozenset(filled) - frozenset(given)
    return vehicle


def _axles(name: str, given: dict[str, Any], wheelbase: Any) -> dict[str, Any]:
    """
    Return the distances of the axles from the centre of gravity that are not given.

    :raises UsageError: the wheelbase is no length, or contradicts the distances.
    """
    if wheelbase is None:
        return {}
    if not _is_number(wheelbase) or not 0.4 <= wheelbase <= 20.0:
        raise UsageError(f"{name}: {WHEELBASE}: expected a number of 0.4 to 20 m")
    known = {key: given[key] for key in _DISTANCES if key in given}
    if len(known) == 2:
        if abs(sum(known.values()) - wheelbase) > 0.005 * wheelbase:
            raise UsageError(
                f"{name}: {WHEELBASE} is {wheelbase:g} m, but cg_to_front_axle and "
                f"cg_to_rear_axle add up to {sum(known.values()):g} m: correct one of them"
            )
        return {}
    if known and max(known.values()) >= wheelbase:
        raise UsageError(f"{name}: {next(iter(known))} is not below the {WHEELBASE}: correct it")
    front = known.get(_DISTANCES[0])
    if front is None:
        rear = known.get(_DISTANCES[1])
        front = _FRONT_SHARE * wheelbase if rear is None else wheelbase - rear
    return {
        key: float(value)
        for key, value in zip(_DISTANCES, (front, wheelbase - front), strict=True)
        if key not in given
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
