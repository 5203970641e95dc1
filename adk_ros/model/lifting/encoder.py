# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The lift: TorchScript encoder on a few past samples -> lifted state, once a tick.

The only torch that runs on the vehicle. The encoder's input is one row
    [x_k, x_(k-1), ..., x_(k-p), u_k, u_(k-1), ..., u_(k-p)]   (scaled; 5 (p + 1) columns),
or x_k alone where there is no past, as in the paper; its output the `features` that stand behind
the state in z = [x_k, features].

Rolling the model out over a horizon lifts eighty times a tick, which TorchScript's interpreter
cannot afford. An encoder that is a plain perceptron therefore also yields its weights, so that a
compiled twin may do the roll-out; the twin is compared with the encoder before it is trusted.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from adk_ros.errors import UsageError
from adk_ros.model.lifting.encoder_kernels import perceptron

Float32Array = NDArray[np.float32]
EncoderArrays = tuple[
    Float32Array,
    Float32Array,
    Float32Array,
    Float32Array,
    Float32Array,
    Float32Array,
    Float32Array,
    NDArray[np.int64],
    Float32Array,
    Float32Array,
]
_WARM_UP_CALLS = 30
_COMPILED_TOLERANCE = 1e-4
_STORED_NAMES = {"reach": "input_bound"}
"""Buffers of the TorchScript program, whose names model folders keep -> field of `CompiledEncoder`."""


@dataclass(frozen=True)
class CompiledEncoder:
    """
    Weights of the encoder: two hidden tanh layers, squares beside them, a linear shortcut.

    Into layers and squares the row enters held within +-`input_bound` (n,), into the shortcut as it is.

    `w1` (n, h), `w2` (h, h), `w3` (h + q, m), `skip` (n, m); biases (h,), (h,), (m,). The squares
    are of `directions` (c, q) of the row's `columns` (c,). All float32, but for the columns.
    """

    w1: Float32Array
    b1: Float32Array
    w2: Float32Array
    b2: Float32Array
    w3: Float32Array
    b3: Float32Array
    skip: Float32Array
    columns: NDArray[np.int64]
    input_bound: Float32Array
    directions: Float32Array

    def arrays(self) -> EncoderArrays:
        """The arrays in the order that the kernels take them."""
        return (
            self.w1,
            self.b1,
            self.w2,
            self.b2,
            self.w3,
            self.b3,
            self.skip,
            self.columns,
            self.input_bound,
            self.directions,
        )


def input_size(history: int) -> int:
    """Columns of the encoder's input for `history` past samples."""
    return 5 * (history + 1) if history else 3


class _Capture(nn.Module):
    """Writes an encoder's output where it is wanted: a new tensor a tick costs 3 us of it."""

    def __init__(self, encoder: nn.Module) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, row: torch.Tensor, out: torch.Tensor) -> int:
        """Write the features of `row` (1, n) into `out` (1, m)."""
        out.copy_(self.encoder(row))
        return 0


@contextmanager
def _quiet() -> Iterator[None]:
    """Without torch's announcement of TorchScript's retirement; this package is built on it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


class Lifting:
    """A loaded encoder: `n_in` inputs, `n_features` outputs, called with one row at a time."""

    def __init__(self, program: bytes, n_in: int, n_features: int) -> None:
        """
        Load the TorchScript `program`.

        :raises UsageError: it does not load, or does not map (1, n_in) to (1, n_features).
        """
        torch.set_num_threads(1)
        try:
            with _quiet():
                module = torch.jit.load(io.BytesIO(program), map_location="cpu").eval()
            forward: Any = module.forward
            parameters = {k: v.detach().clone() for k, v in module.state_dict().items()}
        except Exception as error:
            # What a stranger's program raises, here and below, is not to be foreseen.
            first = _lines(error)[0]
            raise UsageError(f"the encoder is no readable TorchScript program: {first}") from None
        self._buffer = np.zeros((1, n_in), dtype=np.float32)
        self._row = torch.from_numpy(self._buffer)
        try:
            with torch.no_grad():
                self._features = np.array(forward(self._row).numpy(), dtype=np.float32)
            with _quiet():
                # Straight to the compiled method: the module's own call costs as much again.
                # Freezing makes the weights constants, so there is no gradient to switch off.
                into = torch.jit.freeze(torch.jit.script(_Capture(module)).eval())
            self._forward: Any = into.forward
        except Exception as error:
            last = _lines(error)[-1]
            raise UsageError(f"the encoder does not take {n_in} inputs: {last}") from None
        if self._features.shape != (1, n_features):
            raise UsageError(
                f"the encoder gives {self._features.shape}, its manifest promises "
                f"(1, {n_features})"
            )
        if not np.isfinite(self._features).all():
            raise UsageError("the encoder gives values that are not finite")
        self._out = torch.from_numpy(self._features)
        for _ in range(_WARM_UP_CALLS):
            self._forward(self._row, self._out)
        self.twin = self._find_compiled(parameters, n_in, n_features)

    def __call__(self, row: Float32Array) -> Float32Array:
        """Return the features (n_features,) of one input row (n_in,)."""
        self._buffer[0] = row
        self._forward(self._row, self._out)
        features: Float32Array = self._features[0].copy()
        return features

    def _find_compiled(
        self, parameters: dict[str, torch.Tensor], n_in: int, n_features: int
    ) -> CompiledEncoder | None:
        names = [field.name for field in fields(CompiledEncoder)]
        parameters = {_STORED_NAMES.get(name, name): x for name, x in parameters.items()}
        if set(parameters) == set(names[:7]):
            unbounded = torch.full((n_in,), float("inf"))
            parameters |= {"input_bound": unbounded, "directions": torch.zeros(n_in, 0)}
        if set(parameters) != set(names) - {"columns"}:
            return None
        directions = parameters["directions"]
        if directions.dim() != 2 or directions.shape[0] != n_in:
            return None
        # Half of the row has no part in the squares: the twin leaves that out.
        columns = directions.ne(0.0).any(dim=1).nonzero()[:, 0]
        parameters |= {"directions": directions[columns]}
        arrays: dict[str, Any] = {
            name: np.ascontiguousarray(parameters[name].numpy().astype(np.float32))
            for name in names if name != "columns"
        }  # fmt: skip
        arrays["columns"] = columns.numpy().astype(np.int64)
        twin = CompiledEncoder(**arrays)
        hidden, squares = twin.w1.shape[-1], twin.directions.shape[-1]
        chosen = twin.columns.shape
        shapes = [
            (n_in, hidden),
            (hidden,),
            (hidden, hidden),
            (hidden,),
            (hidden + squares, n_features),
            (n_features,),
            (n_in, n_features),
            chosen,
            (n_in,),
            (*chosen, squares),
        ]
        if [a.shape for a in twin.arrays()] != shapes:
            return None
        probes = np.random.default_rng(0).normal(0.0, 1.5, (16, n_in)).astype(np.float32)
        scratch = np.empty((2, hidden + squares + n_in), dtype=np.float32)
        out = np.empty(n_features, dtype=np.float32)
        for probe in probes:
            perceptron(probe, *twin.arrays(), scratch, out)
            truth = self(probe)
            if not np.allclose(out, truth, rtol=_COMPILED_TOLERANCE, atol=_COMPILED_TOLERANCE):
                return None
        return twin


def _lines(error: Exception) -> list[str]:
    return str(error).strip().splitlines() or [type(error).__name__]
