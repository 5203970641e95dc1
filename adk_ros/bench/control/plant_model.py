# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The plant as a prediction model: the limit of what a better model can reach.

It knows the car, the road and the true state; with measured velocities it would not be the limit
of a model whose observer filters them. It integrates with a longer step than the simulation: RK4
at 8.3 ms is stable for rates up to 330 1/s, and the fastest mode is about 230 1/s
(`fourteen_dof`). No candidate for real time: 12 us for each step of a candidate.
"""

from __future__ import annotations

import numpy as np

from adk_ros.bench.control.cars import SimulatedCar
from adk_ros.bench.control.prediction_models import COMMAND_STEP, Linearization
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.fourteen_dof import STATE_SIZE, rk4_step
from adk_ros.plant.vehicle.sprung_mass import SprungMass
from adk_ros.plant.vehicle.vehicle_parameters import Constants
from adk_ros.signals.channels import TICK_NS, Sample

_SUBSTEPS = 3
_STEP_S = TICK_NS * 1e-9 / _SUBSTEPS


class PlantModel:
    """Predicts with the equations, the parameters and the state of `car`."""

    def __init__(self, car: SimulatedCar) -> None:
        self._car = car
        self._start = car.state.copy()

    def update(self, sample: Sample) -> None:
        """Take the true state of the car."""
        self._start = self._car.state.copy()

    def roll_out_many(self, commands: FloatArray) -> FloatArray:
        """As `PredictionModel.roll_out_many`."""
        car = self._car
        out = np.empty((*commands.shape[:2], 3))
        _roll_out(car.constants, car.body, self._start, commands, car.planes, out)
        return out

    def linearized(self, commands: FloatArray) -> Linearization:
        """As `PredictionModel.linearized`, by forward differences."""
        car = self._car
        predicted = np.empty((len(commands), 3))
        jacobian = np.zeros((len(commands), 3, len(commands), 2))
        _differences(
            car.constants, car.body, self._start, commands, car.planes, COMMAND_STEP, predicted,
            jacobian,
        )  # fmt: skip
        return Linearization(predicted, jacobian)


@strict_kernel
def _roll_out(
    c: Constants, b: SprungMass, start: FloatArray, commands: FloatArray, planes: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    work = np.empty((5, STATE_SIZE))
    for k in range(commands.shape[0]):
        state = start.copy()
        for j in range(commands.shape[1]):
            _step(c, b, state, commands[k, j], planes, work)
            for i in range(3):
                out[k, j, i] = state[i]


@strict_kernel
def _step(
    c: Constants, b: SprungMass, state: FloatArray, command: FloatArray, planes: FloatArray,
    work: FloatArray,
) -> None:  # fmt: skip
    """Advance `state` in place by 25 ms."""
    for _ in range(_SUBSTEPS):
        rk4_step(c, b, state, command, planes, (0.0, 0.0), _STEP_S, work)


@strict_kernel
def _differences(
    c: Constants, b: SprungMass, start: FloatArray, commands: FloatArray, planes: FloatArray,
    steps: FloatArray, predicted: FloatArray, jacobian: FloatArray,
) -> None:  # fmt: skip
    """Write a rollout (h, 3) and its quotients (h, 3, h, 2): a change acts from its step on."""
    work = np.empty((5, STATE_SIZE))
    h = commands.shape[0]
    states = np.empty((h + 1, STATE_SIZE))
    states[0] = start
    for j in range(h):
        states[j + 1] = states[j]
        _step(c, b, states[j + 1], commands[j], planes, work)
        predicted[j] = states[j + 1, :3]
    changed = np.empty(2)
    for j in range(h):
        for i in range(2):
            state = states[j].copy()
            changed[:] = commands[j]
            changed[i] += steps[i]
            for n in range(j, h):
                _step(c, b, state, changed if n == j else commands[n], planes, work)
                for channel in range(3):
                    jacobian[n, channel, j, i] = (state[channel] - predicted[n, channel]) / steps[
                        i
                    ]
