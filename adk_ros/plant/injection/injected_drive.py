# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulate a drive with an injected mismatch between the recorded commands and the vehicle.

The vehicle has seven or fourteen degrees of freedom with wheel spins, or is `sprung_car`, with
brush tyres, sprung roll and kinematic wheel spins, which labels call `spring_car`. It shares no
code with the surrogate model of `adk mismatch`. Commands are recorded as given; `InjectedChanges`
alter the actuation, add forces and change the air and the road.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import (
    ROAD_BANK,
    ROAD_GRADE,
    ROAD_HEADING,
    ROAD_MU,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    Route,
    locate,
    lookup,
)
from adk_ros.plant.environment.surface import tangent_plane
from adk_ros.plant.injection import sprung_car
from adk_ros.plant.injection.injected_changes import (
    STEPS_PER_COMMAND,
    InjectedChanges,
    act,
    start_memory,
)
from adk_ros.plant.injection.sprung_car import step_sprung_car
from adk_ros.plant.injection.unlisted_changes import MEMORY_SIZE, Motion
from adk_ros.plant.scenario.driver import Excitation, SpeedPlan, driver_command, excitation_signals
from adk_ros.plant.scenario.route_step import step_on_route
from adk_ros.plant.vehicle.fourteen_dof import rolling_state as rolling_on_plane
from adk_ros.plant.vehicle.seven_dof import HEADING, STEP, V_X, V_Y, YAW_RATE, X, Y, rolling_state
from adk_ros.plant.vehicle.sprung_mass import NO_SPRUNG_MASS, SprungMass, resolve
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Vehicle

PLANTS = ("seven_dof", "fourteen_dof", "spring_car")
"""Simulators for injection; the last has other tyres and no wheel spins."""
_FOURTEEN, _SPRUNG = 1, 2
TRUTH = 11
"""Columns of the truth: a_x, a_y, yaw rate, v_x, v_y, x, y, heading, arc length, time, yaw
acceleration."""


class _Plant(NamedTuple):
    """Vehicle and road as they are before, or from, the onset."""

    constants: Constants
    body: SprungMass
    table: FloatArray
    """Route table (n + 1, ROAD_SIZE); those before and from the onset have the same spacing."""


class _Inputs(NamedTuple):
    """Inputs that hold for the whole drive."""

    driver: Constants
    """Vehicle parameters of the driver model."""
    spacing: float
    added: FloatArray
    """Excitation, one row per command: see `excitation_signals`."""
    changes: InjectedChanges


@strict_kernel
def _run(
    kind: int,
    before: _Plant,
    after: _Plant,
    inputs: _Inputs,
    start: float,
    state: FloatArray,
    truth: FloatArray,
    commands: FloatArray,
) -> None:
    """
    Integrate the drive from `state` at arc length `start`; fill `truth` and `commands`.

    `kind` is the index of the simulator in `PLANTS`; `before` and `after` refer to the onset.
    """
    c, table = before.constants, before.table
    driver, spacing, added, h = inputs.driver, inputs.spacing, inputs.added, inputs.changes
    road = np.empty((4, 5))
    work = np.empty((5, state.shape[0]))
    command = np.zeros(2)
    memory = np.zeros(MEMORY_SIZE)
    lap = spacing * (table.shape[0] - 1)
    s, integral, a_y = start, 0.0, 0.0
    for n in range(truth.shape[0]):
        s, across, road_heading = locate(table, spacing, s, state[X], state[Y])
        command_row = n // STEPS_PER_COMMAND
        if n % STEPS_PER_COMMAND == 0:
            torque, delta, integral = driver_command(
                driver,
                table,
                spacing,
                (s, across, road_heading),
                (state[V_X], state[V_Y]),
                state[HEADING],
                added[command_row],
                integral,
                STEPS_PER_COMMAND * STEP,
            )
            commands[command_row, 0], commands[command_row, 1] = torque, delta
            if n == 0:
                start_memory(memory, torque, delta)
        active = n * STEP >= h.onset
        motion = Motion(
            n * STEP, s, lap, state[V_X], state[V_Y], state[YAW_RATE], state[HEADING], a_y
        )
        action = act(c, h, motion, commands, n, memory)
        command[0], command[1] = action.torque, action.delta
        wind = (action.wind_x, action.wind_y)
        row = truth[n]
        row[2], row[3], row[4] = state[YAW_RATE], state[V_X], state[V_Y]
        row[5], row[6], row[7], row[8] = state[X], state[Y], state[HEADING], s
        row[9] = n * STEP
        yaw_rate = state[YAW_RATE]
        current_plant = after if active else before
        if kind == _SPRUNG:
            surface = (
                lookup(current_plant.table, spacing, s, ROAD_MU),
                lookup(current_plant.table, spacing, s, ROAD_GRADE),
                lookup(current_plant.table, spacing, s, ROAD_BANK),
            )
            a_x, a_y = step_sprung_car(
                current_plant.constants,
                state,
                command,
                surface,
                wind,
                h.lift_area if active else 0.0,
                h.rear_steer if active else 0.0,
                STEP,
            )
        else:
            a_x, a_y = step_on_route(
                kind == _FOURTEEN,
                current_plant.constants,
                current_plant.body,
                current_plant.table,
                spacing,
                s,
                wind,
                state,
                command,
                road,
                work,
            )
        state[V_X] += STEP * action.added_x
        state[V_Y] += STEP * action.added_y
        state[YAW_RATE] += STEP * action.added_yaw
        row[0], row[1] = a_x + action.added_x, a_y + action.added_y
        row[10] = (state[YAW_RATE] - yaw_rate) / STEP


def simulate_injected_drive(
    vehicle: Vehicle,
    car: Vehicle,
    route: Route,
    changes: InjectedChanges,
    seed: int,
    seconds: float,
    plant: str = "seven_dof",
    start: float = 0.0,
    before: Vehicle | None = None,
    later: Route | None = None,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """
    Drive `car` along a route; the driver's model is `vehicle`.

    Until the onset the car is `before`, if given. From the onset the road is `later`, if given,
    which has the layout of `route`.

    Returns truth (n, TRUTH) every millisecond, commands (m, 2), and their stamps (m,), ms.
    """
    steps = round(seconds / STEP)
    count = steps // STEPS_PER_COMMAND + 1
    added = excitation(seed, count)
    kind = PLANTS.index(plant)
    constants = car.constants()
    first_plant = _plant(before or car, route, kind)
    later_plant = _plant(car, later or route, kind)
    x, y, heading, speed = (
        lookup(route.table, route.spacing, start, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    if kind == _FOURTEEN:
        plane = np.empty(5)
        tangent_plane(route.table, route.spacing, start, x, y, plane)
        state = rolling_on_plane(constants, speed, plane, x, y, heading)
    elif kind == _SPRUNG:
        state = np.zeros(sprung_car.STATE_SIZE)
        state[[V_X, X, Y, HEADING]] = speed, x, y, heading
    else:
        state = rolling_state(constants, speed, x, y, heading)
    truth = np.empty((steps + 1, TRUTH))
    commands = np.zeros((count, 2))
    inputs = _Inputs(vehicle.constants(), route.spacing, added, changes)
    _run(kind, first_plant, later_plant, inputs, start, state, truth, commands)
    return truth, commands, np.arange(count, dtype=np.int64) * STEPS_PER_COMMAND


def _plant(vehicle: Vehicle, route: Route, kind: int) -> _Plant:
    body = resolve(vehicle) if kind == _FOURTEEN else NO_SPRUNG_MASS
    return _Plant(vehicle.constants(), body, route.table)


def excitation(seed: int, count: int) -> FloatArray:
    """Return the excitation that every generated drive has, (count, 5): one row per command."""
    size = Excitation(steer=0.003, torque=150.0, torque_step=200.0)
    return excitation_signals(
        np.random.default_rng(seed),
        count,
        STEPS_PER_COMMAND * STEP,
        size,
        SpeedPlan(variation=0.05),
    )
