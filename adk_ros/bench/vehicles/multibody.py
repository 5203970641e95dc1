# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The multi-body model of commonroad-vehicle-models, compiled, with parameters that differ by axle.

It has 29 states: body and axles on springs, wheels with spin, and tyres of the Magic Formula with
combined slip and camber (Althoff and Wuersching, "CommonRoad: Vehicle Models"; BSD licence). No
equation of it is from this package. Its source is compiled as it is, except that the tyres of
front and rear axle get parameters of their own. The limits of its acceleration input are lifted:
they scale with the mass, so that more mass would also mean more power.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import re
import threading
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numba  # type: ignore[import-untyped, unused-ignore]

from adk_ros.errors import UsageError
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.plant.vehicle.vehicle_parameters import Tyre, Vehicle

MULTI_BODY = "multi_body"
"""Name of the plant in labels."""
_PACKAGE = "vehiclemodels"
_TYRES_IN_SOURCE = 16
"""Uses of the tyre parameters in the model's source: four functions, four wheels."""
_UNLIMITED = 1e6
_LOCK = threading.Lock()


class Model(NamedTuple):
    """Compiled `rates(state, (steering rate, acceleration), parameters)`, and `start_state`."""

    rates: Any
    start_state: Callable[[list[float], Any], list[float]]


@dataclass(frozen=True)
class MultibodyVehicle:
    """Parameters of the model by name: body, tyres of both axles; drag area m², rolling drag."""

    body: dict[str, float]
    front: dict[str, float]
    rear: dict[str, float]
    cda: float = 0.0
    crr: float = 0.0

    def changed(
        self,
        body: dict[str, float] | None = None,
        front: dict[str, float] | None = None,
        rear: dict[str, float] | None = None,
    ) -> MultibodyVehicle:
        """Return the vehicle with parameters replaced."""
        return replace(
            self,
            body=self.body | (body or {}),
            front=self.front | (front or {}),
            rear=self.rear | (rear or {}),
        )

    def nominal(self) -> NominalVehicle:
        """Return masses and lengths as a vehicle file states them."""
        return NominalVehicle(**{
            name: getattr(self.equivalent(), name) for name in NominalVehicle.model_fields
        })  # fmt: skip

    def equivalent(self) -> Vehicle:
        """
        Return a vehicle of this package with the same masses, lengths and slip stiffness.

        The driver's model, and the constants of injected changes. B = K / (C D), with K per load;
        static loads of the model are those of the sprung mass plus equal unsprung masses.
        """
        p = self.body
        wheelbase = p["a"] + p["b"]
        tyres = []
        for t, arm, unsprung in ((self.front, p["b"], p["m_uf"]), (self.rear, p["a"], p["m_ur"])):
            load_ratio = (p["m_s"] * arm / wheelbase + unsprung) / (p["m"] * arm / wheelbase)
            b_y = -t["p_ky1"] / (t["p_cy1"] * t["p_dy1"]) * load_ratio
            tyres.append(
                Tyre(mu=t["p_dy1"], b_y=b_y, c_y=t["p_cy1"], e_y=t["p_ey1"], load_sensitivity=0.0)
            )
        return Vehicle(
            name=MULTI_BODY, mass=p["m"], yaw_inertia=p["I_z"], cg_to_front_axle=p["a"],
            cg_to_rear_axle=p["b"], track_width=p["T_f"], cg_height=p["h_cg"],
            wheel_radius=p["R_w"], wheel_inertia=p["I_y_w"], front_tyre=tyres[0],
            rear_tyre=tyres[1], cda=self.cda, crr=self.crr, side_force_area=0.0,
            yaw_moment_volume=0.0, max_steer=1.0,
        )  # fmt: skip

    def parameters(self) -> Any:
        """Return the parameters in the form of the compiled model: nested named tuples."""
        body, tyre, steering, longitudinal = _tuples()
        limits = base_parameters()
        return body(
            **self.body,
            tire_front=tyre(**self.front),
            tire_rear=tyre(**self.rear),
            steering=steering(**_numbers(limits.steering)),
            longitudinal=longitudinal(**_numbers(limits.longitudinal) | {"a_max": _UNLIMITED}),
        )


def is_installed() -> bool:
    """Return whether commonroad-vehicle-models is installed."""
    return importlib.util.find_spec(_PACKAGE) is not None


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(f"{_PACKAGE}.{name}")
    except ImportError:
        raise UsageError(
            "the multi-body cases need the package commonroad-vehicle-models: "
            "`pip install commonroad-vehicle-models`, or choose other cases with --only"
        ) from None


@cache
def base_parameters() -> Any:
    """
    Return the model's parameter set 2, a BMW 320i.

    :raises UsageError: commonroad-vehicle-models is not installed.
    """
    return _module("parameters_vehicle2").parameters_vehicle2()


def base_vehicle() -> MultibodyVehicle:
    """Return the vehicle of parameter set 2."""
    p = base_parameters()
    tyre = _numbers(p.tire)
    return MultibodyVehicle(_numbers(p), tyre, dict(tyre))


def _numbers(parameters: Any) -> dict[str, float]:
    """Return the numeric fields of a parameter object."""
    return {
        name: float(value)
        for name, value in vars(parameters).items()
        if isinstance(value, int | float)
    }


@cache
def _tuples() -> tuple[Any, Any, Any, Any]:
    """Return the named tuples of body, tyre, steering and longitudinal parameters."""
    p = base_parameters()
    parts = ("tire_front", "tire_rear", "steering", "longitudinal")
    return (
        namedtuple("MultibodyParameters", [*_numbers(p), *parts]),
        namedtuple("TyreParameters", list(_numbers(p.tire))),
        namedtuple("SteeringParameters", list(_numbers(p.steering))),
        namedtuple("LongitudinalParameters", list(_numbers(p.longitudinal))),
    )


def model() -> Model:
    """
    Return the compiled model.

    :raises UsageError: commonroad-vehicle-models is not installed, or is another version.
    """
    with _LOCK:
        return _model()


@cache
def _model() -> Model:
    tyre_names: dict[str, Any] = {"math": math}
    tyre_source = _module("utils.tire_model")
    tyre_names["sign"] = _compiled(tyre_source.sign, tyre_names)
    tyre = ModuleType("multibody_tyre")
    for name in (
        "formula_longitudinal",
        "formula_lateral",
        "formula_longitudinal_comb",
        "formula_lateral_comb",
    ):
        setattr(tyre, name, _compiled(getattr(tyre_source, name), tyre_names))
    names: dict[str, Any] = {"math": math, "tireModel": tyre}
    for name in ("steering_constraints", "acceleration_constraints", "vehicle_dynamics_ks_cog"):
        names[name] = _compiled(getattr(_module(f"utils.{name}"), name), names)
    function = _module("vehicle_dynamics_mb").vehicle_dynamics_mb
    exec(_with_two_tyres(inspect.getsource(function)), names)
    compiled = numba.njit(error_model="numpy")(names[function.__name__])
    return Model(compiled, _module("init_mb").init_mb)


def _compiled(function: Any, names: dict[str, Any]) -> Any:
    """Compile a copy of a function that refers to compiled ones by `names`."""
    copy = FunctionType(function.__code__, names, function.__name__)
    return numba.njit(error_model="numpy")(copy)


def _with_two_tyres(source: str) -> str:
    """Return the model's source with the tyre parameters of the axle that a line is about."""
    lines = source.splitlines()
    uses = [i for i, line in enumerate(lines) if line.rstrip().endswith("p.tire)")]
    for i in uses:
        axle = "front" if re.search(r"_[LR]F\b", lines[i]) else "rear"
        lines[i] = lines[i].replace("p.tire)", f"p.tire_{axle})")
    if len(uses) != _TYRES_IN_SOURCE:
        raise UsageError(
            f"commonroad-vehicle-models uses its tyre parameters {len(uses)} times, not "
            f"{_TYRES_IN_SOURCE}: install the version that requirements/test.txt names"
        )
    return "\n".join(lines)
