# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The list of generated cases.

Single effects at two strengths, combinations, changes outside the catalogue, and no change.
The simulator that makes both bags (`plant`), the road and the noise alternate over the list.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from adk_ros.bench.mismatch.case_files import write_case
from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.bench.mismatch.injected_drive import PLANTS
from adk_ros.bench.mismatch.injectors import FULL, SPRUNG_CAR_ONLY, UNLISTED, scale_strength

STRENGTHS = (1.0, 0.3)
CLEAN = 60
"""Control cases without a mismatch: with none of 60 misjudged, the false-positive rate is below
5 % at 95 % confidence."""
ROAD_STYLE_SEQUENCE = ("track", "track", "town")
NOISES = (1.0, 0.5, 1.0, 2.0)
NEED_GRIP = ("aero_downforce", "low_friction", "load_sensitivity")
"""Effects that are not observable in a town: at its speeds and in its bends they change the motion
by less than the noise."""

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

UNLISTED_IN: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "locked_differential": (("yaw_rate",), ("yaw_rate_per_speed", "yaw_rate", "delta")),
    "torque_steer": (("v_y",), ("torque", "torque_squared")),
    "shimmy": (("yaw_rate",), ("sine_of_speed", "speed", "speed_squared", "speed_cubed")),
    "yaw_damping": (("yaw_rate",), ("yaw_rate", "yaw_rate_per_speed", "yaw_rate_speed")),
    "scrub_drag": (("v_x",), ("lateral_squared", "lateral_size")),
    "torque_vectoring": (("yaw_rate",), ("torque_delta", "torque_yaw_rate", "torque_lateral")),
    "steering_drag": (("v_x",), ("delta_size", "yaw_rate_size")),
    "torque_cut": (("v_x",), ("drive_torque",)),
    "sloshing_load": (("v_y",), ("yaw_rate_speed",)),
    "time_periodic_yaw": (("yaw_rate",), ()),
}
"""Unlisted change -> equations that it acts in, features any of which identifies its cause."""

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

    def make(self) -> GeneratedCase:
        """Generate the case with its complete label."""
        case = make_case(
            self.name,
            self.injected,
            self.seed,
            self.plant,
            road_style=self.road_style,
            noise=self.noise,
        )
        return replace(case, label=self.labelled(case.label))

    def write(self, folder: Path) -> Path:
        """Generate the case and write it to a folder below `folder`, which is returned."""
        path = folder / self.name
        write_case(self.make(), path)
        return path

    def labelled(self, label: dict[str, Any]) -> dict[str, Any]:
        """Add strength, simulator, and equation and features of an unlisted change to a label."""
        effects = [dict(effect) for effect in label["effects"]]
        known = [UNLISTED_IN[name] for name in self.injected.unlisted if name in UNLISTED_IN]
        for effect in effects:
            if effect["name"] == "unknown" and known:
                effect["equations"] = [x for equations, _ in known for x in equations]
                effect["driven_by"] = [x for _, features in known for x in features]
        return {
            **label,
            "effects": effects,
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


def _plan(i: int, name: str, injected: InjectedMismatch, strength: float = 1.0) -> CasePlan:
    """Return the plan of case `i`; the number decides on simulator, road and noise."""
    plant = PLANTS[i % len(PLANTS)]
    if set(SPRUNG_CAR_ONLY) & set(injected.effects):
        plant = "spring_car"
    road_style = ROAD_STYLE_SEQUENCE[i // 3 % len(ROAD_STYLE_SEQUENCE)]
    noise = NOISES[i // 9 % len(NOISES)]
    if set(NEED_GRIP) & set(injected.effects):
        road_style = "track"
    return CasePlan(name, injected, 1000 + i, plant, strength, road_style, noise)


def case_plans() -> Iterator[CasePlan]:
    """Yield all cases."""
    every: list[tuple[str, InjectedMismatch, float]] = []
    every += [(f"clean_{i:02}", InjectedMismatch(), 1.0) for i in range(CLEAN)]
    every += [
        (f"{name}_{strength:g}", injected_mismatch((name,), strength), strength)
        for strength in STRENGTHS
        for name in FULL
    ]
    every += [
        ("_and_".join(names), injected_mismatch(names, 1.0), 1.0) for names in (*PAIRS, *TRIPLES)
    ]
    every += [(f"{n}_from_a_time_on", injected_mismatch((n,), 1.0, "time"), 1.0) for n in TIMED]
    every += [
        (
            f"unlisted_{name}_{strength:g}",
            InjectedMismatch(unlisted={name: strength * size}),
            strength,
        )
        for name, size in UNLISTED.items()
        for strength in STRENGTHS
    ]
    for i, (name, injected, strength) in enumerate(every):
        yield _plan(i, name, injected, strength)


def select_plans(limit: int) -> list[CasePlan]:
    """Return at most `limit` plans, spread evenly over the list; 0: all."""
    every = list(case_plans())
    if limit <= 0 or limit >= len(every):
        return every
    return [every[i * len(every) // limit] for i in range(limit)]
