# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction models of the controllers behind one interface.

All get the same samples, one each 25 ms: the bicycle models start from their velocities, ours from
those that its observer estimates. The plant starts from the true state of the car instead. The
first command of a candidate is the one in force at the last sample, so that a controller decides
from the second on.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.predictor import Predictor
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Sample

COMMAND_STEP = np.array([20.0, 1e-3])
"""Steps of finite differences, N·m and rad: small against what the tyres' curvature resolves."""


class Linearization(NamedTuple):
    """States `predicted` (h, 3) under commands, and `jacobian` (h, 3, h, 2) by them, SI."""

    predicted: FloatArray
    jacobian: FloatArray


class PredictionModel(Protocol):
    """A model that a controller asks for states v_x, v_y and yaw rate, SI."""

    def update(self, sample: Sample) -> None:
        """Take the sample of this cycle."""

    def roll_out_many(self, commands: FloatArray) -> FloatArray:
        """Predict states (k, h, 3) under candidates `commands` (k, h, 2)."""

    def linearized(self, commands: FloatArray) -> Linearization:
        """Return the states under `commands` (h, 2) and their derivatives by the commands."""


class KoopmanPredictions:
    """
    Our model: adapted, or with the operator of the training (online method `constant`).

    Filter, disturbance estimate and correction of monitored errors are the predictor's in both.
    """

    def __init__(self, model: KoopmanModel, *, adapts: bool) -> None:
        online = None if adapts else OnlineSettings("constant")
        self._predictor = Predictor(model, online, horizon_steps=0)

    def update(self, sample: Sample) -> None:
        """As `PredictionModel.update`."""
        self._predictor.step(sample)

    def roll_out_many(self, commands: FloatArray) -> FloatArray:
        """As `PredictionModel.roll_out_many`."""
        return self._predictor.roll_out_many(commands)

    def linearized(self, commands: FloatArray) -> Linearization:
        """As `PredictionModel.linearized`, with the derivatives of the local linear model."""
        local = self._predictor.linearized(commands)
        return Linearization(local.predicted, local.jacobian())


def difference_quotients(model: PredictionModel, commands: FloatArray) -> Linearization:
    """Return the derivatives of a rollout under `commands` (h, 2) by forward differences."""
    steps = len(commands)
    candidates = np.repeat(commands[None], 2 * steps + 1, axis=0)
    for j in range(steps):
        for i in range(2):
            candidates[1 + 2 * j + i, j, i] += COMMAND_STEP[i]
    states = model.roll_out_many(candidates)
    change = (states[1:] - states[0]).reshape(steps, 2, steps, 3) / COMMAND_STEP[
        None, :, None, None
    ]
    return Linearization(states[0], np.ascontiguousarray(change.transpose(2, 3, 0, 1)))
