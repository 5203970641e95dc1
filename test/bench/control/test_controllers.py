# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MPPI and linear MPC on small problems with known optima."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.bench.control.cars import NOMINAL, SimulatedCar, make_car
from adk_ros.bench.control.control_bench import path_of
from adk_ros.bench.control.controllers import ControlSettings
from adk_ros.bench.control.linear_mpc import (
    LinearMpc,
    path_errors,
    quadratic_cost,
    solve_bounded,
)
from adk_ros.bench.control.mppi import Mppi
from adk_ros.bench.control.plant_model import PlantModel
from adk_ros.bench.control.prediction_models import Linearization, difference_quotients
from adk_ros.bench.control.reference_path import LANE_CHANGE, ReferencePath
from adk_ros.bench.control.tracking_cost import TICK_S, TrackingStart, Weights, tracking_costs
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import ROAD_SIZE, ROAD_SPEED, ROAD_X, Route
from adk_ros.signals.channels import Sample

SPEED = 20.0


def straight() -> Route:
    table = np.zeros((401, ROAD_SIZE))
    table[:, ROAD_X] = 0.5 * np.arange(401)
    table[:, ROAD_SPEED] = SPEED
    return Route(table, 0.5)


class LinearCar:
    """Velocities linear in the commands: v_x' = T / 1000, r = 5 delta, v_y = 0."""

    velocity = np.array([SPEED, 0.0, 0.0])

    def update(self, sample: Sample) -> None:
        self.velocity = np.array(sample.x)

    def roll_out_many(self, commands: FloatArray) -> FloatArray:
        out = np.zeros((*commands.shape[:2], 3))
        out[..., 0] = self.velocity[0] + TICK_S * np.cumsum(commands[..., 0], axis=1) / 1000.0
        out[..., 2] = 5.0 * commands[..., 1]
        return out

    def linearized(self, commands: FloatArray) -> Linearization:
        return difference_quotients(self, commands)


def start(lateral: float = 0.0, speed: float = SPEED) -> TrackingStart:
    return TrackingStart(np.array([20.0, lateral, 0.0]), np.array([speed, 0.0, 0.0]), 20.0)


def cost_of(commands: FloatArray, begin: TrackingStart, model: LinearCar, w: Weights) -> float:
    out, route = np.empty(1), straight()
    states = model.roll_out_many(commands[None])
    tracking_costs(states, commands[None], begin, route.table, route.spacing, w, out)
    return float(out[0])


def test_cost_of_an_offset() -> None:
    commands = np.zeros((40, 2))
    w = Weights(lateral=0.1)
    assert cost_of(commands, start(), LinearCar(), w) == pytest.approx(0.0, abs=1e-12)
    assert cost_of(commands, start(0.3), LinearCar(), w) == pytest.approx(9.0, rel=1e-9)


def test_interpolation_between_nodes() -> None:
    hat = ControlSettings(steps=10, block_steps=4).interpolation()
    assert hat.shape == (10, 3)
    np.testing.assert_array_equal(hat[0], 0.0)
    np.testing.assert_array_equal(
        hat[[1, 3, 5, 9]], [[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0, 1]]
    )
    np.testing.assert_allclose(hat[1:].sum(axis=1), 1.0)


def test_bounded_problem_with_known_solution() -> None:
    """(x - 3)² + (y + 1)² with x <= 2 has its minimum at (2, -1)."""
    found = solve_bounded(
        2.0 * np.eye(2), np.array([-6.0, 2.0]), np.eye(2), np.array([-5.0, -5.0]),
        np.array([2.0, 5.0]),
    )  # fmt: skip
    np.testing.assert_allclose(found, [2.0, -1.0], atol=1e-3)  # type: ignore[arg-type]


def test_errors_are_linear_in_the_commands() -> None:
    """The derivatives of the path errors agree with differences, on a curved path."""
    path = path_of(LANE_CHANGE, 200.0)
    pose, speed = path.pose_at(path.begin + 25.0)
    begin = TrackingStart(pose + 0.1, np.array([speed, 0.1, 0.2]), path.begin + 25.0)
    model = LinearCar()
    model.velocity = begin.velocity
    rng = np.random.default_rng(0)
    commands = rng.normal(size=(20, 2)) * [200.0, 0.01]
    errors, by = path_errors(model.linearized(commands), begin, path.route)
    change = rng.normal(size=(20, 2)) * [5.0, 2e-4]
    after, _ = path_errors(model.linearized(commands + change), begin, path.route)
    np.testing.assert_allclose(
        after - errors,
        np.einsum("hcji,ji->hc", by, change),
        atol=2e-2 * np.abs(after - errors).max(),
    )


def test_mpc_equals_the_unconstrained_optimum() -> None:
    """Without active limits the QP is least squares; on a straight path the model is linear."""
    settings = ControlSettings(steps=20)
    route, model, begin, in_force = straight(), LinearCar(), start(0.02), np.zeros(2)
    command = LinearMpc(settings, route).next_command(model, begin, in_force)
    errors, by = path_errors(model.linearized(np.zeros((20, 2))), begin, route)
    nodes = settings.interpolation()
    change = np.zeros((20, 2, 2 * nodes.shape[1]))
    change[:, 0, : nodes.shape[1]] = 1000.0 * nodes
    change[:, 1, nodes.shape[1] :] = 0.1 * nodes
    by_nodes = np.einsum("hcji,jin->hcn", by, change)
    hessian, gradient = quadratic_cost(
        errors, by_nodes, np.zeros((20, 2)), change, settings.weights
    )
    best = change @ -np.linalg.solve(hessian, gradient)
    np.testing.assert_allclose(command, best[1], rtol=0.02, atol=1e-5)
    assert command[1] < 0.0


def test_mpc_respects_the_limits() -> None:
    settings = ControlSettings(limits=(100.0, 0.001))
    controller = LinearMpc(settings, straight())
    model, begin = LinearCar(), start(1.0, 15.0)
    model.velocity = begin.velocity
    command = controller.next_command(model, begin, np.zeros(2))
    np.testing.assert_allclose(command, [100.0, -0.001], rtol=0.02)


def test_mppi_finds_the_optimum() -> None:
    """Repeated from the same start, the plan's cost comes close to that of least squares."""
    settings = ControlSettings(steps=20, candidates=200, temperature=0.005, spread=(150.0, 0.004))
    route, model, begin, w = straight(), LinearCar(), start(0.1), settings.weights
    controller = Mppi(settings, route, seed=1)
    plan = np.zeros((20, 2))
    errors, by = path_errors(model.linearized(plan), begin, route)
    nodes = settings.interpolation()
    change = np.zeros((20, 2, 2 * nodes.shape[1]))
    change[:, 0, : nodes.shape[1]] = 1000.0 * nodes
    change[:, 1, nodes.shape[1] :] = 0.1 * nodes
    hessian, gradient = quadratic_cost(
        errors, np.einsum("hcji,jin->hcn", by, change), plan, change, w
    )
    best = cost_of(plan - change @ np.linalg.solve(hessian, gradient), begin, model, w)
    before = cost_of(plan, begin, model, w)
    for _ in range(60):
        controller.next_command(model, begin, np.zeros(2))
        # Undo the shift of the next cycle: the problem is the same one again.
        kept = controller._plan._commands
        assert kept is not None
        controller._plan._commands = np.vstack([kept[:1], kept[:-1]])
        kept_cost = cost_of(kept, begin, model, w)
    assert best < 0.8 * before
    assert kept_cost - best < 0.1 * (before - best)


def test_plant_model_predicts_the_plant() -> None:
    """Its step agrees with the simulation's shorter one, its derivatives with differences."""
    path: ReferencePath = path_of(LANE_CHANGE, 100.0)
    pose, speed = path.pose_at(0.0)
    car = SimulatedCar(make_car(NOMINAL), speed, pose)
    model = PlantModel(car)
    # The limit is not that of the sensors: of the sample it uses nothing.
    v_x, v_y, rate = car.velocity.tolist()
    model.update(Sample(0, (v_x + 0.1, v_y - 0.1, rate + 0.01), (0.0, 0.0), (0.0, 0.0), 0))
    commands = np.column_stack([np.full(40, 800.0), 0.05 * np.sin(np.arange(40) / 6.0)])
    predicted = model.roll_out_many(commands[None])[0]
    local, quotients = model.linearized(commands), difference_quotients(model, commands)
    np.testing.assert_allclose(local.predicted, predicted, atol=1e-12)
    np.testing.assert_allclose(local.jacobian, quotients.jacobian, atol=1e-9)
    for command, expected in zip(commands, predicted, strict=True):
        car.step(command)
        np.testing.assert_allclose(car.velocity, expected, atol=2e-3)
