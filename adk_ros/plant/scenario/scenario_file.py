# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scenario files (YAML): vehicle, route, driver, duration and sensors of a simulated drive.

Lengths, speeds and torques are those for a full-size car. A scale model drives the similar
scenario: the same accelerations on a route of its size (`numerics.similarity`), in the same
duration.

A file may name another one as its `base` and then holds only the differences: mappings are merged
key by key, lists are replaced.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import FileModel, packaged, read, validate, with_replacements
from adk_ros.numerics.similarity import REFERENCE_MASS, time_scale
from adk_ros.plant.environment.elevation import Height, Undulation
from adk_ros.plant.environment.road import RoadPatch, Route, Segment, build_route, similar_route
from adk_ros.plant.environment.wind import Wind
from adk_ros.plant.scenario.driver import Excitation, SpeedPlan, plan_speed
from adk_ros.plant.scenario.sensors import Sensors
from adk_ros.plant.scenario.swept_sine import SweptSine
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

_BASES_MAX = 8
"""Longest chain of `base` files; a longer one is taken for a cycle."""
_REFERENCE_RADIUS = 0.325
"""m, wheel radius of the car that the scenarios' torques are meant for."""


class Scenario(FileModel):
    """
    Everything that determines a simulated drive, besides the version of the package.

    `vehicle` names a packaged vehicle or a file (relative to the folder of the scenario);
    `vehicle_changes` replaces single parameters of it, with the keys of a vehicle file.
    """

    name: str = "unnamed"
    plant: Literal["seven_dof", "fourteen_dof"] = "fourteen_dof"
    vehicle: str = "imdv"
    vehicle_changes: dict[str, Any] = Field(default_factory=dict)
    duration_s: float = Field(gt=0.1, le=36000.0)
    seed: int = Field(default=0, ge=0)
    mu: float = Field(default=1.0, ge=0.05, le=1.5)
    """Friction of the road, a factor on the tyres' `mu`."""
    start: float = Field(default=0.0, ge=0.0)
    """Arc length of the start on the lap, m."""
    start_speed: float | None = Field(default=None, ge=0.0, le=80.0)
    """Initial speed, m/s; default: that of the speed plan."""
    wind: Wind = Wind()
    route: list[Segment] = Field(min_length=2)
    places: list[RoadPatch] = Field(default_factory=list)
    heights: list[Height] = Field(default_factory=list)
    """Height profile: a smooth curve through these points, periodic over the lap."""
    undulations: list[Undulation] = Field(default_factory=list)
    steering: SweptSine | None = None
    """Open-loop steering; the driver then controls only the speed."""
    speed: SpeedPlan = SpeedPlan()
    excitation: Excitation = Excitation()
    sensors: Sensors = Sensors()

    @model_validator(mode="after")
    def _period(self) -> Scenario:
        period_ms = 1000.0 / self.sensors.command.rate_hz
        if abs(period_ms - round(period_ms)) > 1e-9:
            raise ValueError("sensors.command.rate_hz must have a period of whole milliseconds")
        return self

    def car(self) -> Vehicle:
        """
        Return the vehicle with the changes applied.

        A change of a mapping, such as `front_tyre`, replaces only the keys that it names.
        :raises UsageError: an invalid vehicle; names file and key.
        """
        vehicle = load_vehicle(self.vehicle)
        if self.vehicle_changes:
            content = with_replacements(vehicle.model_dump(), self.vehicle_changes)
            vehicle = validate(f"{self.name}: vehicle_changes", content, Vehicle)
        if self.plant == "fourteen_dof":
            try:
                resolve(vehicle)
            except ValueError as error:
                raise UsageError(f"scenario {self.name}: vehicle: {error}") from None
        return vehicle

    def planned_route(self) -> Route:
        """
        Return the route, of the vehicle's size, with its speed plan.

        :raises UsageError: it does not close.
        """
        try:
            route = build_route(self.route, self.places, self.mu, self.heights, self.undulations)
            return similar_route(plan_speed(route, self.speed), self.car().length_scale)
        except ValueError as error:
            raise UsageError(f"scenario {self.name}: route: {error}") from None

    def similar(self, vehicle: Vehicle) -> Scenario:
        """Return the scenario with start, wind, excitation and resolution for a vehicle's size."""
        if (size := vehicle.length_scale) == 1.0:
            return self
        tempo = time_scale(size)
        torque = vehicle.mass * vehicle.wheel_radius / (REFERENCE_MASS * _REFERENCE_RADIUS)
        excitation, wind, command = self.excitation, self.wind, self.sensors.command
        changes: dict[str, Any] = {
            "start": size * self.start,
            "start_speed": None if self.start_speed is None else tempo * self.start_speed,
            "wind": wind.model_copy(
                update={key: tempo * getattr(wind, key) for key in ("x", "y", "gust")}
            ),
            "excitation": excitation.model_copy(
                update={
                    "torque": torque * excitation.torque,
                    "torque_step": torque * excitation.torque_step,
                    "steer_bandwidth_hz": excitation.steer_bandwidth_hz / tempo,
                    "torque_bandwidth_hz": excitation.torque_bandwidth_hz / tempo,
                }
            ),
            "sensors": self.sensors.model_copy(
                update={
                    "command": command.model_copy(
                        update={"torque_resolution": torque * command.torque_resolution}
                    )
                }
            ),
        }
        return self.model_copy(update=changes)


def scenarios() -> list[str]:
    """Return the names of the packaged scenarios."""
    return packaged("scenario")


def _read_with_bases(source: str | Path, depth: int = 0) -> tuple[str, dict[str, Any]]:
    """Return the name of a scenario for messages, and its content merged with its bases."""
    name, content = read(source, "scenario")
    folder = Path(source).parent
    vehicle = content.get("vehicle")
    if Path(source).is_file() and str(vehicle).endswith((".yaml", ".yml")):
        content["vehicle"] = str(folder / str(vehicle))
    base = content.pop("base", None)
    if base is None:
        return name, content
    if not isinstance(base, str):
        raise UsageError(f"{name}: base: give the name or the file of one scenario")
    if depth >= _BASES_MAX:
        raise UsageError(f"{name}: base: a cycle, or more than {_BASES_MAX} levels")
    is_file = Path(source).is_file() and base.endswith((".yaml", ".yml"))
    _, inherited = _read_with_bases(folder / base if is_file else base, depth + 1)
    inherited.pop("name", None)
    return name, with_replacements(inherited, content)


def load_scenario(source: str | Path) -> Scenario:
    """
    Load a scenario from a YAML file, or a packaged scenario by its name.

    `base`, the name or the file (relative to the folder of the scenario) of another scenario,
    supplies all keys that the file lacks. Vehicle and route are built once to check them.
    :raises UsageError: the content is invalid; one line that names the file and the key.
    """
    name, content = _read_with_bases(source)
    if {"mass", "front_tyre"} & content.keys() and "route" not in content:
        raise UsageError(
            f"{name}: this is a vehicle file; give a scenario, and name the file as its `vehicle`"
        )
    scenario = validate(name, content, Scenario)
    if scenario.name == "unnamed":
        scenario = scenario.model_copy(update={"name": Path(source).name.split(".")[0]})
    scenario.car()
    scenario.planned_route()
    return scenario
