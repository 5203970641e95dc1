# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
From a trained network to a model: features of unit size, the lifted rows, gains, covariance.

What is chosen here is chosen on the validation part alone, by the predictor itself:
`Predictor.step` over the samples, scored against the best naive predictor of each cell. To value
adaptation as well as the fit, every choice is also made on the validation data with its commands
scaled (torque 0.8, steering 0.85), which to the model is a car that answers otherwise than the
one it knows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from adk_ros.model.evaluate import Rollouts, roll_out_record
from adk_ros.model.lifting import Lifting, input_size
from adk_ros.model.online import OnlineSettings
from adk_ros.model.predictor import Model
from adk_ros.signals.channels import BoolArray, FloatArray, Record
from adk_ros.signals.score import best_naive, naive_predictions, score
from adk_ros.train.dataset import VALIDATION, Sequences, Split
from adk_ros.train.fit import Trained
from adk_ros.train.network import Network, as_tensor, to_torchscript

_AHEAD = 80
_CHANGED_CAR = np.array([0.8, 0.85])
_WINDOWS = ((400, 100.0), (400, 1000.0), (400, 10000.0), (1000, 1000.0))
_DISTURBANCES = ((0.0, 1.0), (0.02, 0.99), (0.05, 0.99), (0.05, 0.97), (0.1, 0.97))
_TUNING_ROWS = 400

Note = Callable[[str, int, int], None]


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
        disturbance_gain=np.zeros(3),
        disturbance_decay=np.ones(3),
        horizon_covariance=np.zeros((0, 3, 3)),
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


def tune(model: Model, split: Split, note: Note | None = None) -> Model:
    """
    Choose window, ridge and the disturbance's gains on the validation part; set the covariance.

    Gains are chosen channel by channel, windows by the geometric mean over all cells.
    """
    cases = _cases(split)
    total = len(_WINDOWS) + len(_DISTURBANCES)
    ratios = []
    for number, (window, ridge) in enumerate(_WINDOWS):
        if note:
            note("tuning adaptation", number, total)
        online = OnlineSettings("windowed", window=window, ridge=ridge)
        ratios.append(_ratio(model, cases, online).mean())
    window, ridge = _WINDOWS[int(np.argmin(ratios))]
    online = OnlineSettings("windowed", window=window, ridge=ridge)
    by_channel = []
    for number, (gain, decay) in enumerate(_DISTURBANCES):
        if note:
            note("tuning adaptation", len(_WINDOWS) + number, total)
        trial = replace(
            model, disturbance_gain=np.full(3, gain), disturbance_decay=np.full(3, decay)
        )
        by_channel.append(_ratio(trial, cases, online).mean(axis=(0, 1)))
    chosen = np.argmin(by_channel, axis=0)
    model = replace(
        model,
        disturbance_gain=np.array([_DISTURBANCES[i][0] for i in chosen]),
        disturbance_decay=np.array([_DISTURBANCES[i][1] for i in chosen]),
        online=online,
    )
    return replace(model, horizon_covariance=horizon_covariance(model, split))


def _cases(split: Split) -> list[tuple[Record, BoolArray]]:
    cases = []
    for record, parts in zip(split.records, split.parts, strict=True):
        scored = parts == VALIDATION
        if scored.any():
            cases.append((record, scored))
            changed = record.u.mean(axis=0) + (record.u - record.u.mean(axis=0)) / _CHANGED_CAR
            cases.append((replace(record, u=changed), scored))
    return cases


def _ratio(
    model: Model, cases: list[tuple[Record, BoolArray]], online: OnlineSettings
) -> FloatArray:
    """Log of RMSE over the best naive predictor's, (cases, steps, 3)."""
    rows = sum(int(scored.sum()) for _, scored in cases)
    stride = max(4, rows // _TUNING_ROWS)
    result = []
    for record, scored in cases:
        rolled = roll_out_record(model, record, online, scored, _AHEAD, stride)
        if rolled.rows.size:
            result.append(np.log(_against_naive(rolled)))
    # Too short a validation part for a horizon: nothing to choose by, the first choice stands.
    return np.array(result) if result else np.zeros((1, 1, 3))


def _against_naive(rolled: Rollouts) -> FloatArray:
    ours = score(rolled.record, rolled.rows, rolled.predicted).rmse
    naive = naive_predictions(rolled.record, rolled.rows, _AHEAD)
    best = best_naive({k: score(rolled.record, rolled.rows, v) for k, v in naive.items()})
    return ours / np.maximum(best, 1e-9)


def horizon_covariance(model: Model, split: Split, ahead: int = _AHEAD) -> FloatArray:
    """Covariance (ahead, 3, 3) of the errors under known commands on the validation part, SI."""
    errors = []
    for record, parts in zip(split.records, split.parts, strict=True):
        rolled = roll_out_record(model, record, None, parts == VALIDATION, ahead, stride=8)
        if rolled.rows.size:
            future = rolled.rows[:, None] + np.arange(1, ahead + 1)
            errors.append(rolled.predicted - record.x_ref[future])
    if not errors:
        usual = np.square(model.scaling.x_scale * model.scaling.step_scale)
        return np.diag(usual)[None] * np.arange(1, ahead + 1)[:, None, None]
    joined = np.concatenate(errors)
    return np.asarray(np.einsum("nhi,nhj->hij", joined, joined) / joined.shape[0])
