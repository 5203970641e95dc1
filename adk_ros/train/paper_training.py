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
from dataclasses import replace
from pathlib import Path

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
from adk_ros.train import checkpoint
from adk_ros.train.assemble import AssembledModel
from adk_ros.train.dataset import sequences
from adk_ros.train.network import PaperNetwork, as_tensor, to_torchscript
from adk_ros.train.network_fit import Step, choose_device, require_min_rows
from adk_ros.train.paper_step import PaperSamples, adam, update_of
from adk_ros.train.train_settings import PaperSettings

_CHECKPOINT_EVERY = 50_000
"""Updates between checkpoints, written at the end of an epoch: a minute or so on a CPU."""
STEPS_PER_REPORT = 20
"""Steps between calls of `on_step`: each reads the loss, which waits for a GPU."""


def fit_paper(
    train: Sequence[Record],
    settings: PaperSettings,
    on_step: Callable[[Step], None] | None = None,
    checkpoint_path: Path | None = None,
) -> AssembledModel:
    """
    Train DK, or ALDK with `settings.acceleration`, and return its model (constant until adapted).

    A checkpoint of the same training at `checkpoint_path` is resumed, also one of another device;
    the last one is kept, so that a finished training is not repeated.
    :raises UsageError: the device is cuda and there is no GPU.
    :raises DataError: too little data, no accelerations for ALDK, or the training diverged.
    """
    torch.set_num_threads(1)
    device = choose_device(settings.device)
    torch.manual_seed(settings.seed)
    part = sequences(train, 0, 1, "training")
    # A sample without a state can lie between valid measurements, for example of a frozen sensor.
    rows = part.rows[np.isfinite(part.x[part.rows + 1]).all(axis=1)]
    require_min_rows(rows)
    a = np.concatenate([record.a for record in train])
    if settings.acceleration:
        rows = rows[np.isfinite(a[rows + 1]).all(axis=1)]
        if not rows.size:
            raise DataError(
                "ALDK needs accelerations and the bags have no usable IMU: give bags with a "
                "sensor_msgs/Imu topic, or train DK (--paper dk)"
            )
    if rows.size < settings.batch:
        raise DataError(
            f"{rows.size} usable samples are fewer than a batch of {settings.batch}: give more or "
            "longer recordings"
        )
    scaling = Scaling.min_max(part.x[rows], part.u[rows])
    target = as_tensor(_measured_change(part.x[rows + 1], a[rows + 1]) / scaling.x_scale[:2])
    samples = PaperSamples(
        now=as_tensor(scaling.scale_x(part.x[rows])),
        then=as_tensor(scaling.scale_x(part.x[rows + 1])),
        u=as_tensor(scaling.scale_u(part.u[rows])),
        target=target,
        span=target.amax(0) - target.amin(0) if settings.acceleration else torch.ones(2),
        acceleration=settings.acceleration,
    ).to(device)
    network = PaperNetwork(settings.hidden, settings.features).to(device)
    # The device is no part of the training: one begun on a GPU continues on a CPU.
    key = checkpoint.fingerprint(replace(settings, device="cpu"), list(train))
    _run(network, samples, settings, on_step, checkpoint_path, key)
    network = network.to("cpu")
    if not all(bool(torch.isfinite(value).all()) for value in network.state_dict().values()):
        raise DataError("the training diverged: check the units of the bag's channels")
    return _assemble(network, scaling, settings)


def _run(
    network: PaperNetwork,
    samples: PaperSamples,
    settings: PaperSettings,
    on_step: Callable[[Step], None] | None,
    checkpoint_path: Path | None,
    key: str,
) -> None:
    """Train a network in place, from the checkpoint of `key` if there is one."""
    optimiser = adam(network, settings.learning_rate)
    found = checkpoint.load(checkpoint_path, key, network, optimiser) if checkpoint_path else None
    done, running = (found[0], float(found[1]["running"])) if found else (0, float("nan"))
    batches = samples.now.shape[0] // settings.batch
    steps = settings.epochs * batches
    if done >= steps:
        return
    update = update_of(network, optimiser, samples, settings.batch)
    saved = done
    for epoch in range(done // batches, settings.epochs):
        order = np.random.default_rng((settings.seed, epoch)).permutation(samples.now.shape[0])
        order = order[: batches * settings.batch].reshape(batches, settings.batch)
        for rows in torch.from_numpy(order).to(samples.now.device):
            loss = update(rows)
            done += 1
            if on_step is not None and done % STEPS_PER_REPORT == 0:
                value = float(loss)
                running = value if running != running else 0.98 * running + 0.02 * value
                on_step(Step(done, steps, running, float("nan"), settings.learning_rate))
        due = done == steps or done - saved >= _CHECKPOINT_EVERY
        if checkpoint_path is not None and due:
            extra = {"running": np.array(running)}
            checkpoint.save(checkpoint_path, key, done, network, optimiser, extra)
            saved = done


def _measured_change(x: FloatArray, a: FloatArray) -> FloatArray:
    """Return eq. (27) as the change of velocity over one tick, (n, 2) in m/s."""
    rate = np.stack([a[:, 0] + x[:, 1] * x[:, 2], a[:, 1] - x[:, 0] * x[:, 2]], axis=1)
    return np.nan_to_num(rate) * TICK_NS * 1e-9


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
