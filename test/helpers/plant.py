# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers for tests of the fourteen-degree-of-freedom plant: simulation, loads, energy."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.environment.road import locate
from adk_ros.plant.environment.surface import even_planes
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.vehicle.fourteen_dof import (
    HEADING,
    OMEGA,
    PITCH,
    PITCH_RATE,
    ROLL,
    ROLL_RATE,
    STATE_SIZE,
    TRAVEL,
    TRAVEL_RATE,
    V_X,
    V_Y,
    V_Z,
    YAW_RATE,
    X,
    Y,
    Z,
    advance,
    rolling_state,
)
from adk_ros.plant.vehicle.sprung_mass import SprungMass, resolve
from adk_ros.plant.vehicle.suspension import corner, tyre_load
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Vehicle, load_vehicle


class Car(NamedTuple):
    """A vehicle in the form for the kernels."""

    c: Constants
    b: SprungMass


def car(vehicle: Vehicle) -> Car:
    return Car(vehicle.constants(), resolve(vehicle))


def changed(name: str = "imdv", *, chassis: dict[str, float] | None = None, **own: Any) -> Car:
    """Return a packaged vehicle with changed parameters."""
    vehicle = load_vehicle(name)
    content = vehicle.model_dump() | own
    if chassis is not None:
        content["chassis"] = content["chassis"] | chassis
    return car(Vehicle.model_validate(content))


IMDV = car(load_vehicle("imdv"))
NO_AIR: dict[str, Any] = {
    "cda": 0.0, "crr": 0.0, "side_force_area": 0.0, "yaw_moment_volume": 0.0
}  # fmt: skip
NO_LIFT = {"lift_area_front": 0.0, "lift_area_rear": 0.0}
AIRLESS = changed(chassis=NO_LIFT, **NO_AIR)
LEVEL = even_planes(1.0)


def go(
    car: Car,
    state: FloatArray,
    commands: list[tuple[float, float]],
    *,
    step: float = 1e-3,
    substeps: int = 25,
    planes: FloatArray = LEVEL,
    wind: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Simulate from a copy of `state`; rows as in `fourteen_dof.advance`."""
    states = np.empty((len(commands) + 1, STATE_SIZE))
    forces = np.empty((len(commands) + 1, 2))
    u = np.array(commands, dtype=np.float64)
    advance(car.c, car.b, state.copy(), u, planes, wind, step, substeps, states, forces)
    return states, forces


def rolling(car: Car, v_x: float, planes: FloatArray = LEVEL, **where: float) -> FloatArray:
    return rolling_state(car.c, v_x, planes[0], **where)


def settled(car: Car, planes: FloatArray = LEVEL, v_x: float = 0.0) -> FloatArray:
    """Return the state after 2 s straight ahead, when springs and tyres are at rest."""
    states, _ = go(car, rolling(car, v_x, planes), [(0.0, 0.0)] * 80, planes=planes)
    last: FloatArray = states[-1]
    return last


def attitude(state: FloatArray) -> FloatArray:
    """Return the rotation from body to map, (3, 3)."""
    h, p, r = state[[HEADING, PITCH, ROLL]]
    about_z = np.array([[math.cos(h), -math.sin(h), 0], [math.sin(h), math.cos(h), 0], [0, 0, 1]])
    about_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    return np.asarray(about_z @ about_y @ about_x)


def hubs(car: Car, state: FloatArray) -> FloatArray:
    """Return the wheel centres relative to P in body axes, (4, 3)."""
    c = car.c
    half = 0.5 * c.track_width
    x = [c.cg_to_front_axle] * 2 + [-c.cg_to_rear_axle] * 2
    z = car.b.wheel_z + state[TRAVEL : TRAVEL + 4]
    return np.column_stack([x, [half, -half] * 2, z])


def tyre_forces(car: Car, state: FloatArray, planes: FloatArray = LEVEL) -> FloatArray:
    """Return the loads of the four wheels at zero steering, N."""
    turn, at = attitude(state), hubs(car, state)
    rates = state[[ROLL_RATE, PITCH_RATE, YAW_RATE]]
    moving = state[[V_X, V_Y, V_Z]] + np.cross(rates, at)
    moving[:, 2] += state[TRAVEL_RATE : TRAVEL_RATE + 4]
    loads = np.empty(4)
    for i in range(4):
        normal = turn.T @ planes[i, 1:4]
        height = planes[i, 1:4] @ state[[X, Y, Z]] - planes[i, 4] + normal @ at[i]
        upright = math.sqrt(1.0 - normal[1] ** 2)
        ahead = np.cross([0.0, 1.0, 0.0], normal) / upright
        closing = -(normal @ moving[i] + car.c.wheel_radius * normal[1] * (rates @ ahead))
        at_rest = corner(car.b, i < 2)
        loads[i] = tyre_load(at_rest, car.c.wheel_radius * upright - height, closing)
    return loads


def energy(car: Car, state: FloatArray, planes: FloatArray = LEVEL) -> float:
    """Return kinetic, gravitational and elastic energy (springs, bars, stops, tyres), J."""
    c, b = car
    turn, at = attitude(state), hubs(car, state)
    v = state[[V_X, V_Y, V_Z]]
    rates = state[[ROLL_RATE, PITCH_RATE, YAW_RATE]]
    place = np.array([b.sprung_x, 0.0, b.sprung_z])
    masses = np.array([b.unsprung_f] * 2 + [b.unsprung_r] * 2)
    travel = state[TRAVEL : TRAVEL + 4]

    inertia = np.diag([b.sprung_inertia_xx, b.sprung_inertia_yy, b.sprung_inertia_zz])
    inertia[0, 2] = inertia[2, 0] = -b.sprung_inertia_xz
    shift = b.sprung_mass * (place @ place * np.eye(3) - np.outer(place, place))
    sprung = v + np.cross(rates, place)
    kinetic = 0.5 * b.sprung_mass * sprung @ sprung + 0.5 * rates @ (inertia - shift) @ rates
    at_design = at - np.column_stack([np.zeros((4, 2)), travel])
    moving = v + np.cross(rates, at_design)
    moving[:, 2] += state[TRAVEL_RATE : TRAVEL_RATE + 4]
    kinetic += 0.5 * masses @ np.square(moving).sum(axis=1)
    kinetic += 0.5 * c.wheel_inertia * np.square(state[OMEGA : OMEGA + 4]).sum()

    held = 0.0
    for i in range(4):
        k = corner(b, i < 2)
        over = max(abs(travel[i]) - b.travel, 0.0)
        held += k.static * travel[i] + 0.5 * k.spring * travel[i] ** 2
        held += 0.5 * b.stop_stiffness * over**2
        held += 0.25 * k.bar * (travel[i] - travel[i ^ 1]) ** 2
        normal = turn.T @ planes[i, 1:4]
        height = planes[i, 1:4] @ state[[X, Y, Z]] - planes[i, 4] + normal @ at[i]
        sinking = c.wheel_radius * math.sqrt(1.0 - normal[1] ** 2) - height
        sunk = max(sinking + k.load / k.tyre_stiffness, 0.0)
        held += 0.5 * k.tyre_stiffness * sunk**2
    height = state[Z] * c.mass + turn[2] @ (b.sprung_mass * place + masses @ at)
    return float(kinetic + held + GRAVITY * height)


def offsets(drive: SimulatedDrive) -> np.ndarray:
    """Return the lateral offset from the route at each tick, left positive, m."""
    table, spacing = drive.route.table, drive.route.spacing
    places = zip(drive.arc_length, drive.pose, strict=True)
    return np.array([locate(table, spacing, s, x, y)[1] for s, (x, y, _) in places])
