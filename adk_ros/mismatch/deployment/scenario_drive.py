# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A stand-in driven along a scenario's route, as `adk simulate` drives a vehicle.

The scenario says road, wind, driver, excitation and sensors; the stand-in's file, with what was
found in a recording, is the car. Between two commands the stand-in runs on its own. What was bound
to a place belongs to the recording's road and is left out; what began at a time acts throughout.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.errors import DataError, UsageError
from adk_ros.files.yaml_file import validate
from adk_ros.mismatch.deployment.surrogate_file import NamedSurrogate, SurrogateFile
from adk_ros.mismatch.library.features import feature_matrix
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.residuals import COMMAND_GRID_S
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    OUTPUTS,
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
from adk_ros.numerics.arrays import FloatArray
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

PLANT = "stand_in"
_MAX_STEP_S = 0.005
_COMMAND_HOLD_S = 0.3
"""How far ahead a command is taken to hold: a fitted dead time may be a little negative."""
_MAX_OFF_ROUTE_M = 30.0


def position_dependent_terms(model: SurrogateFile) -> list[str]:
    """Return what of a file is bound to a place, which a scenario's road has not."""
    road = model.own.road
    curves = [] if road is None else [f"the {name} of its own road" for name in road.curves]
    return curves + [term.effect for term in model.terms if term.where.kind == "place"]


def simulate_scenario(
    source: NamedSurrogate,
    scenario: Scenario,
    seed: int | None = None,
    duration_s: float | None = None,
    progress: Progress | None = None,
) -> SimulatedDrive:
    """
    Drive `scenario` with a stand-in as its car; as `plant.simulate.simulate` otherwise.

    :raises UsageError: as there.
    :raises DataError: the car leaves the road.
    """
    model = source.content
    setting, route = set_up_run(scenario, seed, duration_s), scenario.planned_route()
    driver = _driver(scenario, model)
    c = driver.constants()
    run = _Run(model, setting.seconds)
    s = scenario.start % route.length
    x, y, heading, speed = (
        lookup(route.table, route.spacing, s, column)
        for column in (ROAD_X, ROAD_Y, ROAD_HEADING, ROAD_SPEED)
    )
    if scenario.start_speed is not None:
        speed = scenario.start_speed
    run.state[[S_V_X, S_X, S_Y, S_HEADING]] = max(speed, 0.5), x, y, heading
    stamped = np.maximum(setting.command_steps(), 0)
    ends = np.append(stamped[1:], setting.steps)
    commands = np.zeros((setting.count, 2))
    places = np.zeros(setting.count)
    integral = 0.0
    for k in range(setting.count):
        state = run.state
        s, across, road_heading = locate(route.table, route.spacing, s, state[S_X], state[S_Y])
        places[k] = s
        if abs(across) > _MAX_OFF_ROUTE_M or not np.isfinite(state).all():
            raise DataError(
                f"{source.name}: the car leaves the road of {scenario.name} after "
                f"{stamped[k] * STEP:.0f} s: the scenario is driven harder than this car can"
            )
        torque, delta, integral = driver_command(
            c,
            route.table,
            route.spacing,
            (s, across, road_heading),
            (state[S_V_X], state[S_V_Y]),
            state[S_HEADING],
            setting.added[k],
            integral,
            setting.every * STEP,
        )
        if setting.angles.shape[0]:
            delta = min(max(setting.angles[k], -c.max_steer), c.max_steer)
        commands[k] = torque, delta
        if k == 0:
            run.begin(delta)
        road = [lookup(route.table, route.spacing, s, i) for i in (ROAD_MU, ROAD_GRADE, ROAD_BANK)]
        wind = wind_at(setting.wind, int(stamped[k]), TICK)
        run.advance(stamped[k] * STEP, ends[k] * STEP, torque, delta, road, wind)
        if progress is not None and k % 200 == 0:
            progress(stamped[k] * STEP, setting.seconds)
    truth = run.truth(
        setting.steps, np.interp(STEP * np.arange(setting.steps + 1), stamped * STEP, places)
    )
    return simulate_sensors(
        scenario, setting, truth, commands, driver, route, PLANT, np.empty((0, 0))
    )


def _driver(scenario: Scenario, model: SurrogateFile) -> Vehicle:
    """Return the car that the driver takes it for: the scenario's, of the stand-in's size."""
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
        return validate("stand-in", content, Vehicle)
    except UsageError:
        # A fitted stiffness may lie outside of what a vehicle file may say.
        return scenario.car()


class _Run:
    """The stand-in's run so far: its state, and what it went through."""

    def __init__(self, model: SurrogateFile, seconds: float) -> None:
        self.state = np.zeros(STATE_SIZE)
        self._base = model.acting()
        grid = math.ceil((seconds + 1.0) / COMMAND_GRID_S) + 1
        self._torques, self._angles = np.zeros(grid), np.zeros(grid)
        self._names, self._coefficients = model.coefficients()
        self._felt = np.zeros(2)
        self._ends: list[FloatArray] = []
        self._ends_s: list[FloatArray] = []
        self._middles: list[FloatArray] = []
        self._middles_s: list[FloatArray] = []

    def begin(self, delta: float) -> None:
        """Let the steering stand where the first command wants it."""
        self.state[[S_PLAY, S_STEER, S_STEER_MORE]] = self._base[INDEX["steer_gain"]] * delta

    def advance(
        self,
        begin_s: float,
        end_s: float,
        torque: float,
        delta: float,
        road: list[float],
        wind: tuple[float, float],
    ) -> None:
        """Run from one command to the next."""
        self._hold(begin_s, torque, delta)
        if end_s <= begin_s:
            return
        n = math.ceil((end_s - begin_s) / _MAX_STEP_S - 1e-9)
        step = (end_s - begin_s) / n
        p = self._base.copy()
        p[INDEX["friction"]] *= road[0]
        p[INDEX["grade"]] += road[1]
        p[INDEX["bank"]] += road[2]
        cos, sin = math.cos(self.state[S_HEADING]), math.sin(self.state[S_HEADING])
        p[INDEX["wind_x"]] += wind[0] * cos + wind[1] * sin
        p[INDEX["wind_y"]] += wind[1] * cos - wind[0] * sin
        out, states = np.empty((OUTPUTS, n)), np.empty((n + 1, 6))
        none = np.empty(0, dtype=np.int64)
        integrate(
            p,
            none,
            np.empty(0),
            none,
            np.ones((1, n)),
            self._torques,
            self._angles,
            COMMAND_GRID_S,
            begin_s,
            step,
            np.empty(0),
            np.full((n, 3), np.nan),
            np.zeros(3),
            self._extra(n, torque, delta),
            self.state,
            out,
            states,
        )
        self._felt = out[[A_X, A_Y], -1]
        self._ends.append(states[:-1])
        self._ends_s.append(begin_s + step * np.arange(n, dtype=np.float64))
        self._middles.append(out[[A_X, A_Y]].T)
        self._middles_s.append(begin_s + step * (np.arange(n, dtype=np.float64) + 0.5))

    def _hold(self, begin_s: float, torque: float, delta: float) -> None:
        """Let a command hold from now on, in the integrals that the kernel takes them from."""
        first = min(round(begin_s / COMMAND_GRID_S), self._torques.shape[0] - 1)
        last = min(first + math.ceil(_COMMAND_HOLD_S / COMMAND_GRID_S), self._torques.shape[0] - 1)
        ahead = COMMAND_GRID_S * np.arange(last - first + 1)
        self._torques[first : last + 1] = self._torques[first] + torque * ahead
        self._angles[first : last + 1] = self._angles[first] + delta * ahead

    def _extra(self, n: int, torque: float, delta: float) -> FloatArray:
        """Return what features add to the accelerations (n, 3), by the state of now."""
        if not self._names:
            return np.empty((0, 3))
        now = {
            "v_x": self.state[S_V_X],
            "v_y": self.state[S_V_Y],
            "yaw_rate": self.state[S_YAW_RATE],
            "a_x": self._felt[0],
            "a_y": self._felt[1],
            "torque": torque,
            "delta": delta,
        }
        row = (
            feature_matrix(self._names, {k: np.array([x]) for k, x in now.items()})
            @ self._coefficients
        )
        return np.ascontiguousarray(np.repeat(row, n, axis=0))

    def truth(self, steps: int, place: FloatArray) -> FloatArray:
        """Return what was gone through every millisecond, as `plant.heard` takes it."""
        at = STEP * np.arange(steps + 1)
        last = self.state[[S_V_X, S_V_Y, S_YAW_RATE, S_X, S_Y, S_HEADING]]
        ends = np.vstack([*self._ends, last])
        ends_s = np.append(np.concatenate(self._ends_s), at[-1])
        middles, middles_s = np.vstack(self._middles), np.concatenate(self._middles_s)
        truth = np.empty((steps + 1, TRUTH_SIZE))
        for column, (values_, when) in enumerate(
            (
                (middles[:, 0], middles_s),
                (middles[:, 1], middles_s),
                (ends[:, 2], ends_s),
                (ends[:, 0], ends_s),
                (ends[:, 1], ends_s),
                (ends[:, 3], ends_s),
                (ends[:, 4], ends_s),
                (ends[:, 5], ends_s),
            )
        ):
            truth[:, column] = np.interp(at, when, values_)
        truth[:, TRUTH_SIZE - 1] = place
        return truth
