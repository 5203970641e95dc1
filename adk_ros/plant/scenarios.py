# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scenario, a YAML file: which car drives which route how, how long, seen by which sensors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from adk_ros.errors import UsageError
from adk_ros.plant.driver import Excitation, SpeedPlan, plan_speed
from adk_ros.plant.params import Vehicle, load_vehicle
from adk_ros.plant.road import Place, Route, Segment, build_route
from adk_ros.plant.sensors import Sensors
from adk_ros.plant.yaml_file import FileModel, load, packaged, validate


class Wind(FileModel):
    """Air that moves over the map, m/s, towards +x and +y."""

    x: float = Field(default=0.0, ge=-60.0, le=60.0)
    y: float = Field(default=0.0, ge=-60.0, le=60.0)


class Scenario(FileModel):
    """
    Everything that a drive depends on but the package's version.

    `vehicle` names a packaged vehicle or a file (relative to the scenario's own folder);
    `vehicle_changes` replaces single parameters of it, as keys of a vehicle file.
    """

    name: str = "unnamed"
    vehicle: str = "imdv"
    vehicle_changes: dict[str, Any] = Field(default_factory=dict)
    duration_s: float = Field(gt=0.1, le=36000.0)
    seed: int = Field(default=0, ge=0)
    mu: float = Field(default=1.0, ge=0.05, le=1.5)
    """Friction of the road, on which a tyre's `mu` is a factor."""
    start: float = Field(default=0.0, ge=0.0)
    """Where on the lap the drive starts, m."""
    wind: Wind = Wind()
    route: list[Segment] = Field(min_length=2)
    places: list[Place] = Field(default_factory=list)
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
        """Return the vehicle, changes applied; raises `UsageError` naming file and key."""
        vehicle = load_vehicle(self.vehicle)
        if not self.vehicle_changes:
            return vehicle
        content = vehicle.model_dump() | self.vehicle_changes
        return validate(f"{self.name}: vehicle_changes", content, Vehicle)

    def planned_route(self) -> Route:
        """Return the route with its speed plan; raises `UsageError` if it does not close."""
        try:
            return plan_speed(build_route(self.route, self.places, self.mu), self.speed)
        except ValueError as error:
            raise UsageError(f"scenario {self.name}: route: {error}") from None


def scenarios() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return packaged("scenario")


def load_scenario(source: str | Path) -> Scenario:
    """
    Load a scenario from a YAML file, or by the name of one that comes with the package.

    Its vehicle and route are made once, so that a bad file is refused here and not in the middle.
    Raises `UsageError`, one line naming the file and the key.
    """
    scenario = load(source, "scenario", Scenario)
    beside = Path(source).parent / scenario.vehicle
    if Path(source).is_file() and beside.suffix in {".yaml", ".yml"}:
        scenario = scenario.model_copy(update={"vehicle": str(beside)})
    if scenario.name == "unnamed":
        scenario = scenario.model_copy(update={"name": Path(source).name.split(".")[0]})
    scenario.car()
    scenario.planned_route()
    return scenario
