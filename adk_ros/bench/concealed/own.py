# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Cases of our own: each effect concealed in the package's plant, at any strength, and clean ones.

A case has a random car, two random routes, build tolerances, sensor noise and a few lost messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from adk_ros.bench.concealed.hidden_drive import TICK, Changes, hidden_drive
from adk_ros.mismatch.evidence import Evidence
from adk_ros.mismatch.nominal import Nominal
from adk_ros.plant.driver import SpeedPlan, plan_speed
from adk_ros.plant.params import GRAVITY, Vehicle
from adk_ros.plant.road import Bend, Place, Route, Segment, build_route
from adk_ros.plant.yaml_file import replaced
from adk_ros.signals.channels import FloatArray

SIMULATED_S, RECORDED_S, HELD_OUT_S = 150.0, 220.0, 100.0
NOISE = np.array([0.06, 0.06, 0.003])
ODOMETRY_NOISE = np.array([0.03, 0.03, 0.003, 0.03, 0.03, 0.003])
_LOST = 0.002


@dataclass(frozen=True)
class Secret:
    """
    Effects by name -> parameters, as in a label; `kinds` name -> place or time where not always.

    `unlisted` names changes that are in no catalogue.
    """

    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    unlisted: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class OwnCase:
    """A case as the tool and the scorer take it."""

    name: str
    simulation: Evidence
    recording: Evidence
    heldout: Evidence
    nominal: Nominal
    label: dict[str, Any]


FULL: dict[str, dict[str, float]] = {
    "aero_drag": {"cda": 1.0}, "rolling_resistance": {"crr": 0.015}, "headwind": {"wind_x": -9.0},
    "crosswind": {"wind_y": 10.0}, "road_grade": {"grade": 0.05}, "road_bank": {"bank": 0.09},
    "low_friction": {"mu_scale": 0.6}, "front_tyre_stiffness": {"scale": 0.72},
    "rear_tyre_stiffness": {"scale": 0.72}, "tyre_relaxation": {"length": 0.8},
    "load_sensitivity": {"slope": 0.15}, "payload": {"mass": 300.0}, "cg_shift": {"shift": -0.12},
    "yaw_inertia": {"scale": 1.3}, "steering_offset": {"offset": 0.012},
    "steering_ratio": {"scale": 0.86}, "steering_delay": {"delay": 0.11},
    "steering_lag": {"tau": 0.16}, "steering_backlash": {"half_gap": 0.004},
    "compliance_steer": {"rad_per_mps2": 0.0014}, "drive_torque_gain": {"scale": 0.86},
    "brake_torque_gain": {"scale": 0.75}, "drive_torque_delay": {"delay": 0.14},
    "drive_torque_lag": {"tau": 0.2}, "torque_offset": {"offset": -90.0},
    "power_limit": {"power": 24000.0}, "rotating_inertia": {"inertia": 20.0},
    "wheel_radius": {"scale": 1.12}, "brake_drag_one_side": {"torque_per_wheel": 70.0},
    "imu_bias": {"ax": 0.2, "ay": -0.2, "gyro": 0.008},
    "imu_tilt": {"roll": 0.025, "pitch": -0.02},
    "imu_lever_arm": {"x": 0.8, "y": 0.4}, "imu_delay": {"delay": 0.06},
    "odometry_scale": {"scale": 1.04}, "gyro_scale": {"scale": 1.05},
    "odometry_filter": {"tau": 0.25}, "clock_offset": {"offset": 0.1},
}
"""Each effect that the plant can conceal, at strength 1."""

UNLISTED = {"locked": 25.0, "pull": 2.5e-4, "shimmy": 0.05}
_ALWAYS_PLACED = ("road_grade", "road_bank")


def scaled(name: str, strength: float) -> dict[str, float]:
    """Return an effect's parameters at a share of full strength."""
    if name == "power_limit":
        return {"power": FULL[name]["power"] / strength**0.5}
    out = {}
    for parameter, value in FULL[name].items():
        neutral = 1.0 if parameter in {"scale", "mu_scale"} else 0.0
        out[parameter] = neutral + strength * (value - neutral)
    return out


def _route(rng: np.random.Generator, places: list[Place]) -> Route:
    """Return a closed course of some 1800 m of straights and bends."""
    for _ in range(60):
        signs = np.array([1, 1, 1, 1, -1, 1, 1])
        rng.shuffle(signs)
        angles = signs * rng.uniform(40.0, 110.0, 7)
        angles[int(np.argmax(signs))] += 360.0 - angles.sum()
        size = np.abs(angles)
        if size.min() < 30.0 or size.max() > 170.0:
            continue
        segments = []
        for angle in angles:
            segments.append(Segment(straight=float(rng.uniform(60.0, 220.0))))
            radius = float(rng.uniform(45.0, 130.0))
            segments.append(Segment(bend=Bend(radius=radius, angle_deg=float(angle),
                                              transition=20.0)))
        try:
            route = build_route(segments, places, 1.0)
        except ValueError:
            continue
        if 1300.0 < route.length < 2600.0:
            plan = SpeedPlan(
                top=33.0, lateral_accel=5.5, accel=2.3, brake=2.6, variation=0.05
            )
            return plan_speed(route, plan)
    raise ValueError("no random route closes")


def _vehicle(rng: np.random.Generator) -> Vehicle:
    u = rng.uniform
    tyre = {"mu": u(0.95, 1.1), "b_y": u(9.0, 11.0), "c_y": u(1.3, 1.5), "nominal_load": 5300.0,
            "load_sensitivity": u(0.05, 0.15), "relaxation_length": u(0.0, 0.35)}
    drag = bool(rng.random() < 0.6)
    return Vehicle.model_validate({
        "mass": u(1900.0, 2250.0), "yaw_inertia": u(3300.0, 3900.0),
        "cg_to_front_axle": u(1.26, 1.34), "cg_to_rear_axle": u(1.3, 1.42),
        "track_width": 1.7, "cg_height": u(0.49, 0.59), "wheel_radius": 0.325,
        "wheel_inertia": 1.3, "cda": 0.7 * drag, "crr": 0.01 * drag, "load_lag": u(0.0, 0.06),
        "torque_lag": u(0.0, 0.03), "steer_lag": u(0.0, 0.03),
        "front_tyre": tyre, "rear_tyre": {**tyre, "b_y": tyre["b_y"] * u(1.05, 1.2)},
    })


def _tolerances(rng: np.random.Generator, vehicle: Vehicle) -> Vehicle:
    names = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle", "cda", "crr",
             "wheel_radius")
    values = vehicle.model_dump()
    for name in names:
        values[name] *= 1.0 + 0.004 * rng.uniform(-1.0, 1.0)
    for axle in ("front_tyre", "rear_tyre"):
        for name in ("mu", "b_y"):
            values[axle][name] *= 1.0 + 0.004 * rng.uniform(-1.0, 1.0)
    return Vehicle.model_validate(values)


def _changed(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> Vehicle:
    """Return the vehicle with those effects that are in its parameters."""
    v = vehicle.model_dump()
    front, rear = v["front_tyre"], v["rear_tyre"]
    for name, p in effects.items():
        if name == "aero_drag":
            v["cda"] += p["cda"]
        elif name == "rolling_resistance":
            v["crr"] += p["crr"]
        elif name == "front_tyre_stiffness":
            front["b_y"] *= p["scale"]
        elif name == "rear_tyre_stiffness":
            rear["b_y"] *= p["scale"]
        elif name == "tyre_relaxation":
            front["relaxation_length"] += p["length"]
            rear["relaxation_length"] += p["length"]
        elif name == "load_sensitivity":
            front["load_sensitivity"] += p["slope"]
            rear["load_sensitivity"] += p["slope"]
        elif name == "payload":
            v["mass"] += p["mass"]
            v["yaw_inertia"] += 1.1 * p["mass"]
        elif name == "cg_shift":
            v["cg_to_front_axle"] -= p["shift"]
            v["cg_to_rear_axle"] += p["shift"]
        elif name == "yaw_inertia":
            v["yaw_inertia"] *= p["scale"]
        elif name == "rotating_inertia":
            v["wheel_inertia"] += 0.25 * p["inertia"]
        elif name == "wheel_radius":
            v["wheel_radius"] *= p["scale"]
    return Vehicle.model_validate(replaced(vehicle.model_dump(), v))


_COMMANDS = {
    "drive_torque_gain": ("scale", "torque_gain"), "brake_torque_gain": ("scale", "brake_gain"),
    "torque_offset": ("offset", "torque_offset"), "drive_torque_lag": ("tau", "torque_lag"),
    "power_limit": ("power", "power"), "steering_ratio": ("scale", "steer_gain"),
    "steering_offset": ("offset", "steer_offset"), "steering_lag": ("tau", "steer_lag"),
    "steering_backlash": ("half_gap", "half_gap"),
    "compliance_steer": ("rad_per_mps2", "compliance"),
    "brake_drag_one_side": ("torque_per_wheel", "side_drag"), "headwind": ("wind_x", "wind_x"),
    "crosswind": ("wind_y", "wind_y"),
}


def _changes(secret: Secret, onset: float) -> Changes:
    values: dict[str, Any] = dict(secret.unlisted)
    for name, p in secret.effects.items():
        if name in _COMMANDS:
            values[_COMMANDS[name][1]] = p[_COMMANDS[name][0]]
    delays = {"torque_delay_ms": 0.0, "steer_delay_ms": 0.0}
    delays["torque_delay_ms"] += secret.effects.get("drive_torque_delay", {}).get("delay", 0.0)
    delays["steer_delay_ms"] += secret.effects.get("steering_delay", {}).get("delay", 0.0)
    for key in delays:
        delays[key] += secret.effects.get("clock_offset", {}).get("offset", 0.0)
        values[key] = round(1000.0 * delays[key])
    return Changes(onset=onset)._replace(**values)


def _sensed(
    name: str, truth: FloatArray, commands: FloatArray, effects: dict[str, dict[str, float]],
    rng: np.random.Generator | None,
) -> Evidence:
    """Return what the sensors make of a drive; noise and loss only with a generator."""
    n = truth.shape[0]
    imu_at, odometry_at = np.arange(5, n, 10), np.arange(5, n, 20)
    delay = effects.get("imu_delay", {}).get("delay", 0.0)
    seen = np.maximum(imu_at - round(1000.0 * delay), 0)
    imu = truth[seen][:, [0, 1, 2]].copy()
    arm = effects.get("imu_lever_arm", {"x": 0.0, "y": 0.0})
    rate, turning = truth[seen, 2], truth[seen, 10]
    imu[:, 0] -= rate**2 * arm["x"] + turning * arm["y"]
    imu[:, 1] += turning * arm["x"] - rate**2 * arm["y"]
    imu[:, 2] *= effects.get("gyro_scale", {}).get("scale", 1.0)
    bias = effects.get("imu_bias", {"ax": 0.0, "ay": 0.0, "gyro": 0.0})
    imu += np.array([bias["ax"], bias["ay"], bias["gyro"]])
    tilt = effects.get("imu_tilt", {"roll": 0.0, "pitch": 0.0})
    imu[:, 0] -= GRAVITY * np.sin(tilt["pitch"])
    imu[:, 1] += GRAVITY * np.sin(tilt["roll"])
    rates = truth[:, 2].copy()
    tau = effects.get("odometry_filter", {}).get("tau", 0.0)
    if tau > 0.0:
        keep = np.exp(-0.001 / tau)
        for k in range(1, n):
            rates[k] = rates[k] + (rates[k - 1] - rates[k]) * keep
    odometry = np.column_stack(
        [truth[odometry_at, 3], truth[odometry_at, 4], rates[odometry_at]]
    )
    odometry[:, 0] *= effects.get("odometry_scale", {}).get("scale", 1.0)
    pose = truth[odometry_at][:, [5, 6, 7]].copy()
    imu_s: FloatArray = 0.001 * imu_at.astype(np.float64)
    odometry_s: FloatArray = 0.001 * odometry_at.astype(np.float64)
    if rng is not None:
        imu += NOISE * rng.standard_normal(imu.shape)
        both = ODOMETRY_NOISE * rng.standard_normal((odometry.shape[0], 6))
        odometry += both[:, :3]
        pose += both[:, 3:]
        kept, heard = rng.random(imu_s.size) > _LOST, rng.random(odometry_s.size) > _LOST
        imu_s, imu = imu_s[kept], imu[kept]
        odometry_s, odometry, pose = odometry_s[heard], odometry[heard], pose[heard]
    command_s: FloatArray = 0.001 * TICK * np.arange(commands.shape[0], dtype=np.float64)
    return Evidence(
        name, 0.001 * (n - 1), imu_s, imu, odometry_s, odometry, pose, command_s, commands
    )


def make_case(
    name: str, secret: Secret, seed: int, plant: str = "seven_dof",
    seconds: tuple[float, float, float] = (SIMULATED_S, RECORDED_S, HELD_OUT_S),
) -> OwnCase:
    """
    Return a case; the same arguments give the same case.

    `seconds` of the simulation, of the recording and of the held-out drive.
    """
    rng = np.random.default_rng([seed, 77])
    vehicle = _vehicle(rng)
    placed = [k for k, kind in secret.kinds.items() if kind == "place"]
    placed += [k for k in secret.effects if k in _ALWAYS_PLACED and k not in placed]
    begin = float(rng.uniform(100.0, 300.0))
    spans = [(begin, begin + float(rng.uniform(150.0, 260.0)))]
    spans.append((spans[0][1] + float(rng.uniform(150.0, 300.0)), 0.0))
    spans[1] = (spans[1][0], spans[1][0] + float(rng.uniform(120.0, 220.0)))
    keys = {"road_grade": ("grade", "grade"), "road_bank": ("bank", "bank"),
            "low_friction": ("mu", "mu_scale")}
    places = [
        Place.model_validate({"start": a, "end": b, keys[k][0]: secret.effects[k][keys[k][1]]})
        for k in placed if k in keys for a, b in spans
    ]
    simulated_route = _route(rng, [])
    route = _route(rng, places)
    if "low_friction" in secret.effects and "low_friction" not in placed:
        table = route.table.copy()
        table[:, 4] *= secret.effects["low_friction"]["mu_scale"]
        route = replace(route, table=table)
    timed = [k for k, kind in secret.kinds.items() if kind == "time"]
    onset = float(rng.uniform(0.27, 0.64)) * seconds[1] if timed else 0.0
    changes = _changes(secret, onset)
    if "crosswind" in placed:
        changes = changes._replace(wind_from=spans[0][0], wind_to=spans[0][1])
    built = _tolerances(rng, vehicle)
    car = _changed(built, secret.effects)
    truth, commands, _ = hidden_drive(
        vehicle, vehicle, simulated_route, Changes(), seed + 1, seconds[0], plant
    )
    simulation = _sensed("simulation", truth, commands, {}, None)
    truth, commands, _ = hidden_drive(
        vehicle, car, route, changes, seed + 2, seconds[1], plant, before=built
    )
    recording = _sensed("recording", truth, commands, secret.effects, rng)
    lap = route.length
    along = truth[:, 8] % lap
    held, held_commands, _ = hidden_drive(
        vehicle, car, route, changes._replace(onset=0.0), seed + 3, seconds[2], plant, 300.0
    )
    heldout = _sensed("heldout", held, held_commands, secret.effects, rng)
    label: dict[str, Any] = {"effects": []}
    for effect, parameters in secret.effects.items():
        kind = "place" if effect in placed else secret.kinds.get(effect, "always")
        times = [[0.0, seconds[1]]] if kind == "always" else [[onset, seconds[1]]]
        if kind == "place":
            inside = np.zeros(along.size + 2, dtype=bool)
            used = spans[:1] if effect == "crosswind" else spans
            for a, b in used:
                inside[1:-1] |= (along > a + 2.5) & (along < b - 2.5)
            edges = np.flatnonzero(np.diff(inside.astype(np.int8)))
            times = [[0.001 * float(a), 0.001 * float(b)]
                     for a, b in zip(edges[::2], edges[1::2], strict=True)]
        label["effects"].append(
            {"name": effect, "params": parameters, "kind": kind, "time_intervals_s": times}
        )
    if secret.unlisted:
        label["effects"].append(
            {"name": "unknown", "params": {}, "kind": "always",
             "time_intervals_s": [[0.0, seconds[1]]]}
        )
    nominal = Nominal(**{
        key: getattr(vehicle, key) for key in Nominal.model_fields
    })
    return OwnCase(name, simulation, recording, heldout, nominal, label)
