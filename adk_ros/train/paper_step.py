# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One update of the paper's training: its losses, eqs. (11) to (14), (25), (26), and Adam.

Batches of 20 samples leave a GPU idle between kernels, so there the update is compiled and
recorded as a CUDA graph, which is one launch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from adk_ros.train.network import PaperNetwork

_WARM_UP = 3
"""Updates before the capture, which compile and allocate: as PyTorch's notes on CUDA graphs do."""

Update = Callable[[Tensor], Tensor]
"""Update the network with the samples of these rows (b,); return the loss."""


@dataclass(frozen=True)
class PaperSamples:
    """
    Scaled samples: state (n, 3), next state (n, 3), command (n, 2), measured change (n, 2).

    `span` (2,): range of the measured change; `acceleration`: whether its loss counts.
    """

    now: Tensor
    then: Tensor
    u: Tensor
    target: Tensor
    span: Tensor
    acceleration: bool

    def to(self, device: torch.device) -> PaperSamples:
        """Return the samples on a device."""
        return PaperSamples(
            self.now.to(device),
            self.then.to(device),
            self.u.to(device),
            self.target.to(device),
            self.span.to(device),
            self.acceleration,
        )

    def loss(self, network: PaperNetwork, rows: Tensor) -> Tensor:
        """Return the paper's loss of the samples of `rows` (b,)."""
        now, then, u, target = (x[rows] for x in (self.now, self.then, self.u, self.target))
        features, later = network.encoder(torch.cat([now, then])).split(now.shape[0])
        z = torch.cat([now, features], dim=1)
        predicted = network.a(z) + network.b(u)
        linear = (torch.cat([then, later], dim=1) - predicted).square().mean()
        reconstruction = (now - network.decoder(features)).square().mean()
        prediction = (then - predicted[:, :3]).square().mean()
        total: Tensor = linear + reconstruction + prediction
        if self.acceleration:
            change = predicted[:, :2] - now[:, :2]
            total = total + ((target - change) / self.span).square().mean()
        return total


def adam(network: PaperNetwork, learning_rate: float) -> torch.optim.Adam:
    """Return the optimiser; on a GPU one that a CUDA graph can contain."""
    on_gpu = next(network.parameters()).is_cuda
    # Fused: with such small batches the optimiser's calls take a third of the time.
    return torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True, capturable=on_gpu)


def update_of(
    network: PaperNetwork, optimiser: torch.optim.Adam, samples: PaperSamples, batch: int
) -> Update:
    """Return the update for batches of `batch` rows; `samples` are on the network's device."""

    def update(rows: Tensor) -> Tensor:
        loss = samples.loss(network, rows)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        return loss.detach()

    if not samples.now.is_cuda:
        return update
    return _captured(network, optimiser, samples, batch)


def _captured(
    network: PaperNetwork, optimiser: torch.optim.Adam, samples: PaperSamples, batch: int
) -> Update:
    rows = torch.zeros(batch, dtype=torch.int64, device=samples.now.device)
    compiled = torch.compile(samples.loss)

    def update() -> Tensor:
        optimiser.zero_grad(set_to_none=True)
        loss: Tensor = compiled(network, rows)
        loss.backward()
        optimiser.step()
        return loss.detach()

    before = [value.detach().clone() for value in network.parameters()]
    moments = {
        parameter: {name: value.clone() for name, value in state.items()}
        for parameter, state in optimiser.state.items()
    }
    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        for _ in range(_WARM_UP):
            update()
    torch.cuda.current_stream().wait_stream(side)
    graph = torch.cuda.CUDAGraph()
    optimiser.zero_grad(set_to_none=True)
    with torch.cuda.graph(graph):
        loss = update()
    # The warm-up must leave no trace; in place, since the graph contains the addresses.
    with torch.no_grad():
        for value, kept in zip(network.parameters(), before, strict=True):
            value.copy_(kept)
            for name, moment in optimiser.state[value].items():
                if value in moments:
                    moment.copy_(moments[value][name])
                else:
                    moment.zero_()

    def replay(chosen: Tensor) -> Tensor:
        rows.copy_(chosen)
        graph.replay()
        return loss

    return replay
