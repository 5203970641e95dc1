# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The list of generated cases.

Single effects at three strengths, combinations, changes outside the catalogue, dropouts of
sensors, and no change. The simulator that makes both bags (`plant`), the road and the noise
alternate over the list; the multi-body model of another project has further cases.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.bench.mismatch.sensor_dropouts import DROPOUTS
from adk_ros.bench.mismatch.unlisted_labels import describe_unlisted
from adk_ros.bench.vehicles.multibody import MULTI_BODY
from adk_ros.bench.vehicles.multibody_changes import EFFECTS as MULTIBODY_EFFECTS
from adk_ros.bench.vehicles.multibody_changes import SIZES as MULTIBODY_SIZES
from adk_ros.errors import UsageError
from adk_ros.plant.injection.injected_drive import PLANTS
from adk_ros.plant.injection.injectors import FULL, SPRUNG_CAR_ONLY, UNLISTED, scale_strength

FULL_STRENGTH, WEAK, WEAKEST = 1.0, 0.3, 0.1
FIRST_SEED, SEEDS_PER_LIST, LISTS = 1000, 1000, 499
"""Seed of the first case of list 0; seeds of two lists differ by `SEEDS_PER_LIST`, and those of
all `LISTS` end before the seeds of the calibration."""
CLEAN = 100
"""Control cases without a mismatch: with none of 100 misjudged, the false-positive rate is below
3 % at 95 % confidence."""
FIRST_CLEAN, CLEAN_MULTI_BODY = 60, 25
"""Clean cases at the begin of the list, and those of the multi-body model after them."""
FIRST_UNLISTED = 10
"""Unlisted changes in the first part of the list."""
ROAD_STYLE_SEQUENCE = ("track", "track", "town")
NOISES = (1.0, 0.5, 1.0, 2.0)
NEED_GRIP = ("aero_downforce", "low_friction", "load_sensitivity")
"""Effects that are not observable in a town: at its speeds and in its bends they change the motion
by less than the noise."""
NEED_SPEED = ("speed_limiter", "low_gear_gain", "wheel_imbalance")
"""Unlisted changes that hardly act, or never end, at the speeds of a town."""

PAIRS = (
    ("aero_drag", "steering_lag"),
    ("payload", "steering_offset"),
    ("road_bank", "yaw_inertia"),
    ("drive_torque_gain", "front_tyre_stiffness"),
    ("imu_bias", "steering_delay"),
    ("low_friction", "rolling_resistance"),
    ("crosswind", "drive_torque_lag"),
    ("road_grade", "rear_tyre_stiffness"),
    ("gyro_scale", "brake_torque_gain"),
    ("tyre_relaxation", "torque_offset"),
)
TRIPLES = (
    ("aero_drag", "steering_delay", "rear_tyre_stiffness"),
    ("payload", "steering_offset", "road_grade"),
    ("drive_torque_gain", "yaw_inertia", "imu_bias"),
)
TIMED = (
    "aero_drag",
    "steering_lag",
    "drive_torque_gain",
    "payload",
    "low_friction",
    "imu_bias",
)
"""Effects that are also injected from a time on."""

_PLACED = {
    "road_grade": "place",
    "road_bank": "place",
    "low_friction": "place",
    "crosswind": "place",
}


@dataclass(frozen=True)
class CasePlan:
    """Specification of a generated case."""

    name: str
    injected: InjectedMismatch
    seed: int
    plant: str
    strength: float = 1.0
    road_style: str = "track"
    noise: float = 1.0
    recordings: int = 1
    """Of the same car, analysed together."""

    def make(self) -> GeneratedCase:
        """Generate the case with its complete label."""
        case = make_case(
            self.name,
            self.injected,
            self.seed,
            self.plant,
            road_style=self.road_style,
            noise=self.noise,
            further=self.recordings - 1,
        )
        return replace(case, label=self.labelled(case.label))

    def write(self, folder: Path) -> Path:
        """Generate the case and write it to a folder below `folder`, which is returned."""
        path = folder / self.name
        write_case(self.make(), path)
        return path

    def labelled(self, label: dict[str, Any]) -> dict[str, Any]:
        """Add strength, simulator, and equation and features of an unlisted change to a label."""
        return {
            **describe_unlisted(label, self.injected.unlisted),
            "strength": self.strength,
            "plant": self.plant,
            "drive": self.road_style,
            "noise": self.noise,
        }


def injected_mismatch(names: tuple[str, ...], strength: float, kind: str = "") -> InjectedMismatch:
    """
    Return these effects at a strength.

    `kind`: they act only on a part of the lap ("place") or from a time on ("time").
    """
    kinds = {n: kind or _PLACED[n] for n in names if kind or n in _PLACED}
    return InjectedMismatch({n: scale_strength(n, strength) for n in names}, kinds)


def _plan(
    i: int, name: str, injected: InjectedMismatch, strength: float = 1.0, plant: str = ""
) -> CasePlan:
    """Return the plan of case `i`; the number decides on simulator, road and noise."""
    plant = plant or PLANTS[i % len(PLANTS)]
    if set(SPRUNG_CAR_ONLY) & set(injected.effects):
        plant = "spring_car"
    road_style = ROAD_STYLE_SEQUENCE[i // 3 % len(ROAD_STYLE_SEQUENCE)]
    noise = NOISES[i // 9 % len(NOISES)]
    if {*NEED_GRIP, *NEED_SPEED} & {*injected.effects, *injected.unlisted}:
        road_style = "track"
    return CasePlan(name, injected, FIRST_SEED + i, plant, strength, road_style, noise)


def case_plans(number: int = 0) -> Iterator[CasePlan]:
    """
    Yield all cases of list `number`, of `LISTS` with other vehicles, drives, roads and plants.

    The number of a case decides on its random vehicle, so new ones are added at the end.
    """
    every = [*_first_cases(), *_further_cases()]
    for i, (name, injected, strength, plant) in enumerate(every, number * SEEDS_PER_LIST):
        yield _plan(i, name, injected, strength, plant)


_Case = tuple[str, InjectedMismatch, float, str]
"""Name, mismatch, strength, and plant, or "" for one of `PLANTS` in turn."""


def _first_cases() -> Iterator[_Case]:
    """Yield clean cases, single effects, combinations, and the first unlisted changes."""
    yield from ((f"clean_{i:02}", InjectedMismatch(), 1.0, "") for i in range(FIRST_CLEAN))
    yield from _singles((FULL_STRENGTH, WEAK))
    for names in (*PAIRS, *TRIPLES):
        yield "_and_".join(names), injected_mismatch(names, 1.0), 1.0, ""
    for name in TIMED:
        yield f"{name}_from_a_time_on", injected_mismatch((name,), 1.0, "time"), 1.0, ""
    yield from _unlisted(list(UNLISTED)[:FIRST_UNLISTED])


def _further_cases() -> Iterator[_Case]:
    """Yield the multi-body model, weakest effects, and further clean cases and changes."""
    for i in range(FIRST_CLEAN, CLEAN):
        plant = MULTI_BODY if i < FIRST_CLEAN + CLEAN_MULTI_BODY else ""
        yield f"clean_{i:02}", InjectedMismatch(), 1.0, plant
    yield from _singles((WEAKEST,))
    yield from _unlisted(list(UNLISTED)[FIRST_UNLISTED:])
    yield from _unlisted(list(DROPOUTS))
    for name in MULTIBODY_EFFECTS:
        effects = {name: MULTIBODY_SIZES.get(name, FULL[name])}
        yield f"{MULTI_BODY}_{name}", InjectedMismatch(effects), FULL_STRENGTH, MULTI_BODY


def _singles(strengths: Sequence[float]) -> Iterator[_Case]:
    for strength in strengths:
        for name in FULL:
            yield f"{name}_{strength:g}", injected_mismatch((name,), strength), strength, ""


def _unlisted(names: Sequence[str]) -> Iterator[_Case]:
    for name in names:
        for strength in (FULL_STRENGTH, WEAK):
            size = strength * {**UNLISTED, **DROPOUTS}[name]
            injected = InjectedMismatch(unlisted={name: size})
            yield f"unlisted_{name}_{strength:g}", injected, strength, ""


def select_plans(limit: int, only: str = "", number: int = 0) -> list[CasePlan]:
    """
    Return at most `limit` plans of list `number`, spread evenly over it; 0: all.

    `only`: a name or a pattern with `*`, `?` and `[...]`, several separated by commas.
    :raises UsageError: no case has such a name.
    """
    patterns = [pattern.strip() for pattern in only.split(",") if pattern.strip()]
    every = list(case_plans(number))
    for pattern in patterns:
        if not any(fnmatchcase(plan.name, pattern) for plan in every):
            raise UsageError(
                f"no generated case is called '{pattern}': names are such as {every[0].name}, "
                f"{every[FIRST_CLEAN].name} or 'unlisted_*'"
            )
    if patterns:
        every = [p for p in every if any(fnmatchcase(p.name, x) for x in patterns)]
    if limit <= 0 or limit >= len(every):
        return every
    return [every[i * len(every) // limit] for i in range(limit)]


def with_recordings(plans: Sequence[CasePlan], count: int) -> list[CasePlan]:
    """
    Return the plans with several recordings of each car, of effects that act always.

    :raises UsageError: none of them does.
    """
    found = [replace(plan, recordings=count) for plan in plans if not plan.injected.kinds]
    if not found:
        raise UsageError("--recordings needs cases whose effects act always: none is selected")
    return found
