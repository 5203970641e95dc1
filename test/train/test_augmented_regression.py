# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows augmented to higher speeds count only where the data do not contradict them."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import FloatArray
from adk_ros.train.augmented_regression import RegressionRows, contradicted, solve, solve_augmented
from adk_ros.train.dataset import Sequences
from adk_ros.train.network_fit import quadratic_features_of, scaling_of
from adk_ros.train.quadratic_features import QuadraticFeatures

T = 0.025
RIDGES = 1e-11, 1e-8, 1e-8


class Car(NamedTuple):
    """`downforce`: growth of the grip at 15 m/s; `power`: largest torque times speed, N m m/s."""

    downforce: float = 0.0
    power: float = np.inf


NOMINAL, DOWNFORCE, POWER_LIMIT = Car(), Car(downforce=1.5), Car(power=5000.0)


def change(x: FloatArray, u: FloatArray, car: Car) -> FloatArray:
    """The increment of a single-track car on linear tyres."""
    v_x, v_y, rate = x.T
    grip = 1.0 + car.downforce * (v_x / 15.0) ** 2
    front = grip * (u[:, 1] - (v_y + 1.3 * rate) / v_x)
    rear = -grip * (v_y - 1.4 * rate) / v_x
    a_x = np.minimum(u[:, 0], car.power / v_x) / 600.0 - 4e-4 * v_x**2
    a_y = 45.0 * front + 50.0 * rear
    turn = 40.0 * 1.3 * front - 45.0 * 1.4 * rear
    return T * np.column_stack([a_x + rate * v_y, a_y - rate * v_x, turn])


@cache
def driven(car: Car, noise: float = 0.0, speeds: tuple[float, float] = (8.0, 25.0)) -> Sequences:
    """A drive of 250 s in bends, with `noise` in standard deviations of the increments."""
    random = np.random.default_rng(4)
    n = 10_000
    x, u = np.zeros((n, 3)), np.zeros((n, 2))
    x[0] = np.mean(speeds), 0.0, 0.0
    torque, steer, wanted = 0.0, 0.0, float(np.mean(speeds))
    for k in range(n):
        if k % 400 == 0:
            wanted = random.uniform(*speeds)
        if k % 40 == 0:
            torque, steer = 900.0 * (wanted - x[k, 0]) / 4.0, random.uniform(-0.03, 0.03)
        u[k] = torque + 200.0 * np.sin(0.05 * k), steer
        if k + 1 < n:
            x[k + 1] = x[k] + change(x[k : k + 1], u[k : k + 1], car)[0]
    x += noise * np.diff(x, axis=0).std(axis=0) * random.normal(size=x.shape)
    return Sequences(x, x, u, np.arange(2, n - 1), 2, 1)


def error(forms: QuadraticFeatures, scaling: Scaling, part: Sequences) -> FloatArray:
    """Return the RMSE (3,) of the increments, in their standard deviations in training."""
    x, u, rows = scaling.scale_x(part.x), scaling.scale_u(part.u), part.rows
    past = [x[rows - j] for j in range(3)] + [u[rows - j] for j in range(3)]
    inputs = np.concatenate(past, axis=1)
    within = np.clip(inputs, -forms.reach, forms.reach)
    made = (within @ forms.directions) ** 2 @ forms.weights + inputs @ forms.linear + forms.level
    off = made - (x[rows + 1] - x[rows]) / scaling.step_scale
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)))


def left_out(car: Car) -> tuple[str, ...]:
    part = driven(car, noise=0.3)
    return quadratic_features_of(part, scaling_of(part)).unaugmented


def test_a_car_of_known_tyres_contradicts_nothing() -> None:
    assert left_out(NOMINAL) == ()


def test_a_car_with_much_downforce_contradicts_the_lateral_rows() -> None:
    assert left_out(DOWNFORCE) == ("v_y", "yaw_rate")


@pytest.mark.parametrize("car", [NOMINAL, DOWNFORCE, POWER_LIMIT])
def test_what_the_rows_are_worth_on_a_faster_drive(car: Car) -> None:
    """At up to 1.3 times the speed of the training: v_x and yaw rate gain, v_y loses some."""
    part, faster = driven(car, noise=0.3, speeds=(8.0, 20.0)), driven(car, speeds=(15.0, 26.0))
    scaling = scaling_of(part)
    with_rows, without = (
        error(quadratic_features_of(part, scaling, augment), scaling, faster)
        for augment in (True, False)
    )
    assert with_rows[0] < 0.95 * without[0]
    if car is DOWNFORCE:
        assert with_rows[1:] == pytest.approx(without[1:], rel=1e-6)
    else:
        assert with_rows[2] < 0.95 * without[2]
        assert with_rows[1] < 1.3 * without[1]


def rows_of(x: FloatArray, target: FloatArray, speed: FloatArray) -> RegressionRows:
    phi = np.column_stack([x, np.ones(len(x))])
    return RegressionRows(x, phi, target, np.arange(len(x)), speed)


def made(n: int, wrong: float) -> tuple[RegressionRows, RegressionRows]:
    """Measured rows of a linear law, and augmented ones `wrong` in the first equation."""
    random = np.random.default_rng(3)
    speed = random.uniform(5.0, 20.0, n)
    x = np.column_stack([speed, random.normal(size=n)])
    law = np.array([[0.3, 0.1, -0.2], [1.0, -1.0, 0.5]])
    noise = 0.1 * random.normal(size=(n, 3))
    faster = 1.2 * x
    target = faster @ law + 0.1 * random.normal(size=(n, 3))
    target[:, 0] += wrong
    return rows_of(x, x @ law + noise, speed), rows_of(faster, target, speed)


def test_contradicted_rows_enter_no_equation_but_the_others() -> None:
    measured, augmented = made(4000, 0.2)
    assert contradicted(measured, augmented, RIDGES).tolist() == [True, False, False]
    alone = solve(measured, RIDGES)
    both, left = solve_augmented(measured, augmented, RIDGES)
    assert left.tolist() == [True, False, False]
    assert both[:, 0] == pytest.approx(alone[:, 0], rel=1e-9)
    assert np.abs(both[:, 1:] - alone[:, 1:]).max() > 1e-6


def test_right_rows_enter_all_equations() -> None:
    measured, augmented = made(4000, 0.0)
    assert contradicted(measured, augmented, RIDGES).tolist() == [False] * 3


@pytest.mark.parametrize("n", [5, 600])
def test_few_rows_contradict_nothing(n: int) -> None:
    """Of 600 samples, three blocks of 5 s; five are as few as the regressors."""
    measured, augmented = made(n, 0.2)
    assert contradicted(measured, augmented, RIDGES).tolist() == [False] * 3
