# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of the surrogate itself that changes on the way, and a watch of it."""

from __future__ import annotations

from functools import cache

import numpy as np

from adk_ros.bench.mismatch.watch_drives import readings_of
from adk_ros.mismatch.library.surrogate_parameters import INDEX, SIZE
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.command_integrals import integrate_commands
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.run_inputs import (
    ActiveTerms,
    no_terms,
    open_loop_inputs,
    run_buffers,
)
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    E_HEADING,
    E_V_X,
    E_V_Y,
    E_X,
    E_Y,
    E_YAW_RATE,
    S_V_X,
    STATE_SIZE,
    YAW_RATE,
)
from adk_ros.mismatch.watch.change import Change
from adk_ros.mismatch.watch.watch import Watch
from helpers.mismatch_drive import SPEED, STEP_S, simulated_car

ONSET_S = 160.0


@cache
def changing_drive(
    seconds: float = 240.0, onset_s: float = ONSET_S, seed: int = 1, **changes: float
) -> SensorLog:
    """Recording of the simulated car whose parameters change by `changes` at the onset."""
    p = simulated_car()
    n = round(seconds / STEP_S)
    command_s = np.arange(0.0, seconds + 1.0, 0.025)
    hold = 0.5 * 1.225 * 0.6 * SPEED**2 + 0.012 * p[INDEX["mass"]] * 9.81
    torque = p[INDEX["wheel_radius"]] * (hold + 1500.0 * np.sin(0.35 * command_s))
    angle = 0.02 * np.sin(0.2 * command_s) + 0.006 * np.sin(1.9 * command_s)
    command = np.column_stack([torque, angle])
    terms = no_terms(n)
    if changes:
        late = (STEP_S * np.arange(n) >= onset_s).astype(np.float64)
        terms = ActiveTerms(
            np.array([INDEX[name] for name in changes]),
            np.array(list(changes.values())),
            np.ones(len(changes), dtype=np.int64),
            np.vstack([np.ones(n), late]),
        )
    state = np.zeros(STATE_SIZE)
    state[S_V_X] = SPEED
    buffers = run_buffers(state, n, keep_end_states=True)
    commands = integrate_commands(command_s, command, seconds + 2.0)
    integrate(p, terms, open_loop_inputs(commands, 0.0, STEP_S, n), buffers)
    random = np.random.default_rng(seed)
    imu = buffers.output[[A_X, A_Y, YAW_RATE]].T
    imu = np.asarray(imu + random.normal(0.0, [0.05, 0.05, 2e-3], imu.shape), np.float64)
    ends = buffers.end_states[2::2]
    odometry = ends[:, [E_V_X, E_V_Y, E_YAW_RATE]]
    odometry = odometry + random.normal(0.0, [0.02, 0.02, 2e-3], odometry.shape)
    return SensorLog(
        "changing",
        seconds,
        np.asarray(STEP_S * (np.arange(n) + 0.5), np.float64),
        imu,
        np.asarray(STEP_S * np.arange(2, n + 1, 2), np.float64),
        np.asarray(odometry, np.float64),
        ends[:, [E_X, E_Y, E_HEADING]] + random.normal(0.0, 0.01, (ends.shape[0], 3)),
        command_s,
        command,
    )


def surrogate() -> SurrogateModel:
    """The simulated car, with an error of a thousandth of the noise."""
    noise = np.array([0.025, 0.025, 1e-3, 0.014, 0.014, 1.4e-3])
    residuals = 1e-3 * noise[:, None] * np.ones((6, 100))
    return SurrogateModel(simulated_car(), np.zeros(6), residuals, np.empty((0, SIZE)))


def watched(log: SensorLog, until_s: float = np.inf) -> tuple[Watch, list[Change]]:
    """A watch after a log, or its part before a time, and what it reported."""
    changes: list[Change] = []
    watch = Watch(surrogate(), changes.append)
    for reading, pose in readings_of(log):
        if reading.stamp_ns > 1e9 * (until_s + 1.0):
            break
        watch.push(reading, pose)
        watch.run()
    return watch, changes
