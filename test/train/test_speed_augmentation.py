# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows at speeds that were not driven: what a car of known tyres would do there."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.numerics.arrays import FloatArray
from adk_ros.train.dataset import Sequences
from adk_ros.train.speed_augmentation import (
    MAX_SPEED_SCALE,
    augmentation_weight,
    drag_over_mass,
    scale_to_higher_speeds,
)

T = 0.025
DRAG = 4e-4


def change(x: FloatArray, u: FloatArray) -> FloatArray:
    """The increment of a single-track car on linear tyres, with drag."""
    v_x, v_y, rate = x.T
    front = u[:, 1] - (v_y + 1.3 * rate) / v_x
    rear = -(v_y - 1.4 * rate) / v_x
    a_y = 45.0 * front + 50.0 * rear
    a_x = u[:, 0] / 600.0 - DRAG * v_x**2
    turn = 40.0 * 1.3 * front - 45.0 * 1.4 * rear
    return T * np.column_stack([a_x + rate * v_y, a_y - rate * v_x, turn])


def driven(n: int = 4000) -> Sequences:
    """Rows of three samples each: x_(k-2), x_(k-1), x_k, at 8 to 25 m/s in bends."""
    random = np.random.default_rng(4)
    x, u = np.zeros((n, 3)), np.zeros((n, 2))
    x[0] = 15.0, 0.0, 0.0
    torque, steer = 0.0, 0.0
    for k in range(n):
        if k % 40 == 0:
            torque, steer = 900.0 * (16.0 - x[k, 0]) / 8.0, random.uniform(-0.03, 0.03)
        u[k] = torque + 200.0 * np.sin(0.05 * k), steer
        if k + 1 < n:
            x[k + 1] = x[k] + change(x[k : k + 1], u[k : k + 1])[0]
    return Sequences(x, x, u, np.arange(2, n - 1), 2, 1)


def test_augmented_rows_match_the_car_at_that_speed() -> None:
    part = driven()
    made = scale_to_higher_speeds(part, 3)
    ratio = made.states[0][:, 0] / part.x[made.rows, 0]
    assert ratio.min() >= 1.0
    assert ratio.max() <= MAX_SPEED_SCALE
    assert made.states[0] == pytest.approx(ratio[:, None] * part.x[made.rows])
    true = change(made.states[0], part.u[made.rows])
    off = np.sqrt(np.mean((made.change - true) ** 2, axis=0))
    # The measured increment, taken as it is, would be far off.
    plain = np.sqrt(np.mean((part.x_ref[made.rows + 1] - part.x[made.rows] - true) ** 2, axis=0))
    assert np.all(off[:2] < 0.15 * plain[:2])
    assert off[2] < 1e-9
    assert [state.shape for state in made.states] == [(made.rows.size, 3)] * 3
    # Its past is on its own way: a tick before, the increment leads to it.
    before = made.states[1] + change(made.states[1], part.u[made.rows - 1])
    assert np.mean(np.abs(before - made.states[0])[:, 1]) < 0.02


def test_drag_is_separated_from_other_resistance() -> None:
    part = driven()
    assert drag_over_mass(part, part.rows) == pytest.approx(DRAG, rel=0.3)


def test_unknown_rows_are_left_out() -> None:
    part = driven(400)
    x_ref = part.x_ref.copy()
    x_ref[100:110] = np.nan
    made = scale_to_higher_speeds(Sequences(part.x, x_ref, part.u, part.rows, 2, 1), 1)
    assert not set(range(99, 109)) & set(made.rows.tolist())
    assert np.isfinite(made.change).all()
    assert len(made.states) == 1


def test_a_weight_is_the_share_of_the_errors() -> None:
    measured, made = np.full((10, 3), 0.1), np.full((10, 3), 0.2)
    assert augmentation_weight(measured, made) == pytest.approx([0.25**3 / (0.25**2 + 0.01)] * 3)
    assert augmentation_weight(made, measured) == pytest.approx([1.0 / 1.01] * 3)
    assert augmentation_weight(0.1 * measured, made) == pytest.approx([0.0] * 3, abs=2e-6)
    assert augmentation_weight(measured, np.empty((0, 3))) == pytest.approx([0.0] * 3)
