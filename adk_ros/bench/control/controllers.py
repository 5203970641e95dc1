# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What both predictive controllers have in common: limits, horizon, cost, and the interface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from adk_ros.bench.control.prediction_models import PredictionModel
from adk_ros.bench.control.tracking_cost import TrackingStart, Weights
from adk_ros.numerics.arrays import FloatArray
from adk_ros.plant.environment.road import Route

MPPI_NAME, MPC_NAME = "MPPI", "linear MPC"
CONTROLLERS = (MPPI_NAME, MPC_NAME)


@dataclass(frozen=True)
class ControlSettings:
    """
    Parameters of the controllers, the same for all prediction models.

    `steps`: of the horizon, 25 ms each. `block_steps`: between two nodes of the commands, which
    are linear between them. `candidates`, `temperature` (in units of the cost) and `spread` (N·m,
    rad; standard deviation at the nodes) of MPPI. `limits`: largest magnitudes of torque, N·m, and
    road-wheel angle, rad. `weights`: of the cost. Temperature, spread and the weights of the
    changes are those of `adk bench control --tune`, on the nominal car with another seed.
    """

    steps: int = 40
    block_steps: int = 4
    candidates: int = 128
    temperature: float = 0.05
    spread: tuple[float, float] = (300.0, 0.015)
    limits: tuple[float, float] = (3000.0, 0.6)
    weights: Weights = field(default_factory=Weights)

    def interpolation(self) -> FloatArray:
        """
        Return (steps, nodes): values at the steps of linear interpolation between nodes.

        The first row is zero: the command in force is not a decision. The last node holds.
        """
        decided = np.arange(self.steps - 1) / self.block_steps
        nodes = int(np.ceil(decided[-1])) + 1
        hat = np.maximum(0.0, 1.0 - np.abs(decided[:, None] - np.arange(nodes)[None]))
        return np.vstack([np.zeros((1, nodes)), hat])


class Controller(Protocol):
    """A controller decides the next command from a measured start."""

    def next_command(
        self, model: PredictionModel, start: TrackingStart, in_force: FloatArray
    ) -> FloatArray:
        """Return the command (2,) for the next cycle; `in_force` (2,) is that of this one."""


class Plan:
    """The commands (steps, 2) that a controller intends, shifted by a step each cycle."""

    def __init__(self, settings: ControlSettings, route: Route) -> None:
        self.settings, self.route = settings, route
        self._commands: FloatArray | None = None

    def shifted(self, in_force: FloatArray) -> FloatArray:
        """Return the plan from this cycle on: its first command is `in_force`."""
        if self._commands is None:
            return np.repeat(in_force[None], self.settings.steps, axis=0)
        commands = np.vstack([self._commands[1:], self._commands[-1:]])
        commands[0] = in_force
        return commands

    def keep(self, commands: FloatArray) -> FloatArray:
        """Keep a plan, clipped to the limits; return its command for the next cycle."""
        limits = np.array(self.settings.limits)
        self._commands = np.clip(commands, -limits, limits)
        return np.array(self._commands[1])
