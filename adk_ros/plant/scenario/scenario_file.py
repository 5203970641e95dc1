# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A scenario, a YAML file: which car drives which route how, how long, seen by which sensors.

A file may name another as its `base`: it then only says what is different, mappings key by key,
lists as a whole.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from adk_ros.errors import UsageError
from adk_ros.files.yaml_file import FileModel, packaged, read, validate, with_replacements
from adk_ros.plant.environment.elevation import Height, Undulation
from adk_ros.plant.environment.road import RoadPatch, Route, Segment, build_route
from adk_ros.plant.environment.wind import Wind
from adk_ros.plant.scenario.driver import Excitation, SpeedPlan, plan_speed
from adk_ros.plant.scenario.sensors import Sensors
from adk_ros.plant.scenario.swept_sine import SweptSine
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle

_BASES_MAX = 8


class Scenario(FileModel):
    """
    Everything that a drive depends on but the package's version.

    `vehicle` names a packaged vehicle or a file (relative to the scenario's own folder);
    `vehicle_changes` replaces single parameters of it, as keys of a vehicle file.
    """

    name: str = "unnamed"
    plant: Literal["seven_dof", "fourteen_dof"] = "fourteen_dof"
    vehicle: str = "imdv"
    vehicle_changes: dict[str, Any] = Field(default_factory=dict)
    duration_s: float = Field(gt=0.1, le=36000.0)
    seed: int = Field(default=0, ge=0)
    mu: float = Field(default=1.0, ge=0.05, le=1.5)
    """Friction of the road, on which a tyre's `mu` is a factor."""
    start: float = Field(default=0.0, ge=0.0)
    """Where on the lap the drive starts, m."""
    start_speed: float | None = Field(default=None, ge=0.0, le=80.0)
    """Speed there, m/s, from which the driver accelerates; else that of the speed plan."""
    wind: Wind = Wind()
    route: list[Segment] = Field(min_length=2)
    places: list[RoadPatch] = Field(default_factory=list)
    heights: list[Height] = Field(default_factory=list)
    """The road's profile: a smooth curve through these, closed over the lap."""
    undulations: list[Undulation] = Field(default_factory=list)
    steering: SweptSine | None = None
    """Open-loop steering instead of the driver's, who then minds the speed alone."""
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
        Return the vehicle, changes applied; raises `UsageError` naming file and key.

        A change of a mapping, such as `front_tyre`, replaces the keys that it names.
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
        """Return the route with its speed plan; raises `UsageError` if it does not close."""
        try:
            route = build_route(self.route, self.places, self.mu, self.heights, self.undulations)
            return plan_speed(route, self.speed)
        except ValueError as error:
            raise UsageError(f"scenario {self.name}: route: {error}") from None


def scenarios() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return packaged("scenario")


def _read_with_bases(source: str | Path, below: int = 0) -> tuple[str, dict[str, Any]]:
    """Return a scenario's name for messages and its content, that of its bases filled in."""
    name, content = read(source, "scenario")
    folder = Path(source).parent
    vehicle = content.get("vehicle")
    if Path(source).is_file() and str(vehicle).endswith((".yaml", ".yml")):
        content["vehicle"] = str(folder / str(vehicle))
    base = content.pop("base", None)
    if base is None:
        return name, content
    if not isinstance(base, str):
        raise UsageError(f"{name}: base: give one scenario's name or file")
    if below >= _BASES_MAX:
        raise UsageError(f"{name}: base: more than {_BASES_MAX} scenarios deep, or in a circle")
    beside = folder / base
    of_file = Path(source).is_file() and base.endswith((".yaml", ".yml"))
    _, inherited = _read_with_bases(beside if of_file else base, below + 1)
    inherited.pop("name", None)
    return name, with_replacements(inherited, content)


def load_scenario(source: str | Path) -> Scenario:
    """
    Load a scenario from a YAML file, or by the name of one that comes with the package.

    `base`, another scenario's name or file (relative to the scenario's own folder), holds where
    the file says nothing. Its vehicle and route are made once, so that a bad file is refused here
    and not in the middle. Raises `UsageError`, one line naming the file and the key.
    """
    scenario = validate(*_read_with_bases(source), Scenario)
    if scenario.name == "unnamed":
        scenario = scenario.model_copy(update={"name": Path(source).name.split(".")[0]})
    scenario.car()
    scenario.planned_route()
    return scenario
