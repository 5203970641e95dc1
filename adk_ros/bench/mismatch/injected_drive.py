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

import math
from typing import NamedTuple

import numpy as np

from adk_ros.bench.mismatch import sprung_car
from adk_ros.bench.mismatch.sprung_car import step_sprung_car
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
from adk_ros.plant.scenario.driver import Excitation, SpeedPlan, driver_command, excitation_signals
from adk_ros.plant.scenario.route_step import step_on_route
from adk_ros.plant.vehicle.fourteen_dof import rolling_state as rolling_on_plane
from adk_ros.plant.vehicle.seven_dof import HEADING, STEP, V_X, V_Y, YAW_RATE, X, Y, rolling_state
from adk_ros.plant.vehicle.sprung_mass import NO_SPRUNG_MASS, SprungMass, resolve
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Vehicle

STEPS_PER_COMMAND = 25
"""Integration steps of 1 ms between commands."""
PLANTS = ("seven_dof", "fourteen_dof", "spring_car")
"""Simulators for injection; the last has other tyres and no wheel spins."""
_FOURTEEN, _SPRUNG = 1, 2
TRUTH = 11
"""Columns of the truth: a_x, a_y, yaw rate, v_x, v_y, x, y, heading, arc length, time, yaw
acceleration."""


TORQUE_CUT_FROM = 2.5
"""Lateral acceleration above which drive torque is cut, m/s²."""
SLOSH_FREQUENCY_HZ, SLOSH_DAMPING = 0.5, 0.06
"""Natural frequency and damping ratio of a load that moves sideways."""
PERIODIC_YAW_HZ, PERIODIC_YAW_FROM = 0.28, 9.0
"""Frequency of the periodic yaw acceleration, and the speed above which it acts, m/s."""


class InjectedChanges(NamedTuple):
    """Injected changes, active from `onset`, s; the defaults change nothing. SI, delays in ms."""

    onset: float = 0.0
    torque_gain: float = 1.0
    brake_gain: float = 1.0
    torque_offset: float = 0.0
    torque_delay_ms: int = 0
    torque_lag: float = 0.0
    power: float = 1e12
    steer_gain: float = 1.0
    steer_offset: float = 0.0
    steer_delay_ms: int = 0
    steer_lag: float = 0.0
    half_backlash: float = 0.0
    """Half of the steering backlash, rad at the road wheels."""
    compliance: float = 0.0
    one_side_brake_torque: float = 0.0
    """Torque of dragging brakes, N·m per wheel; left side positive, right side negative."""
    wind_x: float = 0.0
    wind_y: float = 0.0
    wind_from: float = -1.0
    """The crosswind acts between these arc lengths of the lap, m; negative: everywhere."""
    wind_to: float = -1.0
    lift_area: float = 0.0
    """Lift area, m²; sprung car only, like `rear_steer`."""
    rear_steer: float = 0.0
    # Effects that are not in the catalogue of `adk mismatch`.
    locked_differential: float = 0.0
    """Opposing yaw acceleration per relative wheel-speed difference r / v_x, m/s²."""
    torque_lateral_acceleration: float = 0.0
    """Lateral acceleration per commanded torque, 1/(kg·m)."""
    speed_periodic_yaw: float = 0.0
    """Amplitude of a yaw acceleration that oscillates with the speed, sin(1.5 v_x), rad/s²."""
    yaw_damping: float = 0.0
    """Opposing yaw acceleration per yaw rate, 1/s."""
    scrub_drag: float = 0.0
    """Deceleration per lateral acceleration squared, s²/m."""
    torque_vectoring: float = 0.0
    """Yaw acceleration per torque times steering angle, 1/(kg·m²·rad)."""
    steering_drag: float = 0.0
    """Deceleration per magnitude of the steering angle, m/s² per rad."""
    torque_cut: float = 0.0
    """Share of the drive torque that is cut above `TORQUE_CUT_FROM` of lateral acceleration."""
    sloshing_load: float = 0.0
    """Share of the car's mass that moves sideways at `SLOSH_FREQUENCY_HZ`."""
    time_periodic_yaw: float = 0.0
    """Amplitude of a yaw acceleration that oscillates in time above a speed, rad/s²."""


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
    s, integral = start, 0.0
    backlash_out, delta_out, torque_out, a_y = 0.0, 0.0, 0.0, 0.0
    omega = 2.0 * math.pi * SLOSH_FREQUENCY_HZ
    load_y, load_speed = 0.0, 0.0
    steps = truth.shape[0]
    for n in range(steps):
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
                backlash_out = delta_out = delta
                torque_out = torque
        active = n * STEP >= h.onset
        speed = max(state[V_X], 1.0)
        torque_row = max(n - h.torque_delay_ms, 0) // STEPS_PER_COMMAND if active else command_row
        delta_row = max(n - h.steer_delay_ms, 0) // STEPS_PER_COMMAND if active else command_row
        torque, delta = commands[torque_row, 0], commands[delta_row, 1]
        if active:
            torque *= h.torque_gain * (h.brake_gain if torque < 0.0 else 1.0)
            delta *= h.steer_gain
            backlash_out = min(max(backlash_out, delta - h.half_backlash), delta + h.half_backlash)
            delta = backlash_out
        keep = math.exp(-STEP / h.steer_lag) if active and h.steer_lag > 0.0 else 0.0
        delta_out = delta + (delta_out - delta) * keep
        keep = math.exp(-STEP / h.torque_lag) if active and h.torque_lag > 0.0 else 0.0
        torque_out = torque + (torque_out - torque) * keep
        command[0], command[1] = torque_out, delta_out
        # Accelerations besides those of the vehicle model, m/s² and rad/s².
        added_x, added_y, added_yaw = 0.0, 0.0, 0.0
        wind_x, wind_y = 0.0, 0.0
        if active:
            command[0] = min(torque_out + h.torque_offset, h.power * c.wheel_radius / speed)
            if command[0] > 0.0 and abs(a_y) > TORQUE_CUT_FROM:
                command[0] *= 1.0 - h.torque_cut
            command[1] = delta_out + h.steer_offset - h.compliance * a_y
            drag = h.one_side_brake_torque / c.wheel_radius
            added_x = -2.0 * abs(drag) / c.mass
            added_yaw = drag * c.track_width / c.yaw_inertia
            added_yaw -= h.locked_differential * state[YAW_RATE] / speed
            added_yaw += h.speed_periodic_yaw * math.sin(1.5 * state[V_X])
            added_yaw -= h.yaw_damping * state[YAW_RATE]
            added_yaw += h.torque_vectoring * torque_out * delta_out
            added_x -= h.scrub_drag * a_y * a_y + h.steering_drag * abs(delta_out)
            added_y = h.torque_lateral_acceleration * commands[command_row, 0]
            load_force = omega * omega * load_y + 2.0 * SLOSH_DAMPING * omega * load_speed
            added_y -= h.sloshing_load * load_force
            load_speed += STEP * (a_y + added_y - load_force)
            load_y += STEP * load_speed
            if state[V_X] > PERIODIC_YAW_FROM:
                phase = 2.0 * math.pi * PERIODIC_YAW_HZ * n * STEP
                added_yaw += h.time_periodic_yaw * math.cos(phase)
            in_wind = h.wind_from < 0.0
            if not in_wind:
                at = s % (spacing * (table.shape[0] - 1))
                in_wind = h.wind_from <= at <= h.wind_to
            cos, sin = math.cos(state[HEADING]), math.sin(state[HEADING])
            crosswind = h.wind_y if in_wind else 0.0
            wind_x = h.wind_x * cos - crosswind * sin
            wind_y = h.wind_x * sin + crosswind * cos
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
                (wind_x, wind_y),
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
                (wind_x, wind_y),
                state,
                command,
                road,
                work,
            )
        state[V_X] += STEP * added_x
        state[V_Y] += STEP * added_y
        state[YAW_RATE] += STEP * added_yaw
        row[0], row[1] = a_x + added_x, a_y + added_y
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
    rng = np.random.default_rng(seed)
    excitation = Excitation(steer=0.003, torque=150.0, torque_step=200.0)
    added = excitation_signals(
        rng, count, STEPS_PER_COMMAND * STEP, excitation, SpeedPlan(variation=0.05)
    )
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
