# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loading and refusing encoders, their compiled form, and scaling."""

import io
from typing import Any

import numpy as np
import pytest
import torch
from helpers.model import plain_program, program, random_lift
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from torch import Tensor, nn

from adk_ros.errors import UsageError
from adk_ros.model.lifting.encoder import Lifting, input_size
from adk_ros.model.lifting.scaling import Scaling
from adk_ros.train.network import Encoder, Lift, to_torchscript


def rows(n: int, n_in: int) -> Any:
    return np.random.default_rng(0).normal(size=(n, n_in)).astype(np.float32)


def test_input_size() -> None:
    assert [input_size(history) for history in (0, 1, 2, 8)] == [3, 10, 15, 45]


def test_features_equal_the_torch_modules_output() -> None:
    torch.manual_seed(0)
    encoder = random_lift(3, 16, 5)
    lifting = Lifting(to_torchscript(encoder), input_size(3), 5)
    for row in rows(20, input_size(3)):
        with torch.no_grad():
            expected = encoder(torch.from_numpy(row)[None])[0].numpy()
        assert lifting.compiled is not None
        np.testing.assert_allclose(lifting(row), expected, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(lifting.run_program(row), expected, rtol=1e-5, atol=1e-6)
    assert not lifting.warning


def test_results_do_not_share_memory() -> None:
    lifting = Lifting(program(), input_size(2), 4)
    one, other = rows(2, input_size(2))
    first = lifting(one)
    kept = first.copy()
    lifting(other)
    np.testing.assert_array_equal(first, kept)


def test_encoder_of_the_known_form_is_compiled() -> None:
    compiled = Lifting(program(), input_size(2), 4).compiled
    assert compiled is not None
    assert [array.shape for array in compiled] == [
        (15, 8), (8,), (8, 8), (8,), (13, 4), (4,), (15, 4), (15,), (15,), (15, 5),
        (0,), (15, 2), (3, 6),
    ]  # fmt: skip
    assert [str(array.dtype) for array in compiled] == [
        "int64" if name == "columns" else "float32" for name in compiled._fields
    ]
    assert Lifting(plain_program(15), 15, 4).compiled is None


def test_perceptron_without_quadratic_features_is_compiled() -> None:
    class Plain(nn.Module):
        def __init__(self, lift: Lift) -> None:
            super().__init__()
            self.w1, self.b1 = nn.Parameter(lift.w1), nn.Parameter(lift.b1)
            self.w2, self.b2 = nn.Parameter(lift.w2), nn.Parameter(lift.b2)
            self.w3, self.b3 = nn.Parameter(lift.w3[:8]), nn.Parameter(lift.b3)
            self.skip = nn.Parameter(lift.skip)

        def forward(self, row: Tensor) -> Tensor:
            first = torch.tanh(torch.addmm(self.b1, row, self.w1))
            second = torch.tanh(torch.addmm(self.b2, first, self.w2))
            return torch.addmm(torch.addmm(self.b3, second, self.w3), row, self.skip)

    compiled = Lifting(to_torchscript(Plain(random_lift(2, 8, 4))), 15, 4).compiled
    assert compiled is not None
    assert compiled.directions.shape == (0, 0)


class Sigmoids(Lift):
    """The same parameter names and shapes in another formula."""

    def forward(self, row: Tensor) -> Tensor:
        first = torch.sigmoid(torch.addmm(self.b1, row, self.w1))
        second = torch.sigmoid(torch.addmm(self.b2, first, self.w2))
        return torch.addmm(torch.addmm(self.b3, second, self.w3), row, self.skip)


def test_same_parameters_in_another_formula_are_not_compiled() -> None:
    encoder = Encoder(2, 8, 4)
    other = Sigmoids(encoder, torch.zeros(4), torch.ones(4))
    lifting = Lifting(to_torchscript(other), 15, 4)
    assert lifting.compiled is None
    assert "differs from the TorchScript program by" in lifting.warning
    for row in rows(5, 15):
        with torch.no_grad():
            expected = other(torch.from_numpy(row)[None])[0].numpy()
        np.testing.assert_allclose(lifting(row), expected, rtol=1e-5, atol=1e-6)
    same = Lift(encoder, torch.zeros(4), torch.ones(4))
    assert Lifting(to_torchscript(same), 15, 4).compiled is not None


def test_same_parameter_names_with_other_shapes_are_not_compiled() -> None:
    class Odd(nn.Module):
        w1: Tensor

        def __init__(self) -> None:
            super().__init__()
            for name in ("b1", "w2", "b2", "w3", "b3", "skip"):
                self.register_parameter(name, nn.Parameter(torch.ones(())))
            self.register_parameter("w1", nn.Parameter(torch.ones(15, 4)))

        def forward(self, row: Tensor) -> Tensor:
            return torch.mm(row, self.w1)

    assert Lifting(to_torchscript(Odd()), 15, 4).compiled is None


class Two(nn.Module):
    def forward(self, one: Tensor, other: Tensor) -> Tensor:
        return one + other


class Pair(nn.Module):
    def forward(self, row: Tensor) -> tuple[Tensor, Tensor]:
        return row, row


class Raising(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        if row.size(0) > 0:
            raise ValueError("no")
        return row


class NoForward(nn.Module):
    @torch.jit.export
    def other(self, row: Tensor) -> Tensor:
        return row


class NotANumber(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.weights = nn.Buffer(torch.full((15, 4), float("nan")))

    def forward(self, row: Tensor) -> Tensor:
        return torch.mm(row, self.weights)


def pickled() -> bytes:
    buffer = io.BytesIO()
    torch.save({"weights": torch.zeros(3)}, buffer)
    return buffer.getvalue()


READABLE = "the encoder is not a readable TorchScript program: "


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", READABLE),
        (b"something else", READABLE),
        (b"PK\x03\x04" + bytes(100), READABLE),
        (b"\x80\x04.", READABLE),
        (program()[: len(program()) // 2], READABLE),
        (program()[:-1], READABLE),
        (pickled(), READABLE),
        (to_torchscript(NoForward()), "the encoder has a method 'other'"),
        (program(history=3), "the encoder does not accept 15 inputs: "),
        (plain_program(12), "the encoder does not accept 15 inputs: "),
        (to_torchscript(Two()), "the encoder does not accept 15 inputs: "),
        (to_torchscript(Pair()), "the encoder does not accept 15 inputs: "),
        (to_torchscript(Raising()), "the encoder calls 'ops.prim.RaiseException'"),
        (program(features=5), r"the encoder returns shape \(1, 5\); the manifest says \(1, 4\)"),
        (to_torchscript(nn.Identity()), r"the encoder returns shape \(1, 15\)"),
        (to_torchscript(nn.Flatten(0)), "the encoder calls 'torch.flatten'"),
        (to_torchscript(NotANumber()), "the encoder returns values that are not finite"),
    ],
)
def test_invalid_programs_are_refused(content: bytes, words: str) -> None:
    with pytest.raises(UsageError, match=f"^{words}") as refused:
        Lifting(content, 15, 4)
    assert "\n" not in str(refused.value)


def test_torch_uses_one_thread() -> None:
    torch.set_num_threads(2)
    Lifting(program(), 15, 4)
    assert torch.get_num_threads() == 1


def random_record(n: int) -> tuple[Any, Any]:
    random = np.random.default_rng(0)
    x = random.normal(size=(n, 3)) * [5.0, 0.3, 0.2] + [15.0, 0.0, 0.1]
    return x, random.normal(size=(n, 2)) * [400.0, 0.05] + [100.0, 0.0]


def test_standard_scaling() -> None:
    x, u = random_record(500)
    scaling = Scaling.standard(x, u, np.diff(x, axis=0))
    np.testing.assert_allclose(scaling.scale_x(x).mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(scaling.scale_x(x).std(axis=0), 1.0)
    np.testing.assert_allclose(scaling.scale_u(u).std(axis=0), 1.0)
    increments = np.diff(scaling.scale_x(x), axis=0) / scaling.step_scale
    np.testing.assert_allclose(increments.std(axis=0), 1.0)


def test_min_max_scaling_reaches_minus_one_and_one() -> None:
    x, u = random_record(500)
    scaling = Scaling.min_max(x, u)
    for scaled in (scaling.scale_x(x), scaling.scale_u(u)):
        np.testing.assert_allclose(scaled.min(axis=0), -1.0)
        np.testing.assert_allclose(scaled.max(axis=0), 1.0)
    assert scaling.step_scale.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("kind", ["standard", "min_max"])
def test_constant_channels_are_not_divided_by_zero(kind: str) -> None:
    """For example v_y that odometry does not measure, or an unused pedal."""
    x, u = np.tile([15.0, 0.0, 0.0], (50, 1)), np.zeros((50, 2))
    if kind == "standard":
        scaling = Scaling.standard(x, u, np.zeros((49, 3)))
    else:
        scaling = Scaling.min_max(x, u)
    assert np.isfinite(scaling.scale_x(x)).all()
    np.testing.assert_allclose(scaling.unscale_x(scaling.scale_x(x)), x)
    assert (scaling.step_scale > 0.0).all()


@given(arrays(np.float64, (4, 3), elements=st.floats(-150, 150)))
def test_unscaling_inverts_scaling(x: Any) -> None:
    scaling = Scaling.standard(*random_record(100), np.ones((3, 3)))
    np.testing.assert_allclose(scaling.unscale_x(scaling.scale_x(x)), x, atol=1e-9)
