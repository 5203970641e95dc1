# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Networks for training: the default encoder with its head, and the paper's encoder and decoder.

The default network predicts scaled increments from z = [x_k, encoder(past)] by one linear map,
and is lifted anew at each step of a rollout, as in the predictor.
"""

from __future__ import annotations

import io
import warnings

import numpy as np
import torch
from torch import Tensor, nn

from adk_ros.model.lifting.encoder import input_size
from adk_ros.model.lifting.single_track import SINGLE_TRACK_FEATURES
from adk_ros.numerics.arrays import FloatArray
from adk_ros.train.quadratic_features import QuadraticFeatures
from adk_ros.train.single_track_fit import SingleTrack
from adk_ros.train.single_track_network import SingleTrackModule, compiled_single_track


class Encoder(nn.Module):
    """
    Perceptron with two hidden tanh layers and a linear skip path: (b, n) -> (b, m + k).

    tanh is bounded, which rollouts need, and a single call in TorchScript. The last k features are
    not trained: they are the `quadratic` features fitted by least squares. With a single-track
    model the last six are its increments, with the quadratic features added, and its forces; all
    others, and the quadratic features, are multiplied by its weight w.
    """

    def __init__(
        self,
        history: int,
        hidden: int,
        features: int,
        quadratic: QuadraticFeatures | None = None,
        single: SingleTrack | None = None,
    ) -> None:
        super().__init__()
        n = input_size(history)
        quadratic = quadratic or QuadraticFeatures.none(n)
        self.has_single_track = single is not None
        if single is not None:
            arrays = single.car, single.command_filter, single.limits
            self.single_track = SingleTrackModule(*map(torch.from_numpy, arrays))
        self.reach = nn.Buffer(torch.from_numpy(quadratic.reach))
        self.directions = nn.Buffer(torch.from_numpy(quadratic.directions))
        self.weights = nn.Buffer(torch.from_numpy(quadratic.weights))
        self.linear = nn.Buffer(torch.from_numpy(quadratic.linear))
        self.level = nn.Buffer(torch.from_numpy(quadratic.level))
        self.w1 = nn.Parameter(torch.randn(n, hidden) / n**0.5)
        self.b1 = nn.Parameter(torch.randn(hidden) * 0.1)
        self.w2 = nn.Parameter(torch.randn(hidden, hidden) / hidden**0.5)
        self.b2 = nn.Parameter(torch.randn(hidden) * 0.1)
        self.w3 = nn.Parameter(torch.randn(hidden, features) / hidden**0.5)
        self.b3 = nn.Parameter(torch.zeros(features))
        self.skip = nn.Parameter(torch.randn(n, features) * 0.1 / n**0.5)

    def forward(self, row: Tensor) -> Tensor:
        """Features (b, m + k) of input rows (b, n), columns as in `lifting.input_size`."""
        inside = torch.clamp(row, -self.reach, self.reach)
        first = torch.tanh(torch.addmm(self.b1, inside, self.w1))
        second = torch.tanh(torch.addmm(self.b2, first, self.w2))
        learned = torch.addmm(torch.addmm(self.b3, second, self.w3), row, self.skip)
        if self.level.shape[0]:
            seen = torch.mm(inside, self.directions)
            known = torch.addmm(self.level, seen * seen, self.weights)
            learned = torch.cat([learned, torch.addmm(known, row, self.linear)], dim=1)
        if not self.has_single_track:
            return learned
        single = compiled_single_track(self.single_track, row)
        learned = single[:, 6:7] * learned
        if not self.level.shape[0]:
            return torch.cat([learned, single[:, :6]], dim=1)
        increments = learned[:, -3:] + single[:, :3]
        return torch.cat([learned[:, :-3], increments, single[:, 3:6]], dim=1)

    @property
    def known_features(self) -> int:
        """Number of features that are not trained."""
        if self.has_single_track:
            return SINGLE_TRACK_FEATURES
        return self.level.shape[0]


class Lift(nn.Module):
    """
    An `Encoder` for the model folder: output layers joined, features normalised.

    :param mean, spread: (m + k,) mean and deviation of the features on training data.
    """

    __constants__ = ("has_single_track", "has_squares")

    def __init__(self, encoder: Encoder, mean: Tensor, spread: Tensor) -> None:
        super().__init__()
        features, squares = encoder.b3.shape[0], encoder.directions.shape[1]
        hidden, fitted = encoder.w2.shape[1], encoder.level.shape[0]
        learned = hidden + squares
        w3 = torch.zeros(learned, features + fitted)
        w3[:hidden, :features], w3[hidden:, features:] = encoder.w3, encoder.weights
        skip = torch.cat([encoder.skip, encoder.linear], dim=1)
        b3 = torch.cat([encoder.b3, encoder.level])
        self.has_single_track = encoder.has_single_track
        if encoder.has_single_track:
            # Rows for [w hidden; w squares; features of the single-track model; w; w row].
            weighted = w3
            w3 = torch.zeros(learned + SINGLE_TRACK_FEATURES + 1 + skip.shape[0], len(mean))
            last, wide = learned + SINGLE_TRACK_FEATURES, features + fitted
            w3[:learned, :wide], w3[last, :wide], w3[last + 1 :, :wide] = weighted, b3, skip
            w3[learned:last, features:] = torch.eye(SINGLE_TRACK_FEATURES)
            skip, b3 = torch.zeros(skip.shape[0], len(mean)), torch.zeros(len(mean))
            self.single_track = encoder.single_track
        # No class annotations: TorchScript cannot read them.
        self.w1, self.b1 = _fixed(encoder.w1), _fixed(encoder.b1)
        self.w2, self.b2 = _fixed(encoder.w2), _fixed(encoder.b2)
        self.w3, self.b3 = _fixed(w3 / spread), _fixed((b3 - mean) / spread)
        self.skip = _fixed(skip / spread)
        self.reach, self.directions = _fixed(encoder.reach), _fixed(encoder.directions)
        self.has_squares = squares > 0

    def forward(self, row: Tensor) -> Tensor:
        """Features (b, m + k) of input rows (b, n)."""
        inside = torch.clamp(row, -self.reach, self.reach)
        first = torch.tanh(torch.addmm(self.b1, inside, self.w1))
        second = torch.tanh(torch.addmm(self.b2, first, self.w2))
        # One product for layer, squares and skip path: each call in TorchScript costs time.
        # The joined weights become a constant when the program is frozen.
        weights = torch.cat([self.w3, self.skip])
        if self.has_squares:
            forms = torch.mm(inside, self.directions)
            second = torch.cat([second, forms * forms], dim=1)
        if self.has_single_track:
            single = self.single_track(row)
            weight = single[:, 6:7]
            second = torch.cat([weight * second, single, weight * row], dim=1)
        return torch.addmm(self.b3, torch.cat([second, row], dim=1), weights)


def _fixed(value: Tensor) -> nn.Buffer:
    return nn.Buffer(value.detach().clone())


class Network(nn.Module):
    """Encoder and linear head: increments = head [x_k, features, u_k, 1]."""

    step_scale: Tensor

    def __init__(
        self,
        history: int,
        hidden: int,
        features: int,
        step_scale: FloatArray,
        quadratic: QuadraticFeatures | None = None,
        single: SingleTrack | None = None,
    ) -> None:
        super().__init__()
        self.history = history
        self.encoder = Encoder(history, hidden, features, quadratic, single)
        fitted = self.encoder.known_features
        self.head = nn.Parameter(torch.zeros(3 + features + fitted + 3, 3))
        self.base = nn.Buffer(torch.zeros_like(self.head))
        self.register_buffer("step_scale", torch.tensor(step_scale, dtype=torch.float32))
        with torch.no_grad():
            self.head.normal_(0.0, 0.02)
            if fitted:
                # These features predict the increments; all else starts at zero.
                self.head.zero_()
                self.base[3 + features : 6 + features] = torch.eye(3)
        self.mask = nn.Buffer(torch.ones_like(self.head))
        if single is not None:
            # Beyond the training data only the single-track model counts.
            self.mask[:3] = 0.0
            self.mask[-3:] = 0.0

    def roll_out(self, x_past: Tensor, u_past: Tensor, u_ahead: Tensor) -> Tensor:
        """
        Predict scaled states (b, h, 3).

        `x_past` (b, p + 1, 3) and `u_past` (b, p, 2) newest first, `u_ahead` (b, h, 2), scaled.
        """
        batch, ahead = u_ahead.shape[0], u_ahead.shape[1]
        x_row = x_past.reshape(batch, -1)
        u_row = u_past.reshape(batch, -1)
        ones = torch.ones(batch, 1, device=u_ahead.device)
        weights = self.base + self.mask * self.head
        out = []
        for step in range(ahead):
            now, u = x_row[:, :3], u_ahead[:, step]
            # Without past samples the encoder gets no commands either, as in the paper.
            row = torch.cat([x_row, u, u_row], dim=1) if self.history else x_row
            features = self.encoder(row)
            phi = torch.cat([now, features, u, ones], dim=1)
            new = now + (phi @ weights) * self.step_scale
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

    A and B have no bias; ReLU between the layers (the paper does not name its activation).
    """

    def __init__(self, hidden: int = 128, features: int = 12) -> None:
        super().__init__()
        self.encoder = _layers(3, hidden, features)
        self.decoder = _layers(features, hidden, 3)
        self.a = nn.Linear(3 + features, 3 + features, bias=False)
        self.b = nn.Linear(2, 3 + features, bias=False)


def _layers(n_in: int, hidden: int, n_out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(n_in, hidden),
        nn.ReLU(),
        nn.Linear(hidden, hidden),
        nn.ReLU(),
        nn.Linear(hidden, hidden),
        nn.ReLU(),
        nn.Linear(hidden, n_out),
    )


def to_torchscript(encoder: nn.Module) -> bytes:
    """Compile an encoder to a TorchScript program, on the CPU and in float32."""
    encoder = encoder.to("cpu", torch.float32).eval()
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # torch deprecates TorchScript, on which the model format is built.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.save(torch.jit.script(encoder), buffer)
    return buffer.getvalue()


def as_tensor(array: FloatArray, device: torch.device | str = "cpu") -> Tensor:
    """Return `array` as a float32 tensor on `device`."""
    return torch.tensor(np.ascontiguousarray(array), dtype=torch.float32, device=device)
