# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The surrogate model as the car of a scenario, as `adk simulate` drives a vehicle.

The scenario gives road, wind, driver, excitation and sensors; the surrogate's file gives the car.
Between two commands the surrogate runs open loop. Position-dependent terms belong to the
recording's road and are left out; terms that begin at a time act throughout.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adk_ros.errors import DataError, UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.feature_history import FeatureHistory
from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate, SurrogateFile
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.command_integrals import COMMAND_GRID_S, CommandIntegrals
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.run_inputs import no_terms, open_loop_inputs, run_buffers
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    E_HEADING,
    E_V_X,
    E_V_Y,
    E_X,
    E_Y,
    E_YAW_RATE,
    S_HEADING,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_V_X,
    S_V_Y,
    S_X,
    S_Y,
    S_YAW_RATE,
    STATE_SIZE,
)
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import time_scale
from adk_ros.plant.environment.road import (
    ROAD_BANK,
    ROAD_GRADE,
    ROAD_HEADING,
    ROAD_MU,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    locate,
    lookup,
)
from adk_ros.plant.environment.wind import wind_at
from adk_ros.plant.scenario.driver import driver_command
from adk_ros.plant.scenario.run_setup import set_up_run
from adk_ros.plant.scenario.scenario_file import Scenario
from adk_ros.plant.scenario.sensor_simulation import (
    TICK,
    TRUTH_SIZE,
    SimulatedDrive,
    simulate_sensors,
)
from adk_ros.plant.scenario.simulate import Progress
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.vehicle_parameters import Dimensions, Vehicle

PLANT = "surrogate"
_MAX_STEP_S = 0.005
"""s, of a full-size car."""
_COMMAND_HOLD_S = 0.3
"""s that a command is held ahead of the present: an identified delay may be slightly negative."""
_MAX_OFF_ROUTE_M = 30.0
"""m from the route at which the car has left the road."""
_MIN_START_SPEED = 0.5
"""m/s, to keep slip finite."""
_PROGRESS_COMMANDS = 200


def position_dependent_terms(model: SurrogateFile) -> list[str]:
    """Return the terms that depend on a position on the recording's or the simulator's road."""
    road = model.extras.road
    curves = (
        [] if road is None else [f"the {name} of the simulator's road" for name in road.curves]
    )
    return curves + [term.effect for term in model.terms if term.where.kind == "place"]


def simulate_scenario(
    source: NamedSurrogate,
    scenario: Scenario,
    seed: int | None = None,
    duration_s: float | None = None,
    progress: Progress | None = None,
) -> SimulatedDrive:
    """
    Drive `scenario` with a surrogate as its car; otherwise like `plant.scenario.simulate`.

    :raises UsageError: as there.
    :raises DataError: the car leaves the road.
    """
    model = source.content
    driver = _driver_vehicle(scenario, model)
    size = driver.length_scale
    if size != 1.0:
        # The scenario's route is for the size of its vehicle, here the surrogate's.
        scenario = scenario.model_copy(update={"vehicle_changes": driver.model_dump()})
    route, scenario = scenario.planned_route(), scenario.similar(driver)
    setup = set_up_run(scenario, seed, duration_s)
    constants = driver.constants()
    run = _SurrogateRun(model, setup.seconds)
    s = scenario.start % route.length
    x, y, heading, speed = (
        lookup(route.table, route.spacing, s, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    if scenario.start_speed is not None:
        speed = scenario.start_speed
    run.state[[S_V_X, S_X, S_Y, S_HEADING]] = max(speed, _MIN_START_SPEED), x, y, heading
    stamps = np.maximum(setup.command_steps(), 0)
    ends = np.append(stamps[1:], setup.steps)
    commands = np.zeros((setup.count, 2))
    distances = np.zeros(setup.count)
    integral = 0.0
    for k in range(setup.count):
        state = run.state
        s, across, road_heading = locate(route.table, route.spacing, s, state[S_X], state[S_Y])
        distances[k] = s
        if abs(across) > _MAX_OFF_ROUTE_M * size or not np.isfinite(state).all():
            raise DataError(
                f"{source.name}: the car leaves the road of {scenario.name} after "
                f"{stamps[k] * STEP:.0f} s: the scenario's speeds are too high for this car"
            )
        torque, delta, integral = driver_command(
            constants,
            route.table,
            route.spacing,
            (s, across, road_heading),
            (state[S_V_X], state[S_V_Y]),
            state[S_HEADING],
            setup.added[k],
            integral,
            setup.every * STEP,
        )
        if setup.angles.shape[0]:
            delta = min(max(setup.angles[k], -constants.max_steer), constants.max_steer)
        commands[k] = torque, delta
        if k == 0:
            run.begin(delta)
        friction, grade, bank = (
            lookup(route.table, route.spacing, s, i) for i in (ROAD_MU, ROAD_GRADE, ROAD_BANK)
        )
        environment = _Environment(
            friction, grade, bank, wind_at(setup.wind, int(stamps[k]), TICK)
        )
        run.advance((stamps[k] * STEP, ends[k] * STEP), (torque, delta), environment)
        if progress is not None and k % _PROGRESS_COMMANDS == 0:
            progress(stamps[k] * STEP, setup.seconds)
    step_s = STEP * np.arange(setup.steps + 1, dtype=np.float64)
    truth = run.truth(step_s, np.interp(step_s, stamps * STEP, distances))
    return simulate_sensors(
        scenario, setup, truth, commands, driver, route, PLANT, np.empty((0, 0))
    )


def _driver_vehicle(scenario: Scenario, model: SurrogateFile) -> Vehicle:
    """Return the vehicle that the driver model assumes: the scenario's, with known parameters."""
    p = model.vector()
    content = scenario.car().model_dump()
    content |= {name: float(p[INDEX[name]]) for name in Dimensions.model_fields}
    content |= {
        "cda": max(float(p[INDEX["drag_area"]]), 0.0),
        "crr": max(float(p[INDEX["rolling"]]), 0.0),
    }
    for axle, end in (("front_tyre", "f"), ("rear_tyre", "r")):
        # Slip stiffness over load is B C mu.
        tyre = content[axle]
        tyre["b_y"] = float(p[INDEX[f"stiffness_{end}"]]) / (tyre["c_y"] * tyre["mu"])
    try:
        return validate("surrogate", content, Vehicle)
    except UsageError:
        # An identified stiffness may exceed the limits of a vehicle file.
        return scenario.car()


class _Environment(NamedTuple):
    """Road and wind at the car: friction, grade and bank, rad; wind (x, y) of the map, m/s."""

    friction: float
    grade: float
    bank: float
    wind: tuple[float, float]


class _SurrogateRun:
    """The surrogate's state along a scenario, and its history."""

    def __init__(self, model: SurrogateFile, seconds: float) -> None:
        self.state = np.zeros(STATE_SIZE)
        self._parameters = model.vector_with_terms()
        self._max_step_s = _MAX_STEP_S * time_scale(scale_of(self._parameters))
        grid = math.ceil((seconds + 1.0) / COMMAND_GRID_S) + 1
        self._commands = CommandIntegrals(np.zeros(grid), np.zeros(grid), COMMAND_GRID_S)
        features, self._coefficients = model.feature_coefficients()
        self._features = FeatureHistory(features) if features else None
        self._acceleration = np.zeros(2)
        self._ends: list[FloatArray] = []
        self._ends_s: list[FloatArray] = []
        self._middles: list[FloatArray] = []
        self._middles_s: list[FloatArray] = []

    def begin(self, delta: float) -> None:
        """Start with the steering at the first command."""
        angle = self._parameters[INDEX["steer_gain"]] * delta
        self.state[[S_PLAY, S_STEER, S_STEER_MORE]] = angle

    def advance(
        self,
        interval_s: tuple[float, float],
        command: tuple[float, float],
        environment: _Environment,
    ) -> None:
        """Run from one command (torque, angle) to the next."""
        begin_s, end_s = interval_s
        self._hold(begin_s, command)
        if end_s <= begin_s:
            return
        n = math.ceil((end_s - begin_s) / self._max_step_s - 1e-9)
        step = (end_s - begin_s) / n
        p = self._in_environment(environment)
        extra = self._feature_accelerations(n, begin_s, command)
        buffers = run_buffers(self.state, n, keep_end_states=True)
        inputs = open_loop_inputs(self._commands, begin_s, step, n, extra)
        integrate(p, no_terms(n), inputs, buffers)
        self._acceleration = buffers.output[[A_X, A_Y], -1]
        self._ends.append(buffers.end_states[:-1])
        self._ends_s.append(begin_s + step * np.arange(n, dtype=np.float64))
        self._middles.append(buffers.output[[A_X, A_Y]].T)
        self._middles_s.append(begin_s + step * (np.arange(n, dtype=np.float64) + 0.5))

    def _in_environment(self, environment: _Environment) -> FloatArray:
        """Return the parameters on this road and in this wind."""
        wind_x, wind_y = environment.wind
        p: FloatArray = self._parameters.copy()
        p[INDEX["friction"]] *= environment.friction
        p[INDEX["grade"]] += environment.grade
        p[INDEX["bank"]] += environment.bank
        cos, sin = math.cos(self.state[S_HEADING]), math.sin(self.state[S_HEADING])
        p[INDEX["wind_x"]] += wind_x * cos + wind_y * sin
        p[INDEX["wind_y"]] += wind_y * cos - wind_x * sin
        return p

    def _hold(self, begin_s: float, command: tuple[float, float]) -> None:
        """Continue the command integrals with a command held from `begin_s` on."""
        for integral, value in zip(
            (self._commands.torque, self._commands.angle), command, strict=True
        ):
            first = min(round(begin_s / COMMAND_GRID_S), integral.shape[0] - 1)
            last = min(first + math.ceil(_COMMAND_HOLD_S / COMMAND_GRID_S), integral.shape[0] - 1)
            ahead = COMMAND_GRID_S * np.arange(last - first + 1)
            integral[first : last + 1] = integral[first] + value * ahead

    def _feature_accelerations(
        self, n: int, begin_s: float, command: tuple[float, float]
    ) -> FloatArray:
        """Return what the features add to the accelerations (n, 3), at the present state."""
        if self._features is None:
            return np.empty((0, 3))
        signals = {
            "time": begin_s,
            "v_x": self.state[S_V_X],
            "v_y": self.state[S_V_Y],
            "yaw_rate": self.state[S_YAW_RATE],
            "a_x": self._acceleration[0],
            "a_y": self._acceleration[1],
            "torque": command[0],
            "delta": command[1],
        }
        added = self._features.after(signals) @ self._coefficients
        return np.ascontiguousarray(np.repeat(added, n, axis=0))

    def truth(self, at_s: FloatArray, distance: FloatArray) -> FloatArray:
        """Return the history (len, TRUTH_SIZE) that `simulate_sensors` takes, at times `at_s`."""
        last = self.state[[S_V_X, S_V_Y, S_YAW_RATE, S_X, S_Y, S_HEADING]]
        ends = np.vstack([*self._ends, last])
        ends_s = np.append(np.concatenate(self._ends_s), at_s[-1])
        middles, middles_s = np.vstack(self._middles), np.concatenate(self._middles_s)
        columns = [
            (middles[:, 0], middles_s),
            (middles[:, 1], middles_s),
            *((ends[:, i], ends_s) for i in (E_YAW_RATE, E_V_X, E_V_Y, E_X, E_Y, E_HEADING)),
        ]
        truth: FloatArray = np.empty((at_s.shape[0], TRUTH_SIZE))
        for column, (values, stamps_s) in enumerate(columns):
            truth[:, column] = np.interp(at_s, stamps_s, values)
        truth[:, TRUTH_SIZE - 1] = distance
        return truth
