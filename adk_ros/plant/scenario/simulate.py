# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulate a scenario: vehicle, driver and sensors, from a seed to truth and sensor readings.

The same scenario and seed give a bit-identical drive. Sensor settings do not affect the motion,
only the measurements.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import (
    ROAD_HEADING,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    Route,
    locate,
    lookup,
)
from adk_ros.plant.environment.surface import tangent_plane
from adk_ros.plant.environment.wind import wind_at
from adk_ros.plant.scenario.driver import driver_command
from adk_ros.plant.scenario.route_step import STATE_SIZES, step_on_route
from adk_ros.plant.scenario.run_setup import set_up_run
from adk_ros.plant.scenario.scenario_file import Scenario
from adk_ros.plant.scenario.sensor_simulation import (
    T_A_X,
    T_A_Y,
    T_ARC_LENGTH,
    T_HEADING,
    T_V_X,
    T_V_Y,
    T_X,
    T_Y,
    T_YAW_RATE,
    TICK,
    TRUTH_SIZE,
    SimulatedDrive,
    simulate_sensors,
)
from adk_ros.plant.vehicle.fourteen_dof import rolling_state as rolling_on_plane
from adk_ros.plant.vehicle.seven_dof import HEADING, STEP, V_X, V_Y, YAW_RATE, X, Y, rolling_state
from adk_ros.plant.vehicle.sprung_mass import NO_SPRUNG_MASS, SprungMass, resolve
from adk_ros.plant.vehicle.vehicle_parameters import Constants

Progress = Callable[[float, float], None]
"""Called with (seconds done, seconds in all)."""

_CHUNK_S = 5.0
"""Simulated time between two progress reports, s."""


@strict_kernel
def _drive(
    fourteen: bool,
    c: Constants,
    b: SprungMass,
    table: FloatArray,
    spacing: float,
    wind: FloatArray,
    added: FloatArray,
    angles: FloatArray,
    every: int,
    phase: int,
    first: int,
    steps: int,
    state: FloatArray,
    carry: FloatArray,
    truth: FloatArray,
    states: FloatArray,
    commands: FloatArray,
) -> None:
    """
    Simulate steps `first` to `first + steps` from `state`, one row of `truth` each.

    Command k is given at step `phase + (k - 1) every`, the first at step 0. `carry` (4,) passes
    the arc length, the speed integral and the command in force from one call to the next.
    `angles`, one per command or empty, replace the driver's steering.
    """
    road = np.empty((4, 5))
    work = np.empty((5, state.shape[0]))
    command = carry[2:4]
    for n in range(first, first + steps):
        s, across, road_heading = locate(table, spacing, carry[0], state[X], state[Y])
        carry[0] = s
        if n == 0 or (n >= phase and (n - phase) % every == 0):
            k = 0 if n == 0 else (n - phase) // every + 1
            torque, delta, integral = driver_command(
                c,
                table,
                spacing,
                (s, across, road_heading),
                (state[V_X], state[V_Y]),
                state[HEADING],
                added[k],
                carry[1],
                every * STEP,
            )
            carry[1] = integral
            if angles.shape[0] > 0:
                delta = min(max(angles[k], -c.max_steer), c.max_steer)
            command[0], command[1] = torque, delta
            commands[k] = command
            if n == 0 and phase == 0:
                commands[1] = command
        row = truth[n]
        row[T_V_X], row[T_V_Y], row[T_YAW_RATE] = state[V_X], state[V_Y], state[YAW_RATE]
        row[T_X], row[T_Y], row[T_HEADING] = state[X], state[Y], state[HEADING]
        row[T_ARC_LENGTH] = s
        if n % TICK == 0:
            states[n // TICK] = state
        row[T_A_X], row[T_A_Y] = step_on_route(
            fourteen, c, b, table, spacing, s, wind_at(wind, n, TICK), state, command, road, work
        )


def _start(scenario: Scenario, c: Constants, route: Route, s: float) -> FloatArray:
    """Return the state at arc length `s`, rolling along the route at the initial speed."""
    x, y, heading, speed = (
        lookup(route.table, route.spacing, s, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    if scenario.start_speed is not None:
        speed = scenario.start_speed
    if scenario.plant == "seven_dof":
        return rolling_state(c, speed, x, y, heading)
    plane = np.empty(5)
    tangent_plane(route.table, route.spacing, s, x, y, plane)
    return rolling_on_plane(c, speed, plane, x, y, heading)


def simulate(
    scenario: Scenario,
    seed: int | None = None,
    duration_s: float | None = None,
    progress: Progress | None = None,
) -> SimulatedDrive:
    """
    Simulate `scenario`; `seed` and `duration_s`, if given, override those of the scenario.

    `progress` is called with (seconds done, seconds in all) every 5 s of simulated time.
    :raises UsageError: duration or seed out of range, or an invalid vehicle or route.
    """
    vehicle, route = scenario.car(), scenario.planned_route()
    scenario = scenario.similar(vehicle)
    setting = set_up_run(scenario, seed, duration_s)
    constants, steps = vehicle.constants(), setting.steps
    truth = np.empty((steps + 1, TRUTH_SIZE))
    states = np.empty((steps // TICK + 1, STATE_SIZES[scenario.plant]))
    commands = np.zeros((setting.count, 2))
    fourteen = scenario.plant == "fourteen_dof"
    body = resolve(vehicle) if fourteen else NO_SPRUNG_MASS
    start = scenario.start % route.length
    state = _start(scenario, constants, route, start)
    carry = np.array([start, 0.0, 0.0, 0.0])
    chunk = round(_CHUNK_S / STEP)
    for first in range(0, steps + 1, chunk):
        _drive(
            fourteen,
            constants,
            body,
            route.table,
            route.spacing,
            setting.wind,
            setting.added,
            setting.angles,
            setting.every,
            setting.phase,
            first,
            min(chunk, steps + 1 - first),
            state,
            carry,
            truth,
            states,
            commands,
        )
        if progress is not None:
            progress(min(first + chunk, steps) * STEP, setting.seconds)
    return simulate_sensors(
        scenario, setting, truth, commands, vehicle, route, scenario.plant, states
    )
