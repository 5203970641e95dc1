# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Lifting: a TorchScript encoder maps a few past samples to the features of the lifted state.

The encoder's input is one row

    [x_k, x_(k-1), ..., x_(k-p), u_k, u_(k-1), ..., u_(k-p)]     scaled, 5 (p + 1) columns

or x_k alone without past samples, as in the paper. Its output are the features in
z = [x_k, features].

A rollout evaluates the encoder 80 times per tick, too often for TorchScript's interpreter, which
after a pause takes ten times as long as in a loop. For an encoder that is a perceptron of the
known form, the weights are therefore also extracted for the compiled kernels. If these agree with
the TorchScript program on random inputs, they are used for every lift, live and in a replay.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import nn

from adk_ros.errors import UsageError
from adk_ros.model.lifting.encoder_kernels import EncoderArrays, perceptron
from adk_ros.model.lifting.program_cost import check_cost
from adk_ros.model.lifting.program_grammar import check_program
from adk_ros.model.lifting.single_track import (
    CAR_SIZE,
    RANGE_QUANTITIES,
    SINGLE_TRACK_FEATURES,
)
from adk_ros.numerics.arrays import Float32Array

_WARM_UP_CALLS = 30
"""Calls after which TorchScript's profiling executor has optimised the program."""
_COMPILED_TOLERANCE = 1e-4
"""
Largest difference, relative or absolute, between compiled and TorchScript features; 7e-6 is
expected.
"""
_STORED_NAMES = {
    "reach": "input_bound",
    "single_track.car": "car",
    "single_track.command_filter": "command_filter",
    "single_track.limits": "limits",
}
"""Buffer name in the TorchScript programs of model folders -> field of `EncoderArrays`."""
_SINGLE_TRACK_NAMES = ("car", "command_filter", "limits")
_PERCEPTRON_NAMES = ("w1", "b1", "w2", "b2", "w3", "b3", "skip")
"""Parameters of an encoder without quadratic features."""


def input_size(history: int) -> int:
    """Return the number of columns of the encoder's input for `history` past samples."""
    return 5 * (history + 1) if history else 3


class _WriteTo(nn.Module):
    """Write the encoder's output to an existing tensor: a new tensor per tick costs 3 us."""

    def __init__(self, encoder: nn.Module) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, row: torch.Tensor, out: torch.Tensor) -> int:
        """Write the features of `row` (1, n) to `out` (1, m)."""
        out.copy_(self.encoder(row))
        return 0


@contextmanager
def _torchscript_warnings_ignored() -> Iterator[None]:
    """Hide torch's deprecation warning of TorchScript, on which the model format is built."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


class Lifting:
    """
    A loaded encoder with `n_in` inputs and `n_features` outputs, called with one row at a time.

    `compiled`: weights for the compiled kernels, which are then used; None if the encoder has
    another form, or if the kernels do not reproduce the program, of which `warning` tells.
    """

    compiled: EncoderArrays | None

    def __init__(self, program: bytes, n_in: int, n_features: int) -> None:
        """
        Load the TorchScript `program`.

        :raises UsageError: it does not load, does what no encoder needs, or does not map (1, n_in)
            to finite (1, n_features).
        """
        torch.set_num_threads(1)
        checked = check_program(program)
        try:
            with _torchscript_warnings_ignored():
                module = torch.jit.load(io.BytesIO(checked.archive), map_location="cpu").eval()
            forward: Any = module.forward
        except Exception as error:
            # A damaged or foreign program can raise any exception, here and below.
            first = _lines(error)[0]
            raise UsageError(
                f"the encoder is not a readable TorchScript program: {first}"
            ) from None
        check_cost(module, checked.functions, n_in)
        parameters = {k: v.detach().clone() for k, v in module.state_dict().items()}
        self._buffer = np.zeros((1, n_in), dtype=np.float32)
        self._row = torch.from_numpy(self._buffer)
        try:
            with torch.no_grad():
                self._features = np.array(forward(self._row).numpy(), dtype=np.float32)
            with _torchscript_warnings_ignored():
                # The compiled method: the module's own call takes as long again.
                # Freezing makes the weights constants, so no gradient needs to be switched off.
                frozen = torch.jit.freeze(torch.jit.script(_WriteTo(module)).eval())
            self._forward: Any = frozen.forward
        except Exception as error:
            last = _lines(error)[-1]
            raise UsageError(f"the encoder does not accept {n_in} inputs: {last}") from None
        if self._features.shape != (1, n_features):
            raise UsageError(
                f"the encoder returns shape {self._features.shape}; the manifest says "
                f"(1, {n_features})"
            )
        if not np.isfinite(self._features).all():
            raise UsageError("the encoder returns values that are not finite")
        self._out = torch.from_numpy(self._features)
        for _ in range(_WARM_UP_CALLS):
            self._forward(self._row, self._out)
        self.warning = ""
        self.compiled = self._compile(parameters, n_in, n_features)
        if self.compiled is not None:
            self._scratch = self.compiled.scratch()

    def __call__(self, row: Float32Array) -> Float32Array:
        """Return the features (n_features,) of one input row (n_in,)."""
        if self.compiled is None:
            return self.run_program(row)
        out = np.empty(self._features.shape[1], dtype=np.float32)
        perceptron(row, self.compiled, self._scratch, out)
        return out

    def run_program(self, row: Float32Array) -> Float32Array:
        """Return the features of one input row by the TorchScript program."""
        self._buffer[0] = row
        self._forward(self._row, self._out)
        features: Float32Array = self._features[0].copy()
        return features

    def _compile(
        self, parameters: dict[str, torch.Tensor], n_in: int, n_features: int
    ) -> EncoderArrays | None:
        """Return the weights for the kernels, or None if they do not reproduce the program."""
        parameters = {_STORED_NAMES.get(name, name): x for name, x in parameters.items()}
        if set(parameters) == set(_PERCEPTRON_NAMES):
            unbounded = torch.full((n_in,), float("inf"))
            parameters |= {"input_bound": unbounded, "directions": torch.zeros(n_in, 0)}
        if not set(parameters) & set(_SINGLE_TRACK_NAMES):
            parameters |= {
                "car": torch.zeros(0),
                "command_filter": torch.zeros(n_in, 2),
                "limits": torch.zeros(3, RANGE_QUANTITIES),
            }
        if set(parameters) != set(EncoderArrays._fields) - {"columns"}:
            return None
        directions = parameters["directions"]
        if directions.dim() != 2 or directions.shape[0] != n_in:
            return None
        # About half of the columns do not enter the quadratic features: leave them out.
        columns = directions.ne(0.0).any(dim=1).nonzero()[:, 0]
        parameters |= {"directions": directions[columns]}
        arrays: dict[str, Any] = {
            name: np.ascontiguousarray(values.numpy().astype(np.float32))
            for name, values in parameters.items()
        }
        arrays["columns"] = columns.numpy().astype(np.int64)
        encoder = EncoderArrays(**arrays)
        hidden, squares = encoder.w1.shape[-1], encoder.directions.shape[-1]
        known = SINGLE_TRACK_FEATURES + 1 + n_in if encoder.car.size else 0
        if [array.shape for array in encoder] != [
            (n_in, hidden),
            (hidden,),
            (hidden, hidden),
            (hidden,),
            (hidden + squares + known, n_features),
            (n_features,),
            (n_in, n_features),
            encoder.columns.shape,
            (n_in,),
            (*encoder.columns.shape, squares),
            (CAR_SIZE if known else 0,),
            (n_in, 2),
            (3, RANGE_QUANTITIES),
        ]:
            return None
        probes = np.random.default_rng(0).normal(0.0, 1.5, (16, n_in)).astype(np.float32)
        scratch = encoder.scratch()
        out = np.empty(n_features, dtype=np.float32)
        for probe in probes:
            perceptron(probe, encoder, scratch, out)
            expected = self.run_program(probe)
            if not np.allclose(out, expected, rtol=_COMPILED_TOLERANCE, atol=_COMPILED_TOLERANCE):
                self.warning = (
                    "the compiled encoder differs from the TorchScript program by "
                    f"{np.abs(out - expected).max():.1g} (allowed {_COMPILED_TOLERANCE:g}): "
                    "TorchScript is used, and a tick takes several times as long"
                )
                return None
        return encoder


def _lines(error: Exception) -> list[str]:
    return str(error).strip().splitlines() or [type(error).__name__]
