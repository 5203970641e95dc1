# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which cases of our own there are: singles at two strengths, pairs, unlisted ones, clean ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from adk_ros.bench.concealed.case_files import write_case
from adk_ros.bench.concealed.own import FULL, UNLISTED, Secret, make_case, scaled

STRENGTHS = (1.0, 0.3)
CLEAN = 60
PLANTS = ("seven_dof", "fourteen_dof")

PAIRS = (
    ("aero_drag", "steering_lag"), ("payload", "steering_offset"), ("road_bank", "yaw_inertia"),
    ("drive_torque_gain", "front_tyre_stiffness"), ("imu_bias", "steering_delay"),
    ("low_friction", "rolling_resistance"), ("crosswind", "drive_torque_lag"),
    ("road_grade", "rear_tyre_stiffness"), ("gyro_scale", "brake_torque_gain"),
    ("tyre_relaxation", "torque_offset"),
)
TRIPLES = (
    ("aero_drag", "steering_delay", "rear_tyre_stiffness"),
    ("payload", "steering_offset", "road_grade"),
    ("drive_torque_gain", "yaw_inertia", "imu_bias"),
)
_PLACED = {"road_grade": "place", "road_bank": "place", "low_friction": "place",
           "crosswind": "place"}


@dataclass(frozen=True)
class Plan:
    """A case to be made."""

    name: str
    secret: Secret
    seed: int
    plant: str

    def write(self, folder: Path) -> Path:
        """Make the case and write it below `folder`; return where."""
        path = folder / self.name
        write_case(make_case(self.name, self.secret, self.seed, self.plant), path)
        return path


def secret(names: tuple[str, ...], strength: float, kind: str = "") -> Secret:
    """Return the secret of these effects; `kind` replaces where they act by default."""
    kinds = {n: kind or _PLACED[n] for n in names if kind or n in _PLACED}
    return Secret({n: scaled(n, strength) for n in names}, kinds)


def plans() -> Iterator[Plan]:
    """Yield all cases; the plants take turns."""
    seed = 1000
    for i in range(CLEAN):
        yield Plan(f"clean_{i:02}", Secret(), seed + i, PLANTS[i % 2])
    seed += CLEAN
    for strength in STRENGTHS:
        for i, name in enumerate(FULL):
            seed += 1
            title = f"{name}_{strength:g}"
            yield Plan(title, secret((name,), strength), seed, PLANTS[i % 2])
    for i, names in enumerate((*PAIRS, *TRIPLES)):
        seed += 1
        yield Plan("_and_".join(names), secret(names, 1.0), seed, PLANTS[i % 2])
    for i, name in enumerate(("aero_drag", "steering_lag", "drive_torque_gain", "payload")):
        seed += 1
        yield Plan(f"{name}_from_a_time_on", secret((name,), 1.0, "time"), seed, PLANTS[i % 2])
    for i, (name, size) in enumerate(UNLISTED.items()):
        for strength in STRENGTHS:
            seed += 1
            hidden = Secret(unlisted={name: strength * size})
            yield Plan(f"unlisted_{name}_{strength:g}", hidden, seed, PLANTS[i % 2])


def chosen(limit: int) -> list[Plan]:
    """Return at most `limit` of the cases, spread evenly; all for 0."""
    every = list(plans())
    if limit <= 0 or limit >= len(every):
        return every
    return [every[i * len(every) // limit] for i in range(limit)]
