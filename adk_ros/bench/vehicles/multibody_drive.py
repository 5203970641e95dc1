# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drive the multi-body model along a route, with the driver and the injected changes of all plants.

Torque T enters as the acceleration T / (m R), which the model converts back: driving at the rear
axle, braking at both. The steering angle is set, since the model's steering is a rate limit
without dynamics. Integrated by RK4 at 1 ms. Drag, rolling resistance and added accelerations act
on body and axles.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numba  # type: ignore[import-untyped, unused-ignore]
import numpy as np

from adk_ros.bench.vehicles.multibody import MultibodyVehicle, model
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.plant.environment.road import (
    ROAD_HEADING,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    Route,
    locate,
    lookup,
)
from adk_ros.plant.injection.injected_changes import (
    STEPS_PER_COMMAND,
    InjectedChanges,
    act,
    start_memory,
)
from adk_ros.plant.injection.injected_drive import TRUTH, excitation
from adk_ros.plant.injection.unlisted_changes import MEMORY_SIZE, Motion
from adk_ros.plant.scenario.driver import driver_command
from adk_ros.plant.vehicle.seven_dof import STEP

_X, _Y, _STEER, _V_X, _HEADING, _YAW_RATE, _V_Y = 0, 1, 2, 3, 4, 5, 10
_V_Y_FRONT, _V_Y_REAR = 15, 20
"""Indices of the model's state: velocities of the sprung mass, and of the axles."""
SPUN_V_X = 1.0
"""Speed below which a car has spun: a planned speed is above 5 m/s. Its model divides by it."""


def simulate_multibody_drive(
    vehicle: MultibodyVehicle,
    car: MultibodyVehicle,
    route: Route,
    changes: InjectedChanges,
    seed: int,
    seconds: float,
    start: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """
    Drive `car` along a route; the driver's model is `vehicle`. The road is flat and dry.

    Returns truth and commands as `injected_drive.simulate_injected_drive` does; the truth is
    infinite from the time on at which the car has spun.
    """
    steps = round(seconds / STEP)
    added = excitation(seed, steps // STEPS_PER_COMMAND + 1)
    x, y, heading, speed = (
        lookup(route.table, route.spacing, start, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    parameters = car.parameters()
    state = np.array(
        model().start_state([x, y, 0.0, speed, heading, 0.0, 0.0], parameters), dtype=np.float64
    )
    truth, commands = np.empty((steps + 1, TRUTH)), np.zeros((added.shape[0], 2))
    drivers = vehicle.equivalent().constants()
    constants = car.equivalent().constants()
    _run()(
        (drivers, constants), parameters, (route.table, route.spacing), added, changes, start,
        state, truth, commands,
    )  # fmt: skip
    return truth, commands


@cache
def _run() -> Any:
    """Return the compiled loop; it is compiled in every process that needs it, in about 10 s."""
    rates = model().rates

    @numba.njit(error_model="numpy")
    def derivative(x: Any, u: Any, p: Any) -> Any:
        return np.array(rates(x, u, p))

    @numba.njit(error_model="numpy")
    def run(
        both: Any, p: Any, road: Any, added: Any, h: Any, start: Any, x: Any, truth: Any,
        commands: Any,
    ) -> None:  # fmt: skip
        driver, c = both
        table, spacing = road
        memory = np.zeros(MEMORY_SIZE)
        lap = spacing * (table.shape[0] - 1)
        s, integral, a_y = start, 0.0, 0.0
        for n in range(truth.shape[0]):
            if not x[_V_X] > SPUN_V_X:
                truth[n:] = np.inf
                return
            s, across, road_heading = locate(table, spacing, s, x[_X], x[_Y])
            command_row = n // STEPS_PER_COMMAND
            if n % STEPS_PER_COMMAND == 0:
                torque, delta, integral = driver_command(
                    driver,
                    table,
                    spacing,
                    (s, across, road_heading),
                    (x[_V_X], x[_V_Y]),
                    x[_HEADING],
                    added[command_row],
                    integral,
                    STEPS_PER_COMMAND * STEP,
                )
                commands[command_row, 0], commands[command_row, 1] = torque, delta
                if n == 0:
                    start_memory(memory, torque, delta)
            motion = Motion(n * STEP, s, lap, x[_V_X], x[_V_Y], x[_YAW_RATE], x[_HEADING], a_y)
            action = act(c, h, motion, commands, n, memory)
            x[_STEER] = action.delta
            u = (0.0, action.torque / (p.m * p.R_w))
            k1 = derivative(x, u, p)
            k2 = derivative(x + 0.5 * STEP * k1, u, p)
            k3 = derivative(x + 0.5 * STEP * k2, u, p)
            k4 = derivative(x + STEP * k3, u, p)
            drag = 0.5 * AIR_DENSITY * c.cda * x[_V_X] * abs(x[_V_X]) / c.mass + c.crr * GRAVITY
            along, side = action.added_x - drag, action.added_y
            row = truth[n]
            row[0] = k1[_V_X] - x[_YAW_RATE] * x[_V_Y] + along
            a_y = k1[_V_Y] + x[_YAW_RATE] * x[_V_X]
            row[1] = a_y + side
            row[2], row[3], row[4] = x[_YAW_RATE], x[_V_X], x[_V_Y]
            row[5], row[6], row[7], row[8] = x[_X], x[_Y], x[_HEADING], s
            row[9] = n * STEP
            yaw_rate = x[_YAW_RATE]
            x += STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            x[_V_X] += STEP * along
            x[_V_Y] += STEP * side
            x[_V_Y_FRONT] += STEP * (side + c.cg_to_front_axle * action.added_yaw)
            x[_V_Y_REAR] += STEP * (side - c.cg_to_rear_axle * action.added_yaw)
            x[_YAW_RATE] += STEP * action.added_yaw
            row[10] = (x[_YAW_RATE] - yaw_rate) / STEP

    return run
