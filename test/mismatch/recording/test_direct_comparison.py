# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of two recordings without a surrogate model."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mismatch import car

from adk_ros.mismatch.inference.direct_evidence import uncovered
from adk_ros.mismatch.recording.direct_comparison import DirectComparison, compare_directly
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.equations_of_motion import integrate
from adk_ros.mismatch.surrogate.residuals import STEP_S, prepare_residual_problem
from adk_ros.mismatch.surrogate.run_inputs import open_loop_inputs, run_buffers
from adk_ros.mismatch.surrogate.state_index import (
    A_X,
    A_Y,
    S_V_X,
    STATE_SIZE,
    V_X,
    V_Y,
    YAW_RATE,
)
from adk_ros.numerics.arrays import FloatArray

_NOISE = np.array([0.05, 0.05, 0.003, 0.03, 0.03, 0.003])


def _drive(parameters: FloatArray, seed: int, noise: float, seconds: float = 160.0) -> SensorLog:
    """Recording of the surrogate model itself, driven by random waves of steering and torque."""
    random = np.random.default_rng(seed)
    imu_s, odometry_s = np.arange(0.005, seconds, 0.01), np.arange(0.005, seconds, 0.02)
    command_s = np.arange(0.0, seconds, 0.025)
    frequency = np.array([np.linspace(0.03, 0.1, 6), np.linspace(0.1, 1.2, 6)])
    phase = random.uniform(0.0, 2.0 * np.pi, (2, 1, 6))
    turns = frequency[:, None, :] * command_s[None, :, None]
    waves = np.sin(2.0 * np.pi * turns + phase).mean(axis=2)
    command = np.column_stack([3000.0 * waves[0], 0.04 * waves[1]])
    odometry = np.zeros((odometry_s.size, 3))
    odometry[:, 0] = 15.0
    pose = np.zeros((odometry_s.size, 3))
    log = SensorLog(
        "drive",
        seconds,
        imu_s,
        np.zeros((imu_s.size, 3)),
        odometry_s,
        odometry,
        pose,
        command_s,
        command,
    )
    problem = prepare_residual_problem(log, np.ones(6))
    inputs = open_loop_inputs(problem.commands, problem.start_s, STEP_S, problem.steps)
    state = np.zeros(STATE_SIZE)
    state[S_V_X] = 15.0
    buffers = run_buffers(state, problem.steps)
    integrate(parameters, problem.no_terms(), inputs, buffers)
    out = buffers.output
    imu = np.column_stack([np.interp(imu_s, problem.middle_s, out[i]) for i in (A_X, A_Y)])
    rate = np.interp(imu_s, problem.middle_s, out[YAW_RATE])
    imu = np.column_stack([imu, rate]) + noise * _NOISE[:3] * random.normal(size=(imu_s.size, 3))
    motion = np.column_stack(
        [np.interp(odometry_s, problem.middle_s, out[i]) for i in (V_X, V_Y, YAW_RATE)]
    )
    heading = np.cumsum(motion[:, 2]) * 0.02
    east = np.cumsum(motion[:, 0] * np.cos(heading) - motion[:, 1] * np.sin(heading)) * 0.02
    north = np.cumsum(motion[:, 0] * np.sin(heading) + motion[:, 1] * np.cos(heading)) * 0.02
    motion = motion + noise * _NOISE[3:] * random.normal(size=motion.shape)
    return SensorLog(
        "drive",
        seconds,
        imu_s,
        imu,
        odometry_s,
        motion,
        np.column_stack([east, north, heading]),
        command_s,
        command,
    )


def _compared(**changes: float) -> dict[str, DirectComparison]:
    simulation = _drive(car(), 1, 0.0)
    recording = _drive(car(**changes), 2, 1.0)
    return {x.name: x for x in compare_directly(simulation, recording, 0.325)}


def test_same_cars_do_not_differ() -> None:
    found = _compared()
    assert "steering_gain" in found
    assert [x.name for x in found.values() if x.differs] == []


@pytest.mark.parametrize(
    ("changes", "name", "relative"),
    [
        ({"steer_gain": 0.85}, "steering_gain", 0.85),
        ({"mass": 1.15 * 1800.0}, "torque_per_acceleration", 1.15),
    ],
)
def test_a_difference_has_its_size(changes: dict[str, float], name: str, relative: float) -> None:
    found = _compared(**changes)[name]
    assert found.differs
    ratio = found.recording.value / found.simulation.value
    assert ratio == pytest.approx(relative, rel=0.02)


def test_a_delay_is_measured_in_seconds() -> None:
    found = _compared(steer_delay=0.1)["steering_delay"]
    assert found.differs
    assert found.difference.value == pytest.approx(0.1, abs=0.01)


def test_a_claim_covers_a_difference() -> None:
    found = list(_compared(steer_gain=0.85).values())
    assert "steering_gain" in {x.name for x in uncovered(found, ())}
    assert "steering_gain" not in {x.name for x in uncovered(found, ["front_tyre_stiffness"])}
    assert "steering_gain" not in {x.name for x in uncovered(found, (), ["yaw_rate"])}


def test_different_driving_is_not_compared() -> None:
    simulation = _drive(car(), 1, 0.0)
    faster = _drive(car(), 2, 0.0)
    faster.odometry[:, 0] += 30.0
    assert compare_directly(simulation, faster, 0.325) == []
