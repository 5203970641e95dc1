# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Plan of a synthetic fleet: cars, recordings, tags, and the effects injected at each level.

Everything follows from a seed. Routes are common to the fleet; each has its own place in the map
frame. Sizes are shares (strengths) of those at which the benchmark injects effects
(`plant.injection.injectors.FULL`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.levels import CAR, CONDITION, RAMP, SHARED, Level
from adk_ros.plant.injection.injectors import scale_strength

DAYS = 60.0
"""Time that a fleet records, days. By choice: two months."""
OMISSIONS = (
    "aero_drag",
    "rolling_resistance",
    "front_tyre_stiffness",
    "rear_tyre_stiffness",
    "yaw_inertia",
    "steering_lag",
    "brake_torque_gain",
)
"""Effects that a simulator may lack, of which two are drawn."""
FAULTS = (
    "steering_offset",
    "gyro_scale",
    "cg_shift",
    "drive_torque_lag",
    "imu_delay",
    "payload",
    "odometry_filter",
)
"""Effects that a faulty car may have, of which some are drawn."""
DRIFT, DELAY = "brake_drag_one_side", "steering_delay"
"""A brake that drags more each week, and the delay of a software version."""
PLACES = ("road_grade", "road_bank", "low_friction")
OLD, NEW = "2.0", "2.1"
"""Software versions; the newer one delays the steering, in half of the recordings."""


@dataclass(frozen=True)
class FleetSize:
    """Numbers of a fleet, and the range of a recording's duration, s."""

    cars: int = 12
    recordings: int = 200
    durations_s: tuple[float, float] = (180.0, 600.0)
    simulation_s: float = 400.0
    routes: int = 5
    faulty: int = 3
    damaged: int = 5


FULL_SIZE = FleetSize()
QUICK_SIZE = FleetSize(8, 48, (90.0, 150.0), 300.0, 3, 3, 5)


@dataclass(frozen=True)
class InjectedTerm:
    """An effect with its parameters at full size of its level."""

    effect: str
    parameters: dict[str, float]
    level: Level


@dataclass(frozen=True)
class PlacedEffect:
    """A local effect on a route between two shares of its lap."""

    effect: str
    parameters: dict[str, float]
    route: int
    begin: float
    end: float


@dataclass(frozen=True)
class PlannedDrive:
    """A recording to simulate; `start`: share of the lap; `damage`: how its bag is spoilt."""

    name: str
    car: str
    day: float
    route: int
    start: float
    duration_s: float
    software: str
    tyres: str
    seed: int
    damage: str = ""

    @property
    def tags(self) -> dict[str, str]:
        """Tags of the recording in `fleet.csv`, apart from the car and the date."""
        return {"software": self.software, "tyres": self.tyres}


@dataclass(frozen=True)
class FleetPlan:
    """
    A fleet: its size, what is injected, and its recordings in the order of their days.

    `vehicle`: packaged vehicle of which the cars are built.
    """

    seed: int
    size: FleetSize
    terms: tuple[InjectedTerm, ...]
    place: PlacedEffect
    drives: tuple[PlannedDrive, ...]
    vehicle: str = "imdv"

    def without_effects(self) -> FleetPlan:
        """Return the same fleet with nothing injected: cars differ by their tolerances alone."""
        neutral = scaled(self.place.effect, self.place.parameters, 0.0)
        return replace(self, terms=(), place=replace(self.place, parameters=neutral))

    def effects_of(self, drive: PlannedDrive) -> dict[str, dict[str, float]]:
        """Return the effects that act in a drive, name -> parameters."""
        out = {}
        for term in self.terms:
            share = self.share(term.level, drive)
            if share > 0.0:
                out[term.effect] = scaled(term.effect, term.parameters, share)
        return out

    def share(self, level: Level, drive: PlannedDrive) -> float:
        """Return how much of a term acts in a drive, as `Level.design` does for recordings."""
        if level.car and level.car != drive.car:
            return 0.0
        if level.kind == CONDITION:
            return float(drive.tags[level.tag] == level.value)
        if level.kind == RAMP:
            # A damaged bag is no recording of the fleet: the last usable one has the full size.
            days = [d.day for d in self.drives if level.car in ("", d.car) and not d.damage]
            span = max(max(days, default=level.onset) - level.onset, 1e-9)
            return min(max(drive.day - level.onset, 0.0) / span, 1.0)
        return 1.0


def scaled(effect: str, parameters: dict[str, float], share: float) -> dict[str, float]:
    """Return the parameters of an effect at a share of their difference from neutral."""
    return scale_strength(effect, share, parameters)


DAMAGES = ("truncated", "random_bytes", "empty", "without_commands", "short")
"""Ways of spoiling a bag, in turn."""


def plan_fleet(seed: int, size: FleetSize = FULL_SIZE) -> FleetPlan:
    """Return the plan of a fleet; the same arguments give the same plan."""
    rng = np.random.default_rng([seed, 181])
    cars = [f"car{i + 1:02d}" for i in range(size.cars)]
    omissions = rng.choice(OMISSIONS, 2, replace=False)
    faults = rng.choice(FAULTS, size.faulty, replace=False)
    chosen = rng.choice(cars, size.faulty + 1, replace=False)

    def term(effect: str, strength: tuple[float, float], level: Level) -> InjectedTerm:
        parameters = scale_strength(effect, float(rng.uniform(*strength)))
        return InjectedTerm(effect, parameters, level)

    onset = float(rng.uniform(0.25, 0.5)) * DAYS
    terms = [term(str(effect), (0.1, 0.3), Level(SHARED)) for effect in omissions]
    terms += [
        term(str(effect), (0.4, 0.8), Level(CAR, car=str(car)))
        for effect, car in zip(faults, chosen[1:], strict=True)
    ]
    terms.append(term(DRIFT, (0.6, 1.0), Level(RAMP, car=str(chosen[0]), onset=onset)))
    terms.append(term(DELAY, (0.25, 0.5), Level(CONDITION, tag="software", value=NEW)))
    local = str(rng.choice(PLACES))
    begin = float(rng.uniform(0.2, 0.6))
    place = PlacedEffect(
        local,
        scale_strength(local, float(rng.uniform(0.5, 0.8))),
        int(rng.integers(size.routes)),
        begin,
        begin + float(rng.uniform(0.1, 0.15)),
    )
    days = np.sort(rng.uniform(0.0, DAYS, size.recordings))
    damaged = set(rng.choice(size.recordings, size.damaged, replace=False).tolist())
    turns = np.array([rng.permutation(size.cars) for _ in range(size.recordings // size.cars + 1)])
    drives, spoilt = [], 0
    for i, day in enumerate(days):
        damage = DAMAGES[spoilt % len(DAMAGES)] if i in damaged else ""
        spoilt += i in damaged
        drives.append(
            PlannedDrive(
                f"drive_{i:03d}",
                cars[turns.ravel()[i]],
                float(round(day, 3)),
                int(rng.integers(size.routes)),
                float(rng.uniform(0.0, 1.0)),
                float(round(rng.uniform(*size.durations_s))),
                NEW if rng.random() < 0.5 else OLD,
                "winter" if rng.random() < 0.4 else "summer",
                int(rng.integers(1 << 30)),
                damage,
            )
        )
    return FleetPlan(seed, size, tuple(terms), place, tuple(drives))
