# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives the package's plant with something concealed between the commands and the car.

The plant (seven or fourteen degrees of freedom, spinning wheels, its own tyres; or the car of
`spring_car`) shares no code with the stand-in of the mismatch tool. Commands are recorded as
given; what the car gets of them, what pushes it besides, and what its sensors make of it is
changed by a `Changes`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adk_ros.bench.mismatch import sprung_car
from adk_ros.bench.mismatch.sprung_car import step_spring_car
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

TICK = 25
"""Integration steps of 1 ms between commands."""
PLANTS = ("seven_dof", "fourteen_dof", "spring_car")
"""Simulators that something can be concealed in; the last is of another family altogether."""
_FOURTEEN, _SPRING = 1, 2
TRUTH = 11
"""Columns of the truth: a_x, a_y, yaw rate, v_x, v_y, x, y, heading, place, time, yaw acc."""


class InjectedChanges(NamedTuple):
    """What is concealed; the defaults change nothing. SI; delays in ms; from `onset` s on."""

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
    half_gap: float = 0.0
    compliance: float = 0.0
    side_drag: float = 0.0
    wind_x: float = 0.0
    wind_y: float = 0.0
    wind_from: float = -1.0
    """Between these distances along the lap the crosswind blows; negative: everywhere."""
    wind_to: float = -1.0
    lift_area: float = 0.0
    """m^2; of the spring car alone, as is the next."""
    rear_steer: float = 0.0
    # What no catalogue lists.
    locked_differential: float = 0.0
    """m/s^2: yaw acceleration against the relative wheel-speed difference r / v_x."""
    torque_steer: float = 0.0
    """1/(kg m): lateral acceleration per commanded torque."""
    shimmy: float = 0.0
    """rad/s^2: yaw acceleration that oscillates with the speed, sin(1.5 v_x)."""
    yaw_damping: float = 0.0
    """1/s: yaw acceleration against the yaw rate."""
    scrub_drag: float = 0.0
    """s^2/m: deceleration by the lateral acceleration squared."""
    torque_vectoring: float = 0.0
    """1/(kg m^2 rad): yaw acceleration per torque times steering angle."""
    steering_drag: float = 0.0
    """m/s^2 per rad: deceleration by the steering angle's size."""


@strict_kernel
def _run(
    plant: int,
    c: Constants,
    later: Constants,
    b: SprungMass,
    later_b: SprungMass,
    driver: Constants,
    table: FloatArray,
    later_table: FloatArray,
    spacing: float,
    added: FloatArray,
    h: InjectedChanges,
    place: float,
    state: FloatArray,
    truth: FloatArray,
    commands: FloatArray,
) -> None:
    road = np.empty((4, 5))
    work = np.empty((5, state.shape[0]))
    command = np.zeros(2)
    s, integral = place, 0.0
    play, steered, driven, a_y = 0.0, 0.0, 0.0, 0.0
    steps = truth.shape[0]
    for n in range(steps):
        s, across, road_heading = locate(table, spacing, s, state[X], state[Y])
        now = n // TICK
        if n % TICK == 0:
            torque, delta, integral = driver_command(
                driver,
                table,
                spacing,
                (s, across, road_heading),
                (state[V_X], state[V_Y]),
                state[HEADING],
                added[now],
                integral,
                TICK * STEP,
            )
            commands[now, 0], commands[now, 1] = torque, delta
            if n == 0:
                play = steered = delta
                driven = torque
        acts = n * STEP >= h.onset
        speed = max(state[V_X], 1.0)
        late_t = max(n - h.torque_delay_ms, 0) // TICK if acts else now
        late_d = max(n - h.steer_delay_ms, 0) // TICK if acts else now
        torque, delta = commands[late_t, 0], commands[late_d, 1]
        if acts:
            torque *= h.torque_gain * (h.brake_gain if torque < 0.0 else 1.0)
            delta *= h.steer_gain
            play = min(max(play, delta - h.half_gap), delta + h.half_gap)
            delta = play
        keep = math.exp(-STEP / h.steer_lag) if acts and h.steer_lag > 0.0 else 0.0
        steered = delta + (steered - delta) * keep
        keep = math.exp(-STEP / h.torque_lag) if acts and h.torque_lag > 0.0 else 0.0
        driven = torque + (driven - torque) * keep
        command[0], command[1] = driven, steered
        push_x, push_y, turn = 0.0, 0.0, 0.0
        wind_x, wind_y = 0.0, 0.0
        if acts:
            command[0] = min(driven + h.torque_offset, h.power * c.wheel_radius / speed)
            command[1] = steered + h.steer_offset - h.compliance * a_y
            drag = h.side_drag / c.wheel_radius
            push_x = -2.0 * abs(drag) / c.mass
            turn = drag * c.track_width / c.yaw_inertia
            turn -= h.locked_differential * state[YAW_RATE] / speed
            turn += h.shimmy * math.sin(1.5 * state[V_X]) - h.yaw_damping * state[YAW_RATE]
            turn += h.torque_vectoring * driven * steered
            push_x -= h.scrub_drag * a_y * a_y + h.steering_drag * abs(steered)
            push_y = h.torque_steer * commands[now, 0]
            blows = h.wind_from < 0.0
            if not blows:
                at = s % (spacing * (table.shape[0] - 1))
                blows = h.wind_from <= at <= h.wind_to
            cos, sin = math.cos(state[HEADING]), math.sin(state[HEADING])
            across_wind = h.wind_y if blows else 0.0
            wind_x = h.wind_x * cos - across_wind * sin
            wind_y = h.wind_x * sin + across_wind * cos
        row = truth[n]
        row[2], row[3], row[4] = state[YAW_RATE], state[V_X], state[V_Y]
        row[5], row[6], row[7], row[8] = state[X], state[Y], state[HEADING], s
        row[9] = n * STEP
        before = state[YAW_RATE]
        car = later if acts else c
        ground = later_table if acts else table
        if plant == _SPRING:
            surface = (
                lookup(ground, spacing, s, ROAD_MU),
                lookup(ground, spacing, s, ROAD_GRADE),
                lookup(ground, spacing, s, ROAD_BANK),
            )
            a_x, a_y = step_spring_car(
                car,
                state,
                command,
                surface,
                (wind_x, wind_y),
                h.lift_area if acts else 0.0,
                h.rear_steer if acts else 0.0,
                STEP,
            )
        else:
            a_x, a_y = step_on_route(
                plant == _FOURTEEN,
                car,
                later_b if acts else b,
                ground,
                spacing,
                s,
                (wind_x, wind_y),
                state,
                command,
                road,
                work,
            )
        state[V_X] += STEP * push_x
        state[V_Y] += STEP * push_y
        state[YAW_RATE] += STEP * turn
        row[0], row[1] = a_x + push_x, a_y + push_y
        row[10] = (state[YAW_RATE] - before) / STEP


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
    Drive `car` (`before` the onset: that) with the driver of `vehicle` along a route.

    From the onset on the road is that of `later`, laid out alike.

    Returns truth (n, TRUTH) every millisecond, commands (m, 2), and their stamps in ms (m,).
    """
    steps = round(seconds / STEP)
    count = steps // TICK + 1
    rng = np.random.default_rng(seed)
    excitation = Excitation(steer=0.003, torque=150.0, torque_step=200.0)
    added = excitation_signals(rng, count, TICK * STEP, excitation, SpeedPlan(variation=0.05))
    which = PLANTS.index(plant)
    constants = car.constants()
    bodies = [resolve(v) if which == _FOURTEEN else NO_SPRUNG_MASS for v in (before or car, car)]
    x, y, heading, speed = (
        lookup(route.table, route.spacing, start, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    if which == _FOURTEEN:
        plane = np.empty(5)
        tangent_plane(route.table, route.spacing, start, x, y, plane)
        state = rolling_on_plane(constants, speed, plane, x, y, heading)
    elif which == _SPRING:
        state = np.zeros(sprung_car.STATE_SIZE)
        state[[V_X, X, Y, HEADING]] = speed, x, y, heading
    else:
        state = rolling_state(constants, speed, x, y, heading)
    truth = np.empty((steps + 1, TRUTH))
    commands = np.zeros((count, 2))
    run: Any = _run
    run(
        which,
        (before or car).constants(),
        constants,
        *bodies,
        vehicle.constants(),
        route.table,
        (later or route).table,
        route.spacing,
        added,
        changes,
        start,
        state,
        truth,
        commands,
    )
    return truth, commands, np.arange(count, dtype=np.int64) * TICK
