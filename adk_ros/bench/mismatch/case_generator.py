# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Generate benchmark cases: simulated drives with an injected mismatch, or without one.

A case has a random vehicle, two random routes, build tolerances, sensor noise and a few lost
messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.sensor_dropouts import DROPOUTS, with_dropouts
from adk_ros.bench.vehicles.vehicle_family import Drive, family_of
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.recording.simulated_sensors import simulate_faulty_sensors
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import RoadPatch
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.injectors import plant_changes
from adk_ros.plant.scenario.random_routes import (
    ROAD_STYLES,
    plan_route,
    random_route,
    slower_routes,
    spins,
)

SIMULATED_S, RECORDED_S, HELD_OUT_S = 150.0, 220.0, 100.0
"""Durations of the simulation, the recording and the held-out recording, s."""
_ALWAYS_PLACED = ("road_grade", "road_bank")
_PLACE_KEYS = {
    "road_grade": ("grade", "grade"),
    "road_bank": ("bank", "bank"),
    "low_friction": ("mu", "mu_scale"),
}
_BLENDS = {"road_grade": 24.0, "road_bank": 16.0, "low_friction": 5.0, "crosswind": 0.0}
"""
Transition length of a local effect, m, by choice: grade and bank change over several car lengths,
friction over one, and a crosswind begins and ends at once.
"""
Span = tuple[float, float]


@dataclass(frozen=True)
class InjectedMismatch:
    """
    An injected mismatch: `effects`, name -> parameters, as in a label.

    `kinds`: name -> "place" or "time" for effects that do not act always; `unlisted`: changes
    that are not in the catalogue, key of `injectors.UNLISTED` or `DROPOUTS` -> value.
    """

    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    unlisted: dict[str, float] = field(default_factory=dict)


_FURTHER_SEED = 10**6
"""Distance of the seeds of further drives: more than there are cases."""


@dataclass(frozen=True)
class GeneratedCase:
    """
    Inputs of `adk mismatch`, the held-out recording and the label.

    `further`: more recordings of the same car on the same route, analysed with the first.
    """

    name: str
    simulation: SensorLog
    recording: SensorLog
    held_out: SensorLog
    nominal: NominalVehicle
    label: dict[str, Any]
    further: tuple[SensorLog, ...] = ()


def _spans(rng: np.random.Generator, length: float) -> list[Span]:
    """Return two intervals of a lap, (begin, end) as arc lengths, m."""
    u = rng.uniform
    first = float(u(0.06, 0.16)) * length
    after = first + float(u(0.08, 0.14)) * length
    second = after + float(u(0.10, 0.20)) * length
    return [(first, after), (second, second + float(u(0.07, 0.12)) * length)]


def _times_in(along: FloatArray, spans: list[Span], blend: float) -> list[list[float]]:
    """Return the times, s, in which `along`, sampled at 1 kHz, is in any interval."""
    inside = np.zeros(along.size + 2, dtype=bool)
    for a, b in spans:
        inside[1:-1] |= (along > a + 0.5 * blend) & (along < b - 0.5 * blend)
    edges = np.flatnonzero(np.diff(inside.astype(np.int8)))
    return [
        [0.001 * float(a), 0.001 * float(b)] for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def make_case(
    name: str,
    injected: InjectedMismatch,
    seed: int,
    plant: str = "seven_dof",
    seconds: tuple[float, float, float] = (SIMULATED_S, RECORDED_S, HELD_OUT_S),
    road_style: str = "track",
    noise: float = 1.0,
    further: int = 0,
) -> GeneratedCase:
    """
    Return a case; the same arguments give the same case.

    If the vehicle spins, it is simulated again at a lower speed.
    :raises AlwaysSpins: it spins at every speed that is tried.
    :param seconds: durations of the simulation, the recording and the held-out recording.
    :param road_style: a key of `ROAD_STYLES`.
    :param noise: factor on the sensor noise.
    :param further: number of further recordings; effects act in them from their start.
    """
    rng = np.random.default_rng([seed, 77])
    roads = ROAD_STYLES[road_style]
    family = family_of(plant)
    vehicle = family.random_vehicle(rng, "headwind" in injected.effects)
    placed = [
        k for k in injected.effects if injected.kinds.get(k) == "place" or k in _ALWAYS_PLACED
    ]
    simulated, _ = random_route(rng, roads)
    segments, length = random_route(rng, roads)
    spans = _spans(rng, length)
    places = [
        RoadPatch.model_validate(
            {
                "start": a,
                "end": b,
                "blend": _BLENDS[k],
                _PLACE_KEYS[k][0]: injected.effects[k][_PLACE_KEYS[k][1]],
            }
        )
        for k in placed
        if k in _PLACE_KEYS
        for a, b in spans
    ]
    timed = [k for k, kind in injected.kinds.items() if kind == "time"]
    onset = float(rng.uniform(0.27, 0.64)) * seconds[1] if timed else 0.0
    changes = plant_changes(injected.effects, injected.unlisted, onset)
    if "crosswind" in placed:
        changes = changes._replace(wind_from=spans[0][0], wind_to=spans[0][1])
    built = family.with_tolerances(rng, vehicle)
    car = family.changed(built, injected.effects)
    lateral = float(rng.uniform(*roads.lateral))
    route = plan_route(simulated, [], roads, lateral)
    truth, commands = family.drive(
        vehicle, vehicle, Drive(route, InjectedChanges(), seed + 1, seconds[0])
    )
    simulation = simulate_faulty_sensors("simulation", truth, commands, {}, None)
    friction = 1.0
    if "low_friction" in injected.effects and "low_friction" not in placed:
        friction = injected.effects["low_friction"]["mu_scale"]
    for route, later in slower_routes(name, segments, places, roads, lateral, friction):
        drive = Drive(route, changes, seed + 2, seconds[1], 0.0, built, later)
        truth, commands = family.drive(vehicle, car, drive)
        drive = Drive(
            route, changes._replace(onset=0.0), seed + 3, seconds[2], 0.2 * length, None, later
        )
        held_out_truth, held_out_commands = family.drive(vehicle, car, drive)
        others = [
            family.drive(
                vehicle,
                car,
                Drive(
                    route,
                    changes._replace(onset=0.0),
                    seed + _FURTHER_SEED * i,
                    seconds[1],
                    i * length / (further + 1),
                    None,
                    later,
                ),
            )
            for i in range(1, further + 1)
        ]
        if not spins(truth[:, 4], held_out_truth[:, 4], *(state[:, 4] for state, _ in others)):
            break
    recording = simulate_faulty_sensors(
        "recording", truth, commands, injected.effects, rng, noise, onset
    )
    held_out = simulate_faulty_sensors(
        "heldout", held_out_truth, held_out_commands, injected.effects, rng, noise
    )
    more = tuple(
        simulate_faulty_sensors(f"recording_{i}", *driven, injected.effects, rng, noise)
        for i, driven in enumerate(others, 2)
    )
    dropouts = {name: x for name, x in injected.unlisted.items() if name in DROPOUTS}
    recording = with_dropouts(recording, dropouts, rng)
    label: dict[str, Any] = {"effects": []}
    for effect, parameters in injected.effects.items():
        kind = "place" if effect in placed else injected.kinds.get(effect, "always")
        times = [[onset if kind == "time" else 0.0, seconds[1]]]
        if kind == "place":
            used = spans[:1] if effect == "crosswind" else spans
            times = _times_in(truth[:, 8] % length, used, _BLENDS.get(effect, 0.0))
        label["effects"].append(
            {"name": effect, "params": parameters, "kind": kind, "time_intervals_s": times}
        )
    if injected.unlisted:
        label["effects"].append(
            {
                "name": "unknown",
                "params": {},
                "kind": "always",
                "time_intervals_s": [[0.0, seconds[1]]],
            }
        )
    nominal = family.nominal(vehicle)
    return GeneratedCase(name, simulation, recording, held_out, nominal, label, more)
