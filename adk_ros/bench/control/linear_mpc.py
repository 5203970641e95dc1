# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Linear time-varying MPC: a quadratic program along the plan of the last cycle, solved by OSQP.

The states are linear in the changes d of the commands at the nodes of the horizon, y = y_0 + G d,
from the local model along the plan; so are the poses integrated from them, and the errors against
the path at the points next to the plan's. One linearization per cycle (real-time iteration). The
commands and their changes are bounded. References: P. Falcone et al., "Predictive active steering
control for autonomous vehicle systems", IEEE Trans. Control Syst. Technol. 15 (2007) 566; M. Diehl
et al., J. Process Control 12 (2002) 577; B. Stellato et al., "OSQP", Math. Program. Comput. 12
(2020) 637.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

import numpy as np
from scipy import sparse

from adk_ros.bench.control.controllers import ControlSettings, Plan
from adk_ros.bench.control.prediction_models import Linearization, PredictionModel
from adk_ros.bench.control.tracking_cost import TICK_S, TrackingStart, Weights
from adk_ros.errors import UsageError
from adk_ros.model.pose_horizon import pose_horizon
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import ROAD_CURVATURE, ROAD_SPEED, Route, locate, lookup

INSTALL = (
    "left out: linear MPC, which needs OSQP: pip install osqp -c requirements/constraints.txt"
)
_SCALE = np.array([1000.0, 0.1])
"""Unit of the decision variables, N·m and rad: OSQP converges faster with variables of order 1."""

_TRUST = np.array([1000.0, 0.03])
"""Largest change of the plan in a cycle, N·m and rad: about the range in which tyre forces are
linear, so that the quadratic program does not leave it."""


def has_osqp() -> bool:
    """Return whether OSQP is installed."""
    return importlib.util.find_spec("osqp") is not None


def solve_bounded(
    hessian: FloatArray, gradient: FloatArray, rows: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray | None:
    """
    Minimise d' H d / 2 + g' d subject to low <= A d <= high; None if OSQP finds no solution.

    `hessian` (n, n), `gradient` (n,), `rows` A (m, n), `low` and `high` (m,).
    :raises UsageError: OSQP is not installed.
    """
    if not has_osqp():
        raise UsageError(INSTALL)
    osqp: Any = importlib.import_module("osqp")
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(hessian)), gradient, sparse.csc_matrix(rows), low, high,
        verbose=False, eps_abs=1e-5, eps_rel=1e-5, max_iter=2000,
    )  # fmt: skip
    result = solver.solve(raise_error=False)
    solved = result.info.status in ("solved", "solved inaccurate")
    return np.asarray(result.x) if solved and np.isfinite(result.x).all() else None


def path_errors(
    local: Linearization, start: TrackingStart, route: Route
) -> tuple[FloatArray, FloatArray]:
    """
    Return errors against the path along a rollout (h, 3), and their derivatives (h, 3, h, 2).

    Columns: lateral, m; heading, rad; speed, m/s.
    """
    predicted, by_commands = local
    poses = pose_horizon(start.pose, start.velocity, predicted)
    before = np.concatenate([np.zeros_like(by_commands[:1]), by_commands[:-1]])
    # The first mean is with the measured velocity, which no command changes.
    mean = 0.5 * (before + by_commands)
    velocity = 0.5 * (np.vstack([start.velocity[None], predicted[:-1]]) + predicted)
    heading = TICK_S * np.cumsum(mean[:, 2], axis=0)
    at_middle = heading - 0.5 * TICK_S * mean[:, 2]
    middle = poses[:, 2] - 0.5 * TICK_S * velocity[:, 2]
    cos, sin = (f(middle)[:, None, None] for f in (np.cos, np.sin))
    v_x, v_y = velocity[:, 0, None, None], velocity[:, 1, None, None]
    moved_x = cos * mean[:, 0] - sin * mean[:, 1] - (v_x * sin + v_y * cos) * at_middle
    moved_y = sin * mean[:, 0] + cos * mean[:, 1] + (v_x * cos - v_y * sin) * at_middle
    x, y = TICK_S * np.cumsum(moved_x, axis=0), TICK_S * np.cumsum(moved_y, axis=0)
    errors = np.empty((len(predicted), 3))
    by = np.empty_like(by_commands)
    s = start.s
    for j, (at_x, at_y, at_heading) in enumerate(poses):
        s, across, road = locate(
            route.table, route.spacing, s + TICK_S * velocity[j, 0], at_x, at_y
        )
        turned = at_heading - road
        errors[j] = across, np.arctan2(np.sin(turned), np.cos(turned)), 0.0
        errors[j, 2] = predicted[j, 0] - lookup(route.table, route.spacing, s, ROAD_SPEED)
        along = np.cos(road) * x[j] + np.sin(road) * y[j]
        by[j, 0] = np.cos(road) * y[j] - np.sin(road) * x[j]
        by[j, 1] = heading[j] - lookup(route.table, route.spacing, s, ROAD_CURVATURE) * along
        by[j, 2] = by_commands[j, 0]
    return errors, by


def quadratic_cost(
    errors: FloatArray, by_nodes: FloatArray, plan: FloatArray, change: FloatArray, w: Weights
) -> tuple[FloatArray, FloatArray]:
    """
    Return Hessian (n, n) and gradient (n,) of the cost of `tracking_cost` by the nodes' changes.

    `errors` (h, 3), `by_nodes` (h, 3, n) of them; `plan` (h, 2) and its change (h, 2, n).
    """
    scale = np.array([w.lateral, w.heading, w.speed])
    step_scale = np.array([w.torque_change, w.delta_change])
    residual = np.concatenate(
        [(errors / scale).ravel(), (np.diff(plan, axis=0) / step_scale).ravel()]
    )
    n = by_nodes.shape[2]
    jacobian = np.concatenate(
        [
            (by_nodes / scale[:, None]).reshape(-1, n),
            (np.diff(change, axis=0) / step_scale[:, None]).reshape(-1, n),
        ]
    )
    steps = len(errors)
    return 2.0 / steps * jacobian.T @ jacobian, 2.0 / steps * jacobian.T @ residual


class LinearMpc:
    """Linear MPC along a route."""

    def __init__(self, settings: ControlSettings, route: Route) -> None:
        self._settings, self._route = settings, route
        self._plan = Plan(settings, route)
        nodes = settings.interpolation()
        # (h, 2, n): commands by decision variables, those of torque first.
        self._change = np.concatenate(
            [
                np.stack([_SCALE[0] * nodes, 0.0 * nodes], axis=1),
                np.stack([0.0 * nodes, _SCALE[1] * nodes], axis=1),
            ],
            axis=2,
        )

    def next_command(
        self, model: PredictionModel, start: TrackingStart, in_force: FloatArray
    ) -> FloatArray:
        """As `Controller.next_command`; without a solution the plan of the last cycle goes on."""
        settings = self._settings
        plan = self._plan.shifted(in_force)
        errors, by = path_errors(model.linearized(plan), start, self._route)
        steps = settings.steps
        n = self._change.shape[2]
        by_nodes = by.reshape(3 * steps, 2 * steps) @ self._change.reshape(2 * steps, n)
        hessian, gradient = quadratic_cost(
            errors, by_nodes.reshape(steps, 3, n), plan, self._change, settings.weights
        )
        # Between nodes commands are linear: the limits hold at each step if they do at the nodes.
        at_nodes = np.minimum(1 + settings.block_steps * np.arange(n // 2), steps - 1)
        present = (plan[at_nodes] / _SCALE).T.ravel()
        limits = np.repeat(np.array(settings.limits) / _SCALE, n // 2)
        trust = np.repeat(_TRUST / _SCALE, n // 2)
        low = np.minimum(np.maximum(-limits - present, -trust), trust)
        high = np.maximum(np.minimum(limits - present, trust), -trust)
        found = solve_bounded(hessian, gradient, np.eye(n), low, high)
        if found is None:
            return self._plan.keep(plan)
        return self._plan.keep(plan + self._change @ found)
