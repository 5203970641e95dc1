# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drive a scenario: the car, its driver and its sensors, from a seed to truth and readings.

The same scenario and seed give the same drive to the last bit. Sensor settings do not touch the
drive, only what is heard of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adk_ros.errors import UsageError
from adk_ros.plant.body import NO_BODY, Body, resolve
from adk_ros.plant.driver import drive, excitation_signals
from adk_ros.plant.fourteen_dof import rolling_state as rolling_on_plane
from adk_ros.plant.jit import kernel
from adk_ros.plant.on_route import STATE_SIZES, step_on_route
from adk_ros.plant.params import Constants, Vehicle
from adk_ros.plant.road import (
    ROAD_HEADING,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    Route,
    locate,
    lookup,
)
from adk_ros.plant.scenarios import Scenario
from adk_ros.plant.sensors import (
    Sensors,
    Stream,
    command_stream,
    imu_stream,
    odometry_stream,
    stamps,
)
from adk_ros.plant.seven_dof import HEADING, STEP, V_X, V_Y, YAW_RATE, X, Y, rolling_state
from adk_ros.plant.surface import tangent_plane
from adk_ros.plant.swept_sine import steering_angles
from adk_ros.plant.wind import wind_at, wind_series
from adk_ros.signals.channels import (
    TICK_NS,
    FloatArray,
    IntArray,
    Reading,
    Record,
    Source,
)

START_NS = 1_760_000_000_000_000_000
"""Stamp of the drive's start: a round time of day, and a multiple of the tick."""

Progress = Callable[[float, float], None]
"""Called with seconds done and seconds in all."""

_TICK = round(TICK_NS * 1e-9 / STEP)
_CHUNK_S = 5.0
_TRUTH_SIZE = 9
_T_A_X, _T_A_Y, _T_YAW_RATE, _T_V_X, _T_V_Y, _T_X, _T_Y, _T_HEADING, _T_PLACE = range(_TRUTH_SIZE)


@dataclass(frozen=True)
class Drive:
    """
    A drive: the truth on the 25 ms grid, and what the sensors sent.

    `stamp_ns` (n,), `x` (n, 3), `u` (n, 2) the command in force from the tick on, `a` (n, 2)
    specific force, `pose` (n, 3) x, y, heading, `place` (n,) metres driven along the route,
    `streams` by source. `readings` are all streams merged in order of arrival, `log_ns` (m,) when.

    And what it takes to drive on from any of the grid's rows as the plant did: `plant`, `route`,
    the full `states` (n, size), the `wind` (n, 2), and the true `commands` (k, 2), each in force
    from integration step `command_step` (k,) on: see `floor`.
    """

    name: str
    seed: int
    vehicle: Vehicle
    sensors: Sensors
    stamp_ns: IntArray
    x: FloatArray
    u: FloatArray
    a: FloatArray
    pose: FloatArray
    place: FloatArray
    streams: dict[Source, Stream]
    readings: list[Reading]
    log_ns: IntArray
    plant: str
    route: Route
    states: FloatArray
    wind: FloatArray
    commands: FloatArray
    command_step: IntArray

    def truth(self) -> Record:
        """Return the truth as a record: what perfect sensors on the grid would give."""
        zeros = np.zeros(self.stamp_ns.shape[0], dtype=np.int64)
        return Record(
            self.stamp_ns, self.x, self.u, self.a, zeros, self.x.copy(), zeros.copy(), self.name
        )


@kernel
def _drive(
    fourteen: bool,
    c: Constants,
    b: Body,
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
    hidden: FloatArray,
    truth: FloatArray,
    states: FloatArray,
    commands: FloatArray,
) -> None:
    """
    Drive steps `first` to `first + steps`, a row of `truth` each; continues where it left off.

    Command k is given at step `phase + (k - 1) every`, the first one at step 0; `hidden` carries
    the place, the speed integral and the command in force from one call to the next. `angles`,
    one a command or none, steer instead of the driver.
    """
    road = np.empty((4, 5))
    work = np.empty((5, state.shape[0]))
    command = hidden[2:4]
    for n in range(first, first + steps):
        s, across, road_heading = locate(table, spacing, hidden[0], state[X], state[Y])
        hidden[0] = s
        if n == 0 or (n >= phase and (n - phase) % every == 0):
            k = 0 if n == 0 else (n - phase) // every + 1
            torque, delta, integral = drive(
                c, table, spacing, (s, across, road_heading), (state[V_X], state[V_Y]),
                state[HEADING], added[k], hidden[1], every * STEP,
            )
            hidden[1] = integral
            if angles.shape[0] > 0:
                delta = min(max(angles[k], -c.max_steer), c.max_steer)
            command[0], command[1] = torque, delta
            commands[k] = command
            if n == 0 and phase == 0:
                commands[1] = command
        row = truth[n]
        row[_T_V_X], row[_T_V_Y], row[_T_YAW_RATE] = state[V_X], state[V_Y], state[YAW_RATE]
        row[_T_X], row[_T_Y], row[_T_HEADING] = state[X], state[Y], state[HEADING]
        row[_T_PLACE] = s
        if n % _TICK == 0:
            states[n // _TICK] = state
        row[_T_A_X], row[_T_A_Y] = step_on_route(
            fourteen, c, b, table, spacing, s, wind_at(wind, n, _TICK), state, command, road, work
        )


def _at(truth: FloatArray, at_ns: IntArray, columns: list[int]) -> FloatArray:
    """Truth between its millisecond rows, linearly, shape (m, len(columns))."""
    place = at_ns * (1e-9 / STEP)
    whole = np.minimum(place.astype(np.int64), truth.shape[0] - 2)
    share = (place - whole)[:, None]
    chosen = truth[:, columns]
    return np.asarray((1.0 - share) * chosen[whole] + share * chosen[whole + 1])


def _merge(streams: dict[Source, Stream]) -> tuple[list[Reading], IntArray]:
    logs = np.concatenate([stream.log_ns for stream in streams.values()])
    readings = [
        Reading(source, stamp, tuple(values))
        for source, stream in streams.items()
        for stamp, values in zip(
            stream.stamp_ns.tolist(),
            stream.values[:, : 2 if source is Source.COMMAND else 3].tolist(),
            strict=True,
        )
    ]
    order = np.argsort(logs, kind="stable")
    return [readings[i] for i in order.tolist()], logs[order]


def _start(scenario: Scenario, c: Constants, route: Route, s: float) -> FloatArray:
    """State at distance `s`, rolling along the route at the scenario's or the plan's speed."""
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
) -> Drive:
    """
    Drive `scenario`; `seed` and `duration_s` replace the scenario's own where they are given.

    `progress` is called with (seconds done, seconds in all) every 5 s of driving. Raises
    `UsageError` for a duration or seed out of range and for a vehicle or route that is none.
    """
    seed = scenario.seed if seed is None else seed
    if seed < 0:
        raise UsageError(f"scenario {scenario.name}: seed must not be negative, got {seed}")
    seconds = scenario.duration_s if duration_s is None else duration_s
    if not 0.1 < seconds <= 36000.0:
        raise UsageError(f"scenario {scenario.name}: duration must be 0.1 to 36000 s: {seconds}")
    vehicle, route = scenario.car(), scenario.planned_route()
    constants, sensors = vehicle.constants(), scenario.sensors
    # One stream of random numbers each, so that no sensor's settings disturb another's noise.
    rngs = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(5)]

    steps = round(seconds / STEP)
    every = round(1.0 / (sensors.command.rate_hz * STEP))
    phase = round(sensors.command.phase_s / STEP) % every
    count = 1 + len(range(phase, steps + 1, every))
    period_s = every * STEP
    added = excitation_signals(
        rngs[0], count, period_s, scenario.excitation, scenario.speed, scenario.start_speed
    )
    angles = np.empty(0)
    if scenario.steering is not None:
        angles = steering_angles(scenario.steering, period_s * np.arange(count, dtype=np.float64))
    wind = wind_series(rngs[4], scenario.wind, steps // _TICK)
    truth = np.empty((steps + 1, _TRUTH_SIZE))
    states = np.empty((steps // _TICK + 1, STATE_SIZES[scenario.plant]))
    commands = np.zeros((count, 2))
    fourteen = scenario.plant == "fourteen_dof"
    body = resolve(vehicle) if fourteen else NO_BODY
    start = scenario.start % route.length
    state = _start(scenario, constants, route, start)
    hidden = np.array([start, 0.0, 0.0, 0.0])
    chunk = round(_CHUNK_S / STEP)
    for first in range(0, steps + 1, chunk):
        _drive(
            fourteen, constants, body, route.table, route.spacing, wind, added, angles,
            every, phase, first, min(chunk, steps + 1 - first), state, hidden, truth, states,
            commands,
        )  # fmt: skip
        if progress is not None:
            progress(min(first + chunk, steps) * STEP, seconds)

    given_ns = (phase + every * np.arange(-1, count - 1)) * round(STEP * 1e9)
    streams: dict[Source, Stream] = {}
    if sensors.imu is not None:
        at = stamps(sensors.imu, seconds)
        columns = [_T_A_X, _T_A_Y, _T_YAW_RATE]
        streams[Source.IMU] = imu_stream(rngs[1], sensors.imu, at, _at(truth, at, columns))
    at = stamps(sensors.odometry, seconds)
    columns = [_T_V_X, _T_V_Y, _T_YAW_RATE, _T_X, _T_Y, _T_HEADING]
    streams[Source.ODOMETRY] = odometry_stream(
        rngs[2], sensors.odometry, at, _at(truth, at, columns)
    )
    streams[Source.COMMAND] = command_stream(rngs[3], sensors.command, given_ns, commands)
    streams = {
        source: Stream(stream.stamp_ns + START_NS, stream.log_ns + START_NS, stream.values)
        for source, stream in streams.items()
    }
    readings, log_ns = _merge(streams)

    grid = truth[::_TICK]
    grid_ns = np.arange(grid.shape[0], dtype=np.int64) * TICK_NS
    # A command stamped on a tick acts from it on; command 0 acts from the start.
    acting = np.maximum(np.searchsorted(given_ns, grid_ns, side="right") - 1, 0)
    return Drive(
        name=scenario.name,
        seed=seed,
        vehicle=vehicle,
        sensors=sensors,
        stamp_ns=grid_ns + START_NS,
        x=grid[:, [_T_V_X, _T_V_Y, _T_YAW_RATE]].copy(),
        u=commands[acting],
        a=grid[:, [_T_A_X, _T_A_Y]].copy(),
        pose=grid[:, [_T_X, _T_Y, _T_HEADING]].copy(),
        place=grid[:, _T_PLACE].copy(),
        streams=streams,
        readings=readings,
        log_ns=log_ns,
        plant=scenario.plant,
        route=route,
        states=states,
        wind=wind,
        commands=commands,
        command_step=np.maximum(phase + every * np.arange(-1, count - 1), 0),
    )
