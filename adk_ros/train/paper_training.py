# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The paper's training of DK and ALDK, as printed: Table 2, eqs. (11) to (14), (25) to (28).

    L_linear = |z_(k+1) - A z_k - B u_k|                        (12)
    L_recon  = |x_k - decode(encode(x_k))|                      (13)
    L_pred   = |x_(k+1) - C (A z_k + B u_k)|                    (14)
    L_AL     = |a_(k+1) - (v_pred(k+1) - v_k) / dt|             (25), (26)
    a_(k+1)  = [a_x + v_y r, a_y - v_x r] at k + 1              (27)

Norms are mean squares over the batch; states scaled onto [-1, 1]. L_AL is divided by the range
of the measured acceleration, the one departure: in physical units it outweighs the other three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch

from adk_ros.errors import DataError
from adk_ros.model.adaptation.online_methods import OnlineSettings
from adk_ros.model.estimation.observer_gains import ObserverGains
from adk_ros.model.koopman import KoopmanModel
from adk_ros.model.lifting.encoder import Lifting
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import TICK_NS, Record
from adk_ros.train.assemble import AssembledModel
from adk_ros.train.dataset import sequences
from adk_ros.train.network import PaperNetwork, as_tensor, to_torchscript
from adk_ros.train.network_fit import Step, require_min_rows
from adk_ros.train.train_settings import PaperSettings


def fit_paper(
    train: Sequence[Record],
    settings: PaperSettings,
    on_step: Callable[[Step], None] | None = None,
) -> AssembledModel:
    """
    Train DK, or ALDK with `settings.acceleration`, and return its model (constant until adapted).

    :raises DataError: too little data, no accelerations for ALDK, or the training diverged.
    """
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    part = sequences(train, 0, 1, "training")
    # A sample without a state can lie between valid measurements, for example of a frozen sensor.
    rows = part.rows[np.isfinite(part.x[part.rows + 1]).all(axis=1)]
    require_min_rows(rows)
    a = np.concatenate([record.a for record in train])
    if settings.acceleration:
        rows = rows[np.isfinite(a[rows + 1]).all(axis=1)]
        if rows.size < settings.batch:
            raise DataError(
                "ALDK needs accelerations and the bags have no usable IMU: give bags with a "
                "sensor_msgs/Imu topic, or train DK (--paper dk)"
            )
    scaling = Scaling.min_max(part.x[rows], part.u[rows])
    now = as_tensor(scaling.scale_x(part.x[rows]))
    then = as_tensor(scaling.scale_x(part.x[rows + 1]))
    u = as_tensor(scaling.scale_u(part.u[rows]))
    target = as_tensor(_measured_change(part.x[rows + 1], a[rows + 1]) / scaling.x_scale[:2])
    network = PaperNetwork(settings.hidden, settings.features)
    # Fused: with such small batches the optimiser's calls take a third of the time.
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, fused=True)
    span = target.amax(0) - target.amin(0) if settings.acceleration else torch.ones(2)
    steps = settings.epochs * max(1, rows.size // settings.batch)
    done, running = 0, float("nan")
    for epoch in range(settings.epochs):
        order = np.random.default_rng((settings.seed, epoch)).permutation(rows.size)
        for first in range(0, rows.size - settings.batch + 1, settings.batch):
            pick = torch.from_numpy(order[first : first + settings.batch])
            loss = _loss(network, now[pick], then[pick], u[pick], target[pick], span, settings)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            done += 1
            if on_step is not None and done % 20 == 0:
                value = float(loss.detach())
                running = value if running != running else 0.98 * running + 0.02 * value
                on_step(Step(done, steps, running, float("nan"), settings.learning_rate))
    if not all(bool(torch.isfinite(value).all()) for value in network.state_dict().values()):
        raise DataError("the training diverged: check the units of the bag's channels")
    return _assemble(network, scaling, settings)


def _measured_change(x: FloatArray, a: FloatArray) -> FloatArray:
    """Return eq. (27) as the change of velocity over one tick, (n, 2) in m/s."""
    rate = np.stack([a[:, 0] + x[:, 1] * x[:, 2], a[:, 1] - x[:, 0] * x[:, 2]], axis=1)
    return np.nan_to_num(rate) * TICK_NS * 1e-9


def _loss(
    network: PaperNetwork,
    now: torch.Tensor,
    then: torch.Tensor,
    u: torch.Tensor,
    target: torch.Tensor,
    span: torch.Tensor,
    settings: PaperSettings,
) -> torch.Tensor:
    features, later = network.encoder(torch.cat([now, then])).split(now.shape[0])
    z = torch.cat([now, features], dim=1)
    predicted = network.a(z) + network.b(u)
    linear = (torch.cat([then, later], dim=1) - predicted).square().mean()
    reconstruction = (now - network.decoder(features)).square().mean()
    prediction = (then - predicted[:, :3]).square().mean()
    total: torch.Tensor = linear + reconstruction + prediction
    if settings.acceleration:
        change = predicted[:, :2] - now[:, :2]
        total = total + ((target - change) / span).square().mean()
    return total


def _assemble(network: PaperNetwork, scaling: Scaling, settings: PaperSettings) -> AssembledModel:
    theta = torch.cat([network.a.weight, network.b.weight], dim=1).detach().double().numpy()
    program = to_torchscript(network.encoder)
    model = KoopmanModel(
        lifting=Lifting(program, 3, settings.features),
        scaling=scaling,
        theta0=theta,
        history=0,
        residual=False,
        affine=False,
        relift=False,
        observer_gains=ObserverGains.none(),
        horizon_covariance=np.zeros((0, 3, 3)),
        mean_square_change=np.zeros((0, 3)),
        uses_imu=settings.acceleration,
        online=OnlineSettings("swls", window=settings.window),
    )
    return AssembledModel(model, program)
