# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Horizons under plans that end early, or that leave a command open."""

import numpy as np

from adk_ros.model.partial_plan import partial_covariance, partial_horizon
from adk_ros.numerics.arrays import FloatArray

STEPS = 6
TIME = np.arange(1.0, STEPS + 1.0)[:, None]
PLANNED = 10.0 + TIME * [1.0, 2.0, 3.0]
UNPLANNED = 10.0 + TIME * [0.5, 0.5, 0.5]
HELD = 10.0 + TIME * [0.1, 0.1, 0.1]
SHRINKAGE = np.linspace(1.0, 0.0, STEPS)[:, None] * np.ones(3)


def horizon(torque: int, delta: int) -> FloatArray:
    return partial_horizon(PLANNED, UNPLANNED, HELD, SHRINKAGE, np.array([torque, delta]))


def test_a_whole_plan_is_followed() -> None:
    np.testing.assert_array_equal(horizon(STEPS, STEPS), PLANNED)


def test_the_change_after_the_end_is_shrunk_as_after_as_many_held_steps() -> None:
    found = horizon(4, 4)
    np.testing.assert_array_equal(found[:4], PLANNED[:4])
    change = found[4:] - found[3]
    np.testing.assert_allclose(change, np.array([[0.8], [0.6 * 2]]) * [1.0, 2.0, 3.0])


def test_each_command_decides_on_its_states() -> None:
    found = horizon(4, STEPS)
    np.testing.assert_array_equal(found[:, 1:], PLANNED[:, 1:])
    np.testing.assert_allclose(found[4:, 0] - found[3, 0], [0.8, 1.2])


def test_without_a_command_the_published_horizon_stays() -> None:
    steering, torque = horizon(0, STEPS), horizon(STEPS, 0)
    published = HELD + PLANNED - UNPLANNED
    np.testing.assert_allclose(steering[:, 0], published[:, 0])
    np.testing.assert_array_equal(steering[:, 1:], PLANNED[:, 1:])
    np.testing.assert_array_equal(torque[:, 0], PLANNED[:, 0])
    np.testing.assert_allclose(torque[:, 1:], published[:, 1:])


def test_beyond_a_plan_the_error_is_that_of_its_end_and_of_held_commands() -> None:
    planned = np.arange(1.0, STEPS + 1.0)[:, None, None] * np.eye(3)
    held = 10.0 * planned
    np.testing.assert_array_equal(partial_covariance(planned, held, STEPS), planned)
    np.testing.assert_array_equal(partial_covariance(planned, held, 0), held)
    found = partial_covariance(planned, held, 2)
    assert found[:, 1, 1].tolist() == [1.0, 2.0, 22.0, 32.0, 42.0, 52.0]
