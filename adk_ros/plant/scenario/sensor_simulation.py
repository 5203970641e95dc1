# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sample the simulated truth into noisy, delayed sensor streams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.plant.environment.road import Route
from adk_ros.plant.scenario.further_sensors import attitude_stream, wheel_stream
from adk_ros.plant.scenario.run_setup import RunSetup
from adk_ros.plant.scenario.scenario_file import Scenario
from adk_ros.plant.scenario.sensors import (
    Sensors,
    Stream,
    command_stream,
    imu_stream,
    odometry_stream,
    stamps,
)
from adk_ros.plant.vehicle.seven_dof import STEP
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle
from adk_ros.signals.channels import TICK_NS, Reading, Record, Source

START_NS = 1_760_000_000_000_000_000
"""Stamp of the start of every drive, ns since 1970: a round number and a multiple of the tick."""
TICK = round(TICK_NS * 1e-9 / STEP)
"""Integration steps in a tick."""
TRUTH_SIZE = 9
T_A_X, T_A_Y, T_YAW_RATE, T_V_X, T_V_Y, T_X, T_Y, T_HEADING, T_ARC_LENGTH = range(TRUTH_SIZE)
"""Columns of the truth, one row per integration step."""


@dataclass(frozen=True)
class SimulatedDrive:
    """
    A simulated drive: the truth on the 25 ms grid and the sensor streams.

    `stamp_ns` (n,); `x` (n, 3) v_x, v_y, yaw rate; `u` (n, 2) command in force from the tick on;
    `a` (n, 2) specific force; `pose` (n, 3) x, y, heading; `arc_length` (n,) along the
    route, m; `streams` by source. `readings`: all streams merged in order of arrival, `log_ns`
    (m,) their arrival times.

    To continue the simulation from any grid row (see `oracle`): `plant`, `route`, the full
    `states` (n, size), the `wind` (n, 2), and the true `commands` (k, 2), each in force from
    integration step `command_step` (k,) on.
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
    arc_length: FloatArray
    streams: dict[Source, Stream]
    readings: list[Reading]
    log_ns: IntArray
    plant: str
    route: Route
    states: FloatArray
    wind: FloatArray
    commands: FloatArray
    command_step: IntArray
    attitude: Stream | None = None
    """Roll and pitch at the stamps of the IMU, if its sensors report them."""
    wheels: Stream | None = None

    def truth(self) -> Record:
        """Return the truth as a record, as from perfect sensors on the grid."""
        zeros = np.zeros(self.stamp_ns.shape[0], dtype=np.int64)
        return Record(
            self.stamp_ns, self.x, self.u, self.a, zeros, self.x.copy(), zeros.copy(), self.name
        )


def _at(truth: FloatArray, at_ns: IntArray, columns: list[int]) -> FloatArray:
    """Interpolate columns of the truth linearly at times `at_ns` (m,): (m, len(columns))."""
    position = at_ns * (1e-9 / STEP)
    whole = np.minimum(position.astype(np.int64), truth.shape[0] - 2)
    share = (position - whole)[:, None]
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


def simulate_sensors(
    scenario: Scenario,
    setting: RunSetup,
    truth: FloatArray,
    commands: FloatArray,
    vehicle: Vehicle,
    route: Route,
    plant: str,
    states: FloatArray,
) -> SimulatedDrive:
    """
    Return the drive with `truth` (steps + 1, TRUTH_SIZE) as its sensors measure it.

    `commands` (count, 2) as numbered by `setting`; `states` (ticks + 1, size) of the plant, or
    (0, 0) for a simulator that cannot be continued from its states.
    """
    sensors, rngs, seconds = scenario.sensors, setting.rngs, setting.seconds
    given_ns = setting.command_steps() * round(STEP * 1e9)
    streams: dict[Source, Stream] = {}
    if sensors.imu is not None:
        at = stamps(sensors.imu, seconds)
        columns = [T_A_X, T_A_Y, T_YAW_RATE]
        streams[Source.IMU] = imu_stream(rngs[1], sensors.imu, at, _at(truth, at, columns))
    at = stamps(sensors.odometry, seconds)
    columns = [T_V_X, T_V_Y, T_YAW_RATE, T_X, T_Y, T_HEADING]
    streams[Source.ODOMETRY] = odometry_stream(
        rngs[2], sensors.odometry, at, _at(truth, at, columns)
    )
    streams[Source.COMMAND] = command_stream(rngs[3], sensors.command, given_ns, commands)
    grid = truth[::TICK]
    attitude = wheels = None
    if sensors.imu is not None and sensors.imu.attitude_noise is not None:
        distance = grid[:, T_ARC_LENGTH]
        attitude = attitude_stream(
            setting.seed, sensors.imu, streams[Source.IMU], route, distance, states
        )
    if sensors.wheels is not None and states.size:
        wheels = wheel_stream(setting.seed, sensors.wheels, seconds, states)
    streams = {source: _dated(stream) for source, stream in streams.items()}
    readings, log_ns = _merge(streams)

    grid_ns = np.arange(grid.shape[0], dtype=np.int64) * TICK_NS
    # A command stamped on a tick acts from it on; command 0 acts from the start.
    acting = np.maximum(np.searchsorted(given_ns, grid_ns, side="right") - 1, 0)
    return SimulatedDrive(
        name=scenario.name,
        seed=setting.seed,
        vehicle=vehicle,
        sensors=sensors,
        stamp_ns=grid_ns + START_NS,
        x=grid[:, [T_V_X, T_V_Y, T_YAW_RATE]].copy(),
        u=commands[acting],
        a=grid[:, [T_A_X, T_A_Y]].copy(),
        pose=grid[:, [T_X, T_Y, T_HEADING]].copy(),
        arc_length=grid[:, T_ARC_LENGTH].copy(),
        streams=streams,
        readings=readings,
        log_ns=log_ns,
        plant=plant,
        route=route,
        states=states,
        wind=setting.wind,
        commands=commands,
        command_step=np.maximum(setting.command_steps(), 0),
        attitude=None if attitude is None else _dated(attitude),
        wheels=None if wheels is None else _dated(wheels),
    )


def _dated(stream: Stream) -> Stream:
    """Return a stream whose times count from 1970."""
    return Stream(stream.stamp_ns + START_NS, stream.log_ns + START_NS, stream.values)
