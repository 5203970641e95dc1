# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The lift: TorchScript encoder on a few past samples -> lifted state, once a tick.

The only torch that runs on the vehicle. The encoder's input is one row
    [x_k, x_(k-1), ..., x_(k-p), u_(k-1), ..., u_(k-p)]   (scaled; 3 (p + 1) + 2 p columns),
its output the `features` that stand behind the state in z = [x_k, features].

Rolling the model out over a horizon lifts eighty times a tick, which TorchScript's interpreter
cannot afford. An encoder that is a plain perceptron therefore also yields its weights, so that a
compiled twin may do the roll-out; the twin is compared with the encoder before it is trusted.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from adk_ros.errors import UsageError
from adk_ros.model.kernels import perceptron

Float32Array = NDArray[np.float32]
_WARM_UP_CALLS = 30
_TWIN_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Twin:
    """
    Weights of the encoder as a perceptron with two hidden softsign layers and a linear shortcut.

    `w1` (n, h), `w2` (h, h), `w3` (h, m), `skip` (n, m); biases (h,), (h,), (m,); float32.
    """

    w1: Float32Array
    b1: Float32Array
    w2: Float32Array
    b2: Float32Array
    w3: Float32Array
    b3: Float32Array
    skip: Float32Array

    def arrays(self) -> tuple[Float32Array, ...]:
        """The arrays in the order that the kernels take them."""
        return self.w1, self.b1, self.w2, self.b2, self.w3, self.b3, self.skip


def input_size(history: int) -> int:
    """Columns of the encoder's input for `history` past samples."""
    return 3 * (history + 1) + 2 * history


class Lifting:
    """A loaded encoder: `n_in` inputs, `n_features` outputs, called with one row at a time."""

    def __init__(self, program: bytes, n_in: int, n_features: int) -> None:
        """
        Load the TorchScript `program`.

        :raises UsageError: it does not load, or does not map (1, n_in) to (1, n_features).
        """
        torch.set_num_threads(1)
        try:
            with warnings.catch_warnings():
                # torch announces TorchScript's retirement; this package is built on it.
                warnings.simplefilter("ignore", DeprecationWarning)
                module = torch.jit.load(io.BytesIO(program), map_location="cpu").eval()
                parameters = {k: v.detach().clone() for k, v in module.state_dict().items()}
                # Straight to the compiled method: the module's own call costs as much again.
                # Freezing makes the weights constants, so there is no gradient to switch off.
                self._forward: Any = torch.jit.freeze(module).forward
        except Exception as error:
            # What a stranger's program raises, here and below, is not to be foreseen.
            first = _lines(error)[0]
            raise UsageError(f"the encoder is no readable TorchScript program: {first}") from None
        self._buffer = np.zeros((1, n_in), dtype=np.float32)
        self._tensor = torch.from_numpy(self._buffer)
        try:
            for _ in range(_WARM_UP_CALLS):
                output = self._forward(self._tensor)
            features = np.asarray(output.numpy(), dtype=np.float32)
        except Exception as error:
            last = _lines(error)[-1]
            raise UsageError(f"the encoder does not take {n_in} inputs: {last}") from None
        if features.shape != (1, n_features):
            raise UsageError(
                f"the encoder gives {features.shape}, its manifest promises (1, {n_features})"
            )
        if not np.isfinite(features).all():
            raise UsageError("the encoder gives values that are not finite")
        self.twin = self._find_twin(parameters, n_in, n_features)

    def __call__(self, row: Float32Array) -> Float32Array:
        """Return the features (n_features,) of one input row (n_in,)."""
        self._buffer[0] = row
        features: Float32Array = self._forward(self._tensor).numpy()[0]
        return features

    def _find_twin(
        self, parameters: dict[str, torch.Tensor], n_in: int, n_features: int
    ) -> Twin | None:
        names = ("w1", "b1", "w2", "b2", "w3", "b3", "skip")
        if set(parameters) != set(names):
            return None
        arrays = [np.ascontiguousarray(parameters[n].numpy().astype(np.float32)) for n in names]
        twin = Twin(*arrays)
        hidden = twin.w1.shape[-1]
        shapes = [(n_in, hidden), (hidden,), (hidden, hidden), (hidden,), (hidden, n_features),
                  (n_features,), (n_in, n_features)]
        if [a.shape for a in arrays] != shapes:
            return None
        probes = np.random.default_rng(0).normal(0.0, 1.5, (16, n_in)).astype(np.float32)
        scratch = np.empty((2, hidden), dtype=np.float32)
        out = np.empty(n_features, dtype=np.float32)
        for probe in probes:
            perceptron(probe, *arrays, scratch, out)
            truth = self(probe)
            if not np.allclose(out, truth, rtol=_TWIN_TOLERANCE, atol=_TWIN_TOLERANCE):
                return None
        return twin


def _lines(error: Exception) -> list[str]:
    return str(error).strip().splitlines() or [type(error).__name__]
