# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Open-loop rollout of a model from the predictor's present state.

Three ways, by the model's form: compiled with a new lift at each step; the same through
TorchScript, for encoders of another form; or linear in the lifted space, as in the paper.
"""

from __future__ import annotations

import numpy as np

from adk_ros.model.estimation.observer import TickArrays
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder_kernels import pack_encoder_input, set_command, shift_in
from adk_ros.model.uncertainty.compiled_rollout import (
    MAX_SCALED_STATE,
    rollout_lifting,
    rollout_linear,
    to_si,
)
from adk_ros.model.uncertainty.error_regression import N_REGRESSORS
from adk_ros.model.uncertainty.motion_limits import limit_step, step_bounds
from adk_ros.model.uncertainty.rollout_monitor import RolloutMonitor
from adk_ros.numerics.arrays import FloatArray

_NO_CORRECTION = np.zeros((0, 3, N_REGRESSORS + 1)), np.ones((0, 3))
"""Weights of the error regression and shrinkage of a rollout that is not corrected."""


class ModelRollout:
    """
    Rolls a model out from arrays that the predictor updates in place.

    :param tick: past samples, scaled. :param phi: regressor (n_phi,) of the present tick.
    :param disturbance: (3, 3) slow, fast, running mean. :param gains: `ObserverGains.table`.
    """

    def __init__(
        self,
        model: KoopmanModel,
        tick: TickArrays,
        phi: FloatArray,
        disturbance: FloatArray,
        gains: FloatArray,
    ) -> None:
        self._model = model
        self._tick = tick
        self._phi = phi
        self._disturbance = disturbance
        # Views, made once: each costs 0.2 us per tick.
        self._present_x = tick.x_past[0]
        self._present_disturbance = disturbance[None]
        self._gains = gains
        encoder = model.lifting.compiled
        self._bounds = step_bounds(model.motion_limits, model.scaling)
        self._step_arrays = (
            None if encoder is None else (model.scaling.step_scale, gains, self._bounds, *encoder)
        )

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
            rollout_linear(self._phi[: model.n_z], theta, u_ahead, out)
        elif self._step_arrays is not None:
            rollout_lifting(
                tick.x_past,
                tick.u_past,
                theta,
                u_ahead,
                self._disturbance,
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

    def _run_torchscript(self, theta: FloatArray, u_ahead: FloatArray, out: FloatArray) -> None:
        model = self._model
        x_past, u_past = self._tick.x_past.copy(), self._tick.u_past.copy()
        row, phi = self._tick.row.copy(), self._phi.copy()
        disturbance = self._disturbance[:2].copy()
        for step in range(out.shape[0]):
            u = u_ahead[min(step, u_ahead.shape[0] - 1)]
            pack_encoder_input(x_past, u_past, row)
            set_command(row, 3 * x_past.shape[0], u[0], u[1])
            phi[:3] = x_past[0]
            phi[3 : model.n_z] = model.lifting(row)
            phi[model.n_z : model.n_z + 2] = u
            change = (theta[:3] @ phi + disturbance.sum(axis=0)) * model.scaling.step_scale
            disturbance *= self._gains[[2, 4]]
            new = change + x_past[0] if model.residual else change
            limit_step(tuple(x_past[0].tolist()), new, self._bounds)
            new = np.clip(new, -MAX_SCALED_STATE, MAX_SCALED_STATE)
            shift_in(x_past, new)
            shift_in(u_past, u)
            out[step] = new
