# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The predictor at a time of a recording, as a planner uses it."""

import numpy as np
import pytest
from helpers.train import bag, small

import adk_ros


def test_the_predictor_continues_the_recording() -> None:
    recording = adk_ros.read_recording(bag())
    predictor = adk_ros.adapted_predictor(recording, small().path, until_s=4.0)
    row = int((recording.time_s <= 4.0).sum()) - 1
    commands = recording.record.u[row : row + 20]
    (states,) = predictor.roll_out_many(commands[None])
    rollouts = adk_ros.rollout(recording, small().path, horizon_s=0.5, stride_s=0.025)
    start = np.argmin(np.abs(rollouts.starts_s - recording.time_s[row]))
    np.testing.assert_allclose(states, rollouts.predicted[start], rtol=0, atol=1e-9)


def test_a_gradient_planner_reaches_its_target() -> None:
    """The example of the documentation: Gauss-Newton steps on the linear model."""
    predictor = adk_ros.adapted_predictor(bag(), small().path)
    unit = predictor.model.scaling
    commands = np.tile(unit.u_mean, (40, 1))
    target = predictor.rollout(commands + 0.3 * unit.u_scale)
    costs = []
    for _ in range(3):
        along = predictor.linearized(commands)
        error = (target - along.predicted) / unit.x_scale
        costs.append((error**2).sum())
        jacobian = along.jacobian() / unit.x_scale[:, None, None] * unit.u_scale
        columns = jacobian.reshape(error.size, commands.size)
        hessian = columns.T @ columns + 1e-3 * np.eye(commands.size)
        step = np.linalg.solve(hessian, columns.T @ error.ravel())
        commands = commands + step.reshape(commands.shape) * unit.u_scale
    assert costs[-1] < 0.05 * costs[0]


def test_unusable_times_are_refused() -> None:
    with pytest.raises(adk_ros.UsageError, match="until_s is -1: give a time of at least 0 s"):
        adk_ros.adapted_predictor(bag(), small().path, until_s=-1.0)
    with pytest.raises(adk_ros.DataError, match=r"has no state at 0 s \(warming up\): choose"):
        adk_ros.adapted_predictor(bag(), small().path, until_s=0.0)
