# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The single-track model of the lifting: equations, range, and agreement of its three forms."""

import numpy as np
import pytest
import torch
from helpers.model import CAR, SCALING, car_model, random_lift

from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.single_track import (
    single_track_batch,
    single_track_change,
    single_track_slope,
)
from adk_ros.numerics.constants import GRAVITY
from adk_ros.train.network import to_torchscript
from adk_ros.train.single_track_network import SingleTrackModule, compiled_single_track

HISTORY = 3


def test_steady_cornering_follows_the_understeer_equation() -> None:
    """r = v delta / (L + (m l_r / C_f - m l_f / C_r) v^2 / L), Rajamani (2012), section 3.3."""
    car, delta, v = np.array(CAR), 0.01, 15.0
    state = [v, 0.0, 0.0]
    for _ in range(400):
        change = single_track_change(state[0], state[1], state[2], 0.0, delta, car)
        state = [v, state[1] + change[1], state[2] + change[2]]
    length = CAR.front + CAR.rear
    front = CAR.front_stiffness * GRAVITY * CAR.rear / length
    rear = CAR.rear_stiffness * GRAVITY * CAR.front / length
    gradient = CAR.rear / length / front - CAR.front / length / rear
    assert state[2] == pytest.approx(v * delta / (length + gradient * v**2), rel=0.01)


def test_a_drive_and_drag_change_the_speed() -> None:
    slope = single_track_slope(20.0, 0.0, 0.0, 1000.0, 0.0, np.array(CAR))
    assert slope[0] == pytest.approx(1.5 - 0.1 - 3e-4 * 400.0)
    assert slope[1:3] == (0.0, 0.0)


@pytest.mark.parametrize("speed", [0.0, 0.3, -4.0])
def test_slow_and_backwards_it_is_stable_and_turns_as_the_wheels_roll(speed: float) -> None:
    car, state = np.array(CAR), [speed, 0.3, 0.5]
    for _ in range(2000):
        change = single_track_change(state[0], state[1], state[2], 0.0, 0.1, car)
        state = [speed, state[1] + change[1], state[2] + change[2]]
    rolling = speed * 0.1 / (CAR.front + CAR.rear)
    assert state[2] == pytest.approx(rolling, rel=0.03, abs=1e-9)


def test_what_is_learned_counts_within_the_training_data_only() -> None:
    single = car_model(HISTORY)
    car, limits = single.car.astype(float), single.limits.astype(float)
    speeds = np.array([14.0, 16.0, 19.0, 19.5, 24.0, 40.0])
    points = np.zeros((speeds.size, 5))
    points[:, 0] = (speeds - SCALING.x_mean[0]) / SCALING.x_scale[0]
    points[:, 2] = -SCALING.x_mean[2] / SCALING.x_scale[2]
    values = single_track_batch(points, car, limits, np.empty((speeds.size, 7, 5)))
    # One softness (0.5 m/s) beyond, the weight is a quarter.
    assert values[:, 6] == pytest.approx(
        [1.0, 1.0, 1.0, 0.25, 1.0 / 101**2, 1.0 / 1765**2], rel=1e-5
    )
    # The increments are left to quadratic features where w is 1.
    assert (values[:3, :3] == 0.0).all()
    assert (np.abs(values[3:, 0]) > 0.0).all()


@pytest.mark.parametrize("is_quadratic", [True, False])
def test_torch_compiled_and_derivative_agree(is_quadratic: bool) -> None:
    single = car_model(HISTORY, is_quadratic)
    module = SingleTrackModule(
        *map(torch.from_numpy, (single.car, single.command_filter, single.limits))
    ).double()
    rows = torch.from_numpy(np.random.default_rng(0).normal(size=(200, input_size(HISTORY))))
    by_torch, by_kernel = rows.clone().requires_grad_(), rows.clone().requires_grad_()
    expected, found = module(by_torch), compiled_single_track(module, by_kernel)
    # The kernel's tanh is a rational function, accurate to 7e-6.
    torch.testing.assert_close(found, expected, rtol=2e-5, atol=2e-5)
    weights = torch.randn_like(expected)
    (expected * weights).sum().backward()
    (found * weights).sum().backward()
    assert by_torch.grad is not None
    assert by_kernel.grad is not None
    scale = float(by_torch.grad.abs().max())
    torch.testing.assert_close(by_kernel.grad, by_torch.grad, rtol=1e-3, atol=1e-4 * scale)


def test_programs_with_other_shapes_are_not_compiled() -> None:
    lift = random_lift(HISTORY, 8, 8, car_model(HISTORY))
    assert Lifting(to_torchscript(lift), input_size(HISTORY), 8).compiled is not None
    lift.single_track.car = torch.nn.Buffer(torch.cat([lift.single_track.car, torch.zeros(1)]))
    assert Lifting(to_torchscript(lift), input_size(HISTORY), 8).compiled is None
