# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a trained network to a model: features of unit size, and the lifted rows of theta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from adk_ros.model.correction import Correction
from adk_ros.model.lifting import Lifting, input_size
from adk_ros.model.online import OnlineSettings
from adk_ros.model.predictor import Model
from adk_ros.train.dataset import Sequences
from adk_ros.train.fit import Trained
from adk_ros.train.network import Network, as_tensor, to_torchscript


@dataclass(frozen=True)
class Assembled:
    """A model and its encoder's program, as the artefact stores them."""

    model: Model
    program: bytes


def assemble(trained: Trained, part: Sequences, uses_imu: bool) -> Assembled:
    """
    Build the offline model: adaptation off, gains zero, no covariance yet.

    The features are given zero mean and unit deviation on the training data, by folding that into
    the encoder's last layer, so that one ridge suits all columns; the rows of theta that predict
    features are fitted by least squares on pairs of neighbouring ticks.
    """
    network, scaling = trained.network.eval(), trained.scaling
    x, u = as_tensor(scaling.scale_x(part.x)), as_tensor(scaling.scale_u(part.u))
    # A sample without a state may lie between measurements that are there, as of a frozen sensor.
    followed = part.rows[np.isfinite(part.x[part.rows + 1]).all(axis=1)]
    rows = torch.from_numpy(followed[:: max(1, followed.size // 20000)])
    n_features = network.encoder.w3.shape[1]
    with torch.no_grad():
        _normalise(network, _inputs(network, x, u, rows))
        now = network.encoder(_inputs(network, x, u, rows))
        then = network.encoder(_inputs(network, x, u, rows + 1))
        ones = torch.ones(len(rows), 1)
        phi = torch.cat([x[rows], now, u[rows], ones], dim=1).double().numpy()
        change = (then - now).double().numpy()
    theta = np.zeros((3 + n_features, phi.shape[1]))
    theta[:3] = network.head.detach().double().numpy().T
    theta[3:] = np.linalg.solve(phi.T @ phi + np.eye(phi.shape[1]), phi.T @ change).T
    program = to_torchscript(network.encoder)
    model = Model(
        lifting=Lifting(program, input_size(network.history), n_features),
        scaling=scaling,
        theta0=theta,
        history=network.history,
        residual=True,
        affine=True,
        relift=True,
        correction=Correction.none(),
        horizon_covariance=np.zeros((0, 3, 3)),
        usual_change=np.zeros((0, 3)),
        uses_imu=uses_imu,
        online=OnlineSettings("constant"),
    )
    return Assembled(model, program)


def _inputs(
    network: Network, x: torch.Tensor, u: torch.Tensor, rows: torch.Tensor
) -> torch.Tensor:
    past = torch.arange(network.history + 1)
    x_row = x[rows[:, None] - past].reshape(len(rows), -1)
    u_row = u[rows[:, None] - 1 - past[:-1]].reshape(len(rows), -1)
    return torch.cat([x_row, u_row], dim=1)


def _normalise(network: Network, rows: torch.Tensor) -> None:
    encoder, head = network.encoder, network.head
    features = encoder(rows)
    mean, spread = features.mean(0), features.std(0).clamp_min(1e-6)
    encoder.w3.div_(spread)
    encoder.skip.div_(spread)
    encoder.b3.sub_(mean).div_(spread)
    block = slice(3, 3 + features.shape[1])
    head[-1] += mean @ head[block]
    head[block] *= spread[:, None]
