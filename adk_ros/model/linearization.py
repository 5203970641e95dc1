# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Local linear model along a rollout, and the rollout's derivatives by the commands.

    s_(j+1) = A_j s_j + B_j u_j + c_j           s: state, below
    y_j = g_j x_(j+1) + e_j                     x: first three entries of s; y: predicted state

A_j and B_j are the Jacobians of step j at the rollout's own states, c_j makes the model exact
there. If each step is lifted anew, s is the delay-embedded state [x_k .. x_(k-p), u_(k-1) ..
u_(k-p)] with p past samples, from which the next step follows; otherwise it is the lifted state
z. g (shrinkage and weight of the model against naive predictors) and e (predicted error, naive
predictors) are what `Predictor.rollout` applies to the model's states. Everything is float64;
the states differ from the float32 rollout by its rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adk_ros.errors import UsageError
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.uncertainty.batch_rollout import OutputArrays, RolloutStart, output_tables
from adk_ros.model.uncertainty.compiled_rollout import MAX_SCALED_STATE, FoldedLayer
from adk_ros.model.uncertainty.rollout_jacobians import rollout_jacobians
from adk_ros.numerics.arrays import FloatArray


class LinearizedRollout(NamedTuple):
    """
    Local linear model along a rollout of h steps, see the module's docstring.

    `A` (h, n, n), `B` (h, n, 2), `c` (h, n). `states` (h + 1, n): s, in m/s, m/s and rad/s for
    states, N·m and rad for past commands, features of a lifted state without unit.
    `output_gain` (h, 3): g. `predicted` (h, 3): y, SI.
    """

    A: FloatArray
    B: FloatArray
    c: FloatArray
    states: FloatArray
    output_gain: FloatArray
    predicted: FloatArray

    def gradient(self, by_state: ArrayLike) -> FloatArray:
        """
        Return dJ/du (h, 2) of a cost J, given `by_state` (h, 3) = dJ/dy, by the adjoint method.

        lambda_j = A_j' lambda_(j+1) + [g_(j-1) dJ/dy_(j-1); 0],  dJ/du_j = B_j' lambda_(j+1)

        :raises UsageError: the shape is wrong, or a value is not finite.
        """
        wanted = self.predicted.shape
        given = np.asarray(by_state, dtype=np.float64)
        if given.shape != wanted or not np.isfinite(given).all():
            raise UsageError(
                f"the gradient by the states has shape {given.shape}: give {wanted}, finite"
            )
        adjoint = np.zeros(self.states.shape[1])
        result = np.empty((len(given), 2))
        for j in range(len(given) - 1, -1, -1):
            adjoint[:3] += self.output_gain[j] * given[j]
            result[j] = self.B[j].T @ adjoint
            adjoint = self.A[j].T @ adjoint
        return result

    def blocks(self) -> FloatArray:
        """
        Return the model as one array (h + 1, n + 3, n + 3), for transport.

        Block 0 has the start s_0 in the first n rows of its last column and zeros elsewhere.
        Block j + 1 is [[A_j, B_j, c_j], [C_j, 0, e_j]] with y_j = C_j s_(j+1) + e_j, SI.
        """
        steps, n = self.c.shape
        out = np.zeros((steps + 1, n + 3, n + 3))
        out[0, :n, -1] = self.states[0]
        out[1:, :n, :n], out[1:, :n, n:-1], out[1:, :n, -1] = self.A, self.B, self.c
        channel = np.arange(3)
        out[1:, n + channel, channel] = self.output_gain
        out[1:, n:, -1] = self.predicted - self.output_gain * self.states[1:, :3]
        return out

    def jacobian(self) -> FloatArray:
        """Return dy_i/du_j (h, 3, h, 2): axes are step and channel, then step and command."""
        steps, n = self.c.shape
        by_commands = np.zeros((n, steps, 2))
        result = np.empty((steps, 3, steps, 2))
        for j in range(steps):
            by_commands[:, :j] = (self.A[j] @ by_commands[:, :j].reshape(n, -1)).reshape(n, j, 2)
            by_commands[:, j] = self.B[j]
            result[j] = self.output_gain[j][:, None, None] * by_commands[:3]
        return result


def linearize(
    model: KoopmanModel, start: RolloutStart, output: OutputArrays, commands: FloatArray
) -> LinearizedRollout:
    """
    Linearize the rollout of `model` under `commands` (h, 2), SI.

    :raises UsageError: the encoder has no compiled form, which the derivatives are of.
    """
    u = model.scaling.scale_u(commands)
    scaling = model.scaling
    if not model.relift:
        a, b, states = _lifted_jacobians(start, u)
        n_more = states.shape[1] - 3
        scale = np.concatenate([scaling.x_scale, np.ones(n_more)])
        mean = np.concatenate([scaling.x_mean, np.zeros(n_more)])
    else:
        a, b, states = _embedded_jacobians(model, start, u)
        p = model.history
        scale = np.concatenate([np.tile(scaling.x_scale, p + 1), np.tile(scaling.u_scale, p)])
        mean = np.concatenate([np.tile(scaling.x_mean, p + 1), np.tile(scaling.u_mean, p)])
    a = a * scale[:, None] / scale
    b = b * scale[:, None] / scaling.u_scale
    gain, predicted = _outputs(model, start, output, states[1:, :3])
    states = states * scale + mean
    moved = np.einsum("hij,hj->hi", a, states[:-1]) + np.einsum("hij,hj->hi", b, commands)
    return LinearizedRollout(a, b, states[1:] - moved, states, gain, predicted)


def _embedded_jacobians(
    model: KoopmanModel, start: RolloutStart, u: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (h, m, m), B (h, m, 2) and the states (h + 1, m), scaled."""
    encoder, form = model.lifting.compiled, model.step_form()
    if encoder is None:
        raise UsageError(
            "the model's encoder is not a perceptron of the form that is compiled, and only its "
            "derivatives are known: train a model with this version"
        )
    theta, n_z, n_x = start.theta[:3], model.n_z, form.n_x
    of_features = theta[:, 3:n_z]
    w_skip = of_features @ encoder.skip.T.astype(np.float64)
    w_skip[:, :3] += theta[:, :3]
    bias = of_features @ encoder.b3 + (theta[:, n_z + 2] if model.affine else 0.0)
    folded = FoldedLayer(
        np.ascontiguousarray(of_features @ encoder.w3.T.astype(np.float64)),
        np.ascontiguousarray(w_skip),
        np.column_stack([theta[:, n_z : n_z + 2], bias]),
    )
    states = np.empty((len(u) + 1, n_x + 2 * model.history))
    states[0] = np.concatenate([start.x_past.ravel(), start.u_past.ravel()])
    m = states.shape[1]
    jacobians = np.empty((len(u), 3, m + 2))
    rollout_jacobians(u, start.disturbance, form, encoder, folded, states, jacobians)
    a, b = np.zeros((len(u), m, m)), np.zeros((len(u), m, 2))
    a[:, :3, :n_x], a[:, :3, n_x:] = jacobians[..., :n_x], jacobians[..., n_x + 2 :]
    b[:, :3] = jacobians[..., n_x : n_x + 2]
    older, later = np.arange(3, n_x), np.arange(n_x + 2, m)
    a[:, older, older - 3] = 1.0
    a[:, later, later - 2] = 1.0
    if model.history:
        b[:, n_x : n_x + 2] = np.eye(2)
    return a, b, states


def _lifted_jacobians(
    start: RolloutStart, u: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (h, n_z, n_z), B (h, n_z, 2) and the states (h + 1, n_z) of z+ = A z + B u."""
    theta = start.theta
    n_z = len(theta)
    states = np.empty((len(u) + 1, n_z))
    states[0] = start.phi[:n_z]
    inside = np.empty((len(u), n_z, 1))
    for j, command in enumerate(u):
        new = theta[:, :n_z] @ states[j] + theta[:, n_z:] @ command
        states[j + 1] = np.clip(new, -MAX_SCALED_STATE, MAX_SCALED_STATE)
        inside[j, :, 0] = states[j + 1] == new
    return inside * theta[:, :n_z], inside * theta[:, n_z:], states


def _outputs(
    model: KoopmanModel, start: RolloutStart, output: OutputArrays, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return g (h, 3) and the predicted states (h, 3), SI, of scaled states `x` (h, 3)."""
    naive = np.empty((len(x), 2, 3))
    table = output_tables(start, output, naive)
    gain = np.ones_like(x)
    if len(table):
        base, total = start.x_past[0], x + table[:, 0]
        clamped = np.clip(total, -MAX_SCALED_STATE, MAX_SCALED_STATE)
        gain = table[:, 1] * (clamped == total)
        x = base + table[:, 1] * (clamped - base)
    of_model = model.scaling.unscale_x(x)
    return gain * (1.0 - naive[:, 0]), of_model + naive[:, 1] - naive[:, 0] * of_model
