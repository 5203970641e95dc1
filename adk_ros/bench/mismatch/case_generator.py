# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Generate benchmark cases: simulated drives with an injected mismatch, or without one.

A case has a random vehicle, two random routes, build tolerances, sensor noise and a few lost
messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from adk_ros.bench.mismatch.injected_drive import InjectedChanges, simulate_injected_drive
from adk_ros.bench.mismatch.injectors import changed_vehicle, plant_changes
from adk_ros.bench.mismatch.random_routes import ROAD_STYLES, plan_route, random_route
from adk_ros.bench.mismatch.sensor_faults import simulate_faulty_sensors
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import ROAD_MU, RoadPatch
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle

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
_SLOWER, _MAX_TRIES = 0.9, 9
"""Speed factor from one try to the next, and most tries to stay below `_SPIN_V_Y`, by choice."""
_SPIN_V_Y = 3.0
"""Lateral velocity from which on the vehicle counts as spinning, m/s, by choice."""
_TOLERANCE = 0.004
"""
Largest build tolerance drawn, relative: `criteria.TOLERANCE_SIGMA`, the prior standard deviation
of `adk mismatch`. The 1.2 % on its pages is the bound of the fit, three times as much.
"""

Span = tuple[float, float]


@dataclass(frozen=True)
class InjectedMismatch:
    """
    An injected mismatch: `effects`, name -> parameters, as in a label.

    `kinds`: name -> "place" or "time" for effects that do not act always; `unlisted`: changes
    that are not in the catalogue, key of `injectors.UNLISTED` -> value.
    """

    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    unlisted: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class GeneratedCase:
    """Inputs of `adk mismatch`, the held-out recording and the label."""

    name: str
    simulation: SensorLog
    recording: SensorLog
    held_out: SensorLog
    nominal: NominalVehicle
    label: dict[str, Any]


def _vehicle(rng: np.random.Generator, windy: bool) -> Vehicle:
    """
    Return a random vehicle; `windy`: with drag, without which a headwind has no effect.

    The ranges, by choice, are those of a passenger car of 2 t around the vehicle `imdv`.
    """
    u = rng.uniform
    tyre = {
        "mu": u(0.95, 1.1),
        "b_y": u(9.0, 11.0),
        "c_y": u(1.3, 1.5),
        "nominal_load": 5300.0,
        "load_sensitivity": u(0.05, 0.15),
        "relaxation_length": u(0.0, 0.35),
    }
    drag = bool(rng.random() < 0.6) or windy
    return Vehicle.model_validate(
        {
            "mass": u(1900.0, 2250.0),
            "yaw_inertia": u(3300.0, 3900.0),
            "cg_to_front_axle": u(1.26, 1.34),
            "cg_to_rear_axle": u(1.3, 1.42),
            "track_width": 1.7,
            "cg_height": u(0.49, 0.59),
            "wheel_radius": 0.325,
            "wheel_inertia": 1.3,
            "cda": 0.7 * drag,
            "crr": 0.01 * drag,
            "load_lag": u(0.0, 0.06),
            "torque_lag": u(0.0, 0.03),
            "steer_lag": u(0.0, 0.03),
            "front_tyre": tyre,
            "rear_tyre": {**tyre, "b_y": tyre["b_y"] * u(1.05, 1.2)},
        }
    )


def _with_tolerances(rng: np.random.Generator, vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with random build tolerances."""
    names = (
        "mass",
        "yaw_inertia",
        "cg_to_front_axle",
        "cg_to_rear_axle",
        "cda",
        "crr",
        "wheel_radius",
    )
    values = vehicle.model_dump()
    for name in names:
        values[name] *= 1.0 + _TOLERANCE * rng.uniform(-1.0, 1.0)
    for axle in ("front_tyre", "rear_tyre"):
        for name in ("mu", "b_y"):
            values[axle][name] *= 1.0 + _TOLERANCE * rng.uniform(-1.0, 1.0)
    return Vehicle.model_validate(values)


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
) -> GeneratedCase:
    """
    Return a case; the same arguments give the same case.

    If the vehicle spins, it is simulated again at a lower speed.
    :param seconds: durations of the simulation, the recording and the held-out recording.
    :param road_style: a key of `ROAD_STYLES`.
    :param noise: factor on the sensor noise.
    """
    rng = np.random.default_rng([seed, 77])
    roads = ROAD_STYLES[road_style]
    vehicle = _vehicle(rng, "headwind" in injected.effects)
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
    built = _with_tolerances(rng, vehicle)
    car = changed_vehicle(built, injected.effects)
    lateral = float(rng.uniform(*roads.lateral))
    truth, commands, _ = simulate_injected_drive(
        vehicle,
        vehicle,
        plan_route(simulated, [], roads, lateral),
        InjectedChanges(),
        seed + 1,
        seconds[0],
        plant,
    )
    simulation = simulate_faulty_sensors("simulation", truth, commands, {}, None)
    for tried in range(_MAX_TRIES):
        route = later = plan_route(segments, places, roads, lateral, _SLOWER**tried)
        if "low_friction" in injected.effects and "low_friction" not in placed:
            table = route.table.copy()
            table[:, ROAD_MU] *= injected.effects["low_friction"]["mu_scale"]
            later = replace(route, table=table)
        truth, commands, _ = simulate_injected_drive(
            vehicle, car, route, changes, seed + 2, seconds[1], plant, 0.0, built, later
        )
        held_out_truth, held_out_commands, _ = simulate_injected_drive(
            vehicle,
            car,
            route,
            changes._replace(onset=0.0),
            seed + 3,
            seconds[2],
            plant,
            0.2 * length,
            None,
            later,
        )
        if max(np.abs(truth[:, 4]).max(), np.abs(held_out_truth[:, 4]).max()) < _SPIN_V_Y:
            break
    recording = simulate_faulty_sensors(
        "recording", truth, commands, injected.effects, rng, noise, onset
    )
    held_out = simulate_faulty_sensors(
        "heldout", held_out_truth, held_out_commands, injected.effects, rng, noise
    )
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
    nominal = NominalVehicle(**{key: getattr(vehicle, key) for key in NominalVehicle.model_fields})
    return GeneratedCase(name, simulation, recording, held_out, nominal, label)
