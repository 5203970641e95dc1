# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop rollout of a model from the predictor's present state.

Three ways, by the model's form: compiled with a new lift at each step; the same through
TorchScript, for encoders of another form; or linear in the lifted space, as in the paper.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder_kernels import pack_encoder_input, set_command, shift_in
from adk_ros.model.linearization import LinearizedRollout, linearize
from adk_ros.model.tick_memory import TickMemory, replace_by_naive
from adk_ros.model.uncertainty.batch_rollout import (
    OutputArrays,
    RolloutStart,
    roll_out_many,
    roll_out_many_linear,
)
from adk_ros.model.uncertainty.compiled_rollout import (
    MAX_SCALED_STATE,
    rollout_lifting,
    rollout_linear,
    to_si,
)
from adk_ros.model.uncertainty.error_regression import N_REGRESSORS
from adk_ros.model.uncertainty.fallback import KNOWN
from adk_ros.model.uncertainty.motion_limits import limit_step
from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor
from adk_ros.numerics.arrays import FloatArray

_NO_CORRECTION = np.zeros((0, 3, N_REGRESSORS + 1)), np.ones((0, 3))
"""Weights of the error regression and shrinkage of a rollout that is not corrected."""


class ModelRollout:
    """
    Rolls a model out from the `memory` that the predictor updates in place.

    :param memory: past samples, regressor, disturbance and naive predictors of the present tick.
    """

    def __init__(self, model: KoopmanModel, memory: TickMemory) -> None:
        self._model = model
        self._memory = memory
        self._tick = tick = memory.tick
        # Views, made once: each costs 0.2 us per tick.
        self._present_x = tick.x_past[0]
        self._present_disturbance = memory.disturbance[None]
        self._encoder = encoder = model.lifting.compiled
        self._form = model.step_form()
        self._step_arrays = None if encoder is None else (*self._form[2:], *encoder)

    def run(
        self, theta: FloatArray, u_ahead: FloatArray, steps: int, monitor: RolloutMonitor | None
    ) -> FloatArray | None:
        """
        Predict states (steps, 3), SI, under scaled commands `u_ahead` (h, 2).

        The last command is repeated. A `monitor`, if there is one, corrects and shrinks the
        predicted change. Return None if a value is not finite.
        """
        model, tick = self._model, self._tick
        out = np.empty((steps, 3))
        if not model.relift:
            rollout_linear(self._memory.phi[: model.n_z], theta, u_ahead, out)
        elif self._step_arrays is not None:
            rollout_lifting(
                tick.x_past,
                tick.u_past,
                theta,
                u_ahead,
                self._memory.disturbance,
                model.residual,
                model.affine,
                out,
                *self._step_arrays,
            )
        else:
            self._run_torchscript(theta, u_ahead, out)
        finite = to_si(
            out,
            self._present_x,
            self._present_disturbance,
            *(_NO_CORRECTION if monitor is None else monitor.correction),
            model.scaling.x_mean,
            model.scaling.x_scale,
        )
        return out if finite else None

    def run_many(
        self, theta: FloatArray, commands: FloatArray, monitor: RolloutMonitor | None
    ) -> tuple[FloatArray, int]:
        """
        Predict states (k, h, 3) under each of `commands` (k, h, 2), SI, also by naive predictors.

        Return the first candidate with a state that is not finite as well, or -1. Without a
        compiled encoder, one candidate after the other.
        """
        out = np.empty((*commands.shape[:2], 3))
        start, output = self._start(theta), self._output(monitor)
        if not self._model.relift:
            return out, int(roll_out_many_linear(commands, start, output, out))
        if self._encoder is not None:
            bad = roll_out_many(
                commands, start, self._form, self._model.affine, self._encoder, output, out
            )
            return out, int(bad)
        for k, one in enumerate(commands):
            states = self.run(theta, self._model.scaling.scale_u(one), len(one), monitor)
            if states is None:
                return out, k
            replace_by_naive(states, KNOWN, self._memory.rows)
            out[k] = states
        return out, -1

    def linearized(
        self, theta: FloatArray, commands: FloatArray, monitor: RolloutMonitor | None
    ) -> LinearizedRollout:
        """Return the local linear model along the rollout under `commands` (h, 2), SI."""
        return linearize(self._model, self._start(theta), self._output(monitor), commands)

    def _start(self, theta: FloatArray) -> RolloutStart:
        memory = self._memory
        return RolloutStart(
            memory.tick.x_past, memory.tick.u_past, memory.phi, theta, memory.disturbance
        )

    def _output(self, monitor: RolloutMonitor | None) -> OutputArrays:
        correction = _NO_CORRECTION if monitor is None else monitor.correction
        return OutputArrays(self._memory.scaling, *correction, self._memory.fallback)

    def _run_torchscript(self, theta: FloatArray, u_ahead: FloatArray, out: FloatArray) -> None:
        model = self._model
        x_past, u_past = self._tick.x_past.copy(), self._tick.u_past.copy()
        row, phi = self._tick.row.copy(), self._memory.phi.copy()
        disturbance = self._memory.disturbance[:2].copy()
        for step in range(out.shape[0]):
            u = u_ahead[min(step, u_ahead.shape[0] - 1)]
            pack_encoder_input(x_past, u_past, row)
            set_command(row, 3 * x_past.shape[0], u[0], u[1])
            phi[:3] = x_past[0]
            phi[3 : model.n_z] = model.lifting(row)
            phi[model.n_z : model.n_z + 2] = u
            change = (theta[:3] @ phi + disturbance.sum(axis=0)) * model.scaling.step_scale
            disturbance *= self._memory.gains[[2, 4]]
            new = change + x_past[0] if model.residual else change
            limit_step(tuple(x_past[0].tolist()), new, self._form.bounds)
            new = np.clip(new, -MAX_SCALED_STATE, MAX_SCALED_STATE)
            shift_in(x_past, new)
            shift_in(u_past, u)
            out[step] = new
