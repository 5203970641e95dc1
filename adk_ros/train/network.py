# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The networks: the default encoder, which rolls itself out, and the paper's encoder and decoder.

The default predicts scaled increments from z = [x_k, encoder(past)] by one linear map, and is
lifted anew at each step of a roll-out, so that training sees what the predictor will do.
"""

from __future__ import annotations

import io
import warnings

import numpy as np
import torch
from torch import Tensor, nn

from adk_ros.model.lifting import input_size
from adk_ros.signals.channels import FloatArray


class Encoder(nn.Module):
    """
    Perceptron with two hidden softsign layers and a linear shortcut: (b, n) -> (b, m).

    Softsign because it is bounded, as features must be that are rolled out, and costs a division.
    """

    def __init__(self, history: int, hidden: int, features: int) -> None:
        super().__init__()
        n = input_size(history)
        self.w1 = nn.Parameter(torch.randn(n, hidden) / n**0.5)
        self.b1 = nn.Parameter(torch.randn(hidden) * 0.1)
        self.w2 = nn.Parameter(torch.randn(hidden, hidden) / hidden**0.5)
        self.b2 = nn.Parameter(torch.randn(hidden) * 0.1)
        self.w3 = nn.Parameter(torch.randn(hidden, features) / hidden**0.5)
        self.b3 = nn.Parameter(torch.zeros(features))
        self.skip = nn.Parameter(torch.randn(n, features) * 0.1 / n**0.5)
        self.activation = nn.Softsign()

    def forward(self, row: Tensor) -> Tensor:
        """Features (b, m) of input rows (b, n), columns as in `lifting.input_size`."""
        first = self.activation(torch.addmm(self.b1, row, self.w1))
        second = self.activation(torch.addmm(self.b2, first, self.w2))
        return torch.addmm(torch.addmm(self.b3, second, self.w3), row, self.skip)


class Network(nn.Module):
    """Encoder and head: increments = head [x_k, features, u_k, 1]."""

    step_scale: Tensor

    def __init__(self, history: int, hidden: int, features: int, step_scale: FloatArray) -> None:
        super().__init__()
        self.history = history
        self.encoder = Encoder(history, hidden, features)
        self.head = nn.Parameter(torch.zeros(3 + features + 3, 3))
        self.register_buffer("step_scale", torch.tensor(step_scale, dtype=torch.float32))
        with torch.no_grad():
            self.head.normal_(0.0, 0.02)

    def roll_out(self, x_past: Tensor, u_past: Tensor, u_ahead: Tensor) -> Tensor:
        """
        Predict scaled states (b, h, 3).

        `x_past` (b, p + 1, 3) and `u_past` (b, p, 2) newest first, `u_ahead` (b, h, 2), scaled.
        """
        batch, ahead = u_ahead.shape[0], u_ahead.shape[1]
        x_row = x_past.reshape(batch, -1)
        u_row = u_past.reshape(batch, -1)
        ones = torch.ones(batch, 1, device=u_ahead.device)
        out = []
        for step in range(ahead):
            now, u = x_row[:, :3], u_ahead[:, step]
            features = self.encoder(torch.cat([x_row, u_row], dim=1))
            phi = torch.cat([now, features, u, ones], dim=1)
            new = now + (phi @ self.head) * self.step_scale
            out.append(new)
            if self.history:
                x_row = torch.cat([new, x_row[:, :-3]], dim=1)
                u_row = torch.cat([u, u_row[:, :-2]], dim=1)
            else:
                x_row = new
        return torch.stack(out, dim=1)


class PaperNetwork(nn.Module):
    """
    The paper's Table 2: encoder 3-128-128-128-12, decoder its mirror, A (15, 15), B (15, 2).

    Maps `without` bias in A and B, ReLU between the layers (the paper leaves sigma open).
    """

    def __init__(self, hidden: int = 128, features: int = 12) -> None:
        super().__init__()
        self.encoder = _layers(3, hidden, features)
        self.decoder = _layers(features, hidden, 3)
        self.a = nn.Linear(3 + features, 3 + features, bias=False)
        self.b = nn.Linear(2, 3 + features, bias=False)

    def lift(self, x: Tensor) -> Tensor:
        """z = [x, Phi(x)], eq. (6): (b, 3) -> (b, 15)."""
        return torch.cat([x, self.encoder(x)], dim=1)


def _layers(n_in: int, hidden: int, n_out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(n_in, hidden), nn.ReLU(),
        nn.Linear(hidden, hidden), nn.ReLU(),
        nn.Linear(hidden, hidden), nn.ReLU(),
        nn.Linear(hidden, n_out),
    )


def to_torchscript(encoder: nn.Module) -> bytes:
    """Compile an encoder to a TorchScript program, on the CPU and in float32."""
    encoder = encoder.to("cpu", torch.float32).eval()
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # torch announces TorchScript's retirement; it is the format that this package is built on.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.save(torch.jit.script(encoder), buffer)
    return buffer.getvalue()


def as_tensor(array: FloatArray, device: torch.device | str = "cpu") -> Tensor:
    """A float32 tensor of `array` on `device`."""
    return torch.tensor(np.ascontiguousarray(array), dtype=torch.float32, device=device)
