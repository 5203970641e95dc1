# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Values that a vehicle file leaves out, assumed as of a vehicle of that mass and wheelbase.

- Yaw inertia m l_f l_r: the dynamic index of road vehicles is close to one (T. D. Gillespie,
  "Fundamentals of Vehicle Dynamics", 1992, chapter 6).
- Centre of gravity, track width, its height and the wheel radius in the shares of the wheelbase
  that the car of the defaults has (2.7 m; 1.3, 1.6, 0.53 and 0.325 m).
- Of a scale model also everything else: the defaults of the full-size car, scaled by dynamic
  similarity (`numerics.similarity`), with the mass of the file.
"""

from __future__ import annotations

from typing import Any

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.similarity import (
    REFERENCE_MASS,
    REFERENCE_WHEELBASE,
    length_scale,
)
from adk_ros.plant.vehicle.chassis import Chassis

_Scales = dict[str, tuple[float, int]]
"""Key -> exponents of the scales of lengths and of masses by which its default scales."""

WHEELBASE = "wheelbase"
"""Key that may stand for the two distances of the axles from the centre of gravity."""
DISTANCES = ("cg_to_front_axle", "cg_to_rear_axle")
_WHEELBASE_RANGE = (0.05, 20.0)
"""m, from a 1:50 model to a road train's tractor."""
_FRONT_SHARE = 1.3 / REFERENCE_WHEELBASE
_TRACK_WIDTH = 1.6
"""m, of a car with `REFERENCE_WHEELBASE`."""
_IN_SHARES = ("cg_height", "wheel_radius")
"""Keys whose defaults are those of a car with `REFERENCE_WHEELBASE`."""
_BODY: _Scales = {
    "side_force_area": (2.0, 0),
    "yaw_moment_volume": (3.0, 0),
    "wheel_inertia": (2.0, 1),
}
_VEHICLE: _Scales = {
    "load_lag": (0.5, 0),
    "cda": (2.0, 0),
    "max_drive_torque": (1.0, 1),
    "max_brake_torque": (1.0, 1),
    "torque_lag": (0.5, 0),
    "steer_lag": (0.5, 0),
}
_TYRE: _Scales = {
    "nominal_load": (0.0, 1),
    "relaxation_length": (1.0, 0),
    "relaxation_length_x": (1.0, 0),
}
_CHASSIS: _Scales = {
    "roll_centre_front": (1.0, 0),
    "roll_centre_rear": (1.0, 0),
    "travel": (1.0, 0),
    "lift_area_front": (2.0, 0),
    "lift_area_rear": (2.0, 0),
    "brake_lag": (0.5, 0),
}


def completed_vehicle(
    name: str, content: dict[str, Any], model: type[FileModel]
) -> dict[str, Any]:
    """
    Return the content of a complete vehicle file with what it leaves out.

    `model`: the vehicle's, which has the defaults of the full-size car.

    :raises UsageError: the wheelbase is there without the mass, or contradicts the axles.
    """
    known = "mass" in content and content.keys() >= set(DISTANCES)
    required = {key for key, field in model.model_fields.items() if field.is_required()}
    if WHEELBASE not in content and (content.keys() >= required or not known):
        # Complete, or so incomplete that the keys say what is missing.
        filled = dict(content)
    else:
        filled = completed_dimensions(name, content, model)
    size = _size(filled)
    if size == 1.0:
        return filled
    defaults = _defaults(model)
    _fill_shares(filled, defaults)
    heavy = float(filled["mass"]) / REFERENCE_MASS
    _fill(filled, defaults, _BODY | _VEHICLE, size, heavy)
    for axle in ("front_tyre", "rear_tyre"):
        tyre = filled.get(axle, {})
        if isinstance(tyre, dict):
            whole = defaults[axle]
            filled[axle] = {**whole.model_dump(include=whole.model_fields_set), **tyre}
            _fill(filled[axle], whole.model_dump(), _TYRE, size, heavy)
    chassis = {} if filled.get("chassis") is None else filled["chassis"]
    if isinstance(chassis, dict):
        filled["chassis"] = dict(chassis)
        _fill(filled["chassis"], _defaults(Chassis), _CHASSIS, size, heavy)
    return filled


def completed_dimensions(
    name: str, content: dict[str, Any], model: type[FileModel]
) -> dict[str, Any]:
    """
    Return masses and dimensions of a vehicle file with what it leaves out.

    `model` has the defaults of the full-size car.

    :raises UsageError: it has no mass or no wheelbase, or they contradict each other.
    """
    if "mass" not in content:
        raise UsageError(f"{name}: mass: missing; a vehicle file needs the mass and the wheelbase")
    if WHEELBASE not in content and not content.keys() >= set(DISTANCES):
        raise UsageError(
            f"{name}: {WHEELBASE}: missing; give it, or cg_to_front_axle and cg_to_rear_axle"
        )
    given = dict(content)
    for key in ("mass", *DISTANCES):
        if key in given and not _is_number(given[key]):
            raise UsageError(f"{name}: {key}: expected a number, got {given[key]!r:.40}")
    wheelbase = given.pop(WHEELBASE, None)
    filled = {**given, **_axles(name, given, wheelbase)}
    front, rear = (filled[key] for key in DISTANCES)
    if min(front, rear, filled["mass"]) <= 0.0:
        return filled
    filled.setdefault("yaw_inertia", float(filled["mass"] * front * rear))
    size = _size(filled)
    if "track_width" not in given or "yaw_inertia" not in given or size != 1.0:
        # A full-size file with all required keys keeps the defaults of the others.
        _fill_shares(filled, _defaults(model))
    if size != 1.0:
        heavy = float(filled["mass"]) / REFERENCE_MASS
        _fill(filled, _defaults(model), _BODY, size, heavy)
    return filled


def _defaults(model: type[FileModel]) -> dict[str, Any]:
    return {key: field.default for key, field in model.model_fields.items()}


def _fill_shares(content: dict[str, Any], defaults: dict[str, Any]) -> None:
    """Add lengths that a vehicle has in the shares of its wheelbase."""
    wheelbase = float(content[DISTANCES[0]]) + float(content[DISTANCES[1]])
    lengths = {"track_width": _TRACK_WIDTH} | {key: defaults[key] for key in _IN_SHARES}
    for key, length in lengths.items():
        content.setdefault(key, float(length / REFERENCE_WHEELBASE * wheelbase))


def _fill(
    content: dict[str, Any], defaults: dict[str, Any], scales: _Scales, size: float, mass: float
) -> None:
    """Add scaled defaults."""
    for key, (of_length, of_mass) in scales.items():
        content.setdefault(key, float(defaults[key] * size**of_length * mass**of_mass))


def _size(content: dict[str, Any]) -> float:
    """Return the scale of lengths of a vehicle file; 1 where it is not that of a vehicle."""
    values: list[Any] = [content.get(key) for key in ("mass", *DISTANCES)]
    if not all(_is_number(value) and value > 0.0 for value in values):
        return 1.0
    return length_scale(float(values[1]) + float(values[2]))


def _axles(name: str, given: dict[str, Any], wheelbase: Any) -> dict[str, Any]:
    """
    Return the distances of the axles from the centre of gravity that are not given.

    :raises UsageError: the wheelbase is no length, or contradicts the distances.
    """
    if wheelbase is None:
        return {}
    low, high = _WHEELBASE_RANGE
    if not _is_number(wheelbase) or not low <= wheelbase <= high:
        raise UsageError(f"{name}: {WHEELBASE}: expected a number of {low:g} to {high:g} m")
    known = {key: given[key] for key in DISTANCES if key in given}
    if len(known) == 2:
        if abs(sum(known.values()) - wheelbase) > 0.005 * wheelbase:
            raise UsageError(
                f"{name}: {WHEELBASE} is {wheelbase:g} m, but cg_to_front_axle and "
                f"cg_to_rear_axle add up to {sum(known.values()):g} m: correct one of them"
            )
        return {}
    if known and max(known.values()) >= wheelbase:
        raise UsageError(f"{name}: {next(iter(known))} is not below the {WHEELBASE}: correct it")
    front = known.get(DISTANCES[0])
    if front is None:
        rear = known.get(DISTANCES[1])
        front = _FRONT_SHARE * wheelbase if rear is None else wheelbase - rear
    return {
        key: float(value)
        for key, value in zip(DISTANCES, (front, wheelbase - front), strict=True)
        if key not in given
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
