# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Assemble a model from a trained network.

Normalises the network's features and fits the lifted rows of theta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.train.dataset import Sequences
from adk_ros.train.network import Lift, Network, as_tensor, to_torchscript
from adk_ros.train.network_fit import FittedNetwork

_RIDGE_LEVELS = (1.0, 1e-2, 1e-4, 1e-6)
"""
Weights of the network's head in the one-step refit, in units of the Gram matrix. A grid; the
choice is made on validation data.
"""
_MAX_PAIRS = 20000
"""Pairs of ticks that features and theta are fitted to: enough for about 20 columns."""


@dataclass(frozen=True)
class AssembledModel:
    """
    A model and its encoder's TorchScript program, as a model folder stores them.

    `refitted`: copies of theta0 with the state's rows refitted to one step, by decreasing ridge;
    validation selects among them.
    """

    model: KoopmanModel
    program: bytes
    refitted: tuple[FloatArray, ...] = ()


def assemble(trained: FittedNetwork, part: Sequences, uses_imu: bool) -> AssembledModel:
    """
    Return the offline model, without adaptation, gains and covariances.

    The features get zero mean and unit deviation on the training data, folded into the encoder's
    output layer, so that one ridge suits all columns. The rows of theta that predict features are
    fitted by least squares to pairs of neighbouring ticks.
    """
    network, scaling = trained.network.eval(), trained.scaling
    x, u = as_tensor(scaling.scale_x(part.x)), as_tensor(scaling.scale_u(part.u))
    # A sample without a state can lie between valid measurements, for example of a frozen sensor.
    followed = part.rows[np.isfinite(part.x[part.rows + 1]).all(axis=1)]
    rows = torch.from_numpy(followed[:: max(1, followed.size // _MAX_PAIRS)])
    with torch.no_grad():
        features = network.encoder(_inputs(network, x, u, rows))
        mean, spread = features.mean(0), features.std(0).clamp_min(1e-6)
        lift = Lift(network.encoder, mean, spread)
        n_features = mean.shape[0]
        now = lift(_inputs(network, x, u, rows))
        then = lift(_inputs(network, x, u, rows + 1))
        ones = torch.ones(len(rows), 1)
        phi = torch.cat([x[rows], now, u[rows], ones], dim=1).double().numpy()
        change = (then - now).double().numpy()
        target = (as_tensor(scaling.scale_x(part.x_ref))[rows + 1] - x[rows]).double().numpy()
    theta = np.zeros((3 + n_features, phi.shape[1]))
    theta[:3] = _head(network, mean, spread).T
    theta[3:] = np.linalg.solve(phi.T @ phi + np.eye(phi.shape[1]), phi.T @ change).T
    free = network.mask[:, 0].numpy() > 0.0
    centre = np.zeros(phi.shape[1])
    if not free[-1]:
        # No constant is refitted: it would count everywhere.
        centre[3 : 3 + n_features] = (mean / spread).double().numpy()
    refitted = _refit_output_layer(theta, phi, target / scaling.step_scale, free, centre)
    program = to_torchscript(lift)
    model = KoopmanModel(
        lifting=Lifting(program, input_size(network.history), n_features),
        scaling=scaling,
        theta0=theta,
        history=network.history,
        residual=True,
        affine=True,
        relift=True,
        observer_gains=ObserverGains.none(),
        horizon_covariance=np.zeros((0, 3, 3)),
        mean_square_change=np.zeros((0, 3)),
        uses_imu=uses_imu,
        online=OnlineSettings("constant"),
    )
    return AssembledModel(model, program, refitted)


def _inputs(
    network: Network, x: torch.Tensor, u: torch.Tensor, rows: torch.Tensor
) -> torch.Tensor:
    past = torch.arange(network.history + 1)
    x_row = x[rows[:, None] - past].reshape(len(rows), -1)
    if not network.history:
        return x_row
    return torch.cat([x_row, u[rows[:, None] - past].reshape(len(rows), -1)], dim=1)


def _refit_output_layer(
    theta: FloatArray,
    phi: FloatArray,
    target: FloatArray,
    free: BoolArray,
    centre: FloatArray,
) -> tuple[FloatArray, ...]:
    """
    Return copies of `theta` with the first three rows refitted, one for each of `_RIDGE_LEVELS`.

    Multi-step training leaves small one-step errors, which least squares removes. The ridge
    penalises the difference from `theta`. `free` (n_phi,): columns that change. `centre` (n_phi,):
    what the columns of features lack to those that are zero where the encoder's are.
    """
    known = np.isfinite(target).all(axis=1)
    phi, target = phi[known], target[known]
    residual = target - phi @ theta[:3].T
    phi = (phi + centre)[:, free]
    right = phi.T @ residual
    result = []
    for level in _RIDGE_LEVELS:
        changed = theta.copy()
        ridge = level * len(phi) * np.eye(phi.shape[1])
        change = np.linalg.solve(phi.T @ phi + ridge, right).T
        changed[:3, free] += change
        changed[:3, -1] += change @ centre[free]
        result.append(changed)
    return tuple(result)


def _head(network: Network, mean: torch.Tensor, spread: torch.Tensor) -> FloatArray:
    """Return the head (n_phi, 3) for features that are normalised by `mean` and `spread`."""
    head = (network.base + network.mask * network.head).detach()
    block = slice(3, 3 + mean.shape[0])
    head[-1] += mean @ head[block]
    head[block] *= spread[:, None]
    return np.asarray(head.double().numpy())
