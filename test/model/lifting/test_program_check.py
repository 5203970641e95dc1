# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A TorchScript program from somebody else computes features and does nothing else."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from helpers.model import plain_program, program
from torch import Tensor, nn

from adk_ros.errors import UsageError
from adk_ros.model.lifting.encoder import Lifting
from adk_ros.model.lifting.program_grammar import check_program
from adk_ros.train.network import to_torchscript

TARGET = "/tmp/adk_ros_must_not_exist"


class Saving(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        torch.save(row, "/tmp/adk_ros_must_not_exist")
        return row


class Mapping(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        return row + torch.from_file("/tmp/adk_ros_must_not_exist", True, 10)[0]


class Looping(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        count = 0
        while count < 1:
            count = count * 1
        return row


class Repeating(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        for _ in range(1000000000):
            row = row + 1.0
        return row


class Printing(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        print(row)
        return row


class Restoring(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        return row

    @torch.jit.export
    def __getstate__(self) -> int:
        return 1

    @torch.jit.export
    def __setstate__(self, state: int) -> None:
        torch.save(torch.zeros(1), "/tmp/adk_ros_must_not_exist")


class Allocating(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        return torch.zeros(1000000000000)


class OuterProduct(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.column, self.line = nn.Buffer(torch.zeros(50_000, 1)), nn.Buffer(torch.zeros(50_000))

    def forward(self, row: Tensor) -> Tensor:
        return torch.add(self.column, self.line)


class Expanded(nn.Module):
    """A large tensor of which a file holds one element."""

    def __init__(self) -> None:
        super().__init__()
        self.large = nn.Buffer(torch.zeros(1).expand(10**9))

    def forward(self, row: Tensor) -> Tensor:
        return row


class Doubling(nn.Module):
    def forward(self, row: Tensor) -> Tensor:
        a = torch.cat([row, row, row, row, row, row, row, row], 1)
        b = torch.cat([a, a, a, a, a, a, a, a], 1)
        c = torch.cat([b, b, b, b, b, b, b, b], 1)
        d = torch.cat([c, c, c, c, c, c, c, c], 1)
        e = torch.cat([d, d, d, d, d, d, d, d], 1)
        return torch.cat([e, e, e, e, e, e, e, e], 1)


class Calling(nn.Module):
    """Methods that call each other so often that nobody waits for the end."""

    def __init__(self, depth: int) -> None:
        super().__init__()
        self.inner: nn.Module = Calling(depth - 1) if depth else nn.Identity()

    def forward(self, row: Tensor) -> Tensor:
        out: Tensor = self.inner(self.inner(row))
        return out


@pytest.mark.parametrize(
    ("module", "words"),
    [
        (Saving, "the encoder calls 'torch.save', which no encoder needs: load only models"),
        (Mapping, "the encoder calls 'torch.from_file', which no encoder needs"),
        (Looping, "the encoder has a While statement"),
        (Repeating, "the encoder has a For statement"),
        (Printing, "the encoder calls 'print'"),
        (Restoring, "the encoder has a method '__getstate__'"),
        (Allocating, "the encoder calls 'torch.zeros'"),
        (OuterProduct, "the encoder computes more than one for 40 predictions a second can"),
        (Expanded, "the encoder computes more than"),
        (Doubling, "the encoder computes more than"),
        (lambda: Calling(20), "the encoder computes more than"),
    ],
)
def test_what_no_encoder_needs_is_refused(module: Callable[[], nn.Module], words: str) -> None:
    content = to_torchscript(module())
    with pytest.raises(UsageError, match=f"^{words}") as refused:
        Lifting(content, 15, 4)
    assert "\n" not in str(refused.value)
    assert not Path(TARGET).exists()


class Usual(nn.Module):
    """Layers of other encoders than ours."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(15, 20), nn.ReLU(), nn.Linear(20, 20), nn.Sigmoid(), nn.Linear(20, 4)
        )
        self.scale = 0.5
        self.deep = True

    def forward(self, row: Tensor) -> Tensor:
        out = row
        if self.deep:
            out = self.layers(row) * self.scale
        return torch.clamp(out, min=-1.0)


@pytest.mark.parametrize(
    "content",
    [program(), plain_program(15), to_torchscript(Usual())],
    ids=["own", "linear", "deep"],
)
def test_encoders_are_accepted(content: bytes) -> None:
    features = Lifting(content, 15, 4)(torch.randn(15).numpy())
    assert features.shape == (4,)


def repacked(content: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """Copy a program with changed entries."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(buffer, "w") as new:
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))
    return buffer.getvalue()


def added(name: str, entry: bytes) -> bytes:
    buffer = io.BytesIO(program())
    with zipfile.ZipFile(buffer, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, entry)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (added("archive/extra/run.sh", b"x"), "entry 'archive/extra/run.sh' is unknown"),
        (added("archive/data/99", bytes(80 << 20)), "the encoder unpacks to more than 64 MiB"),
        (bytes(17 << 20), "the encoder has 17 MiB: at most 16 MiB"),
        (added("archive/code/a.py", b"import os"), r"has code outside of classes \(Import\)"),
        (added("archive/code/a.py", b"class A(Module:"), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"(" * 5000), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"\xff\xfe"), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"#" * (300 << 10)), "is too long"),
        (
            repacked(program(), lambda n, x: x + b"c__torch__.torch.classes.a\nB\n"
                     if n.endswith("/data.pkl") else x),
            "contains objects of compiled classes",
        ),
    ],
)  # fmt: skip
def test_archives_are_bounded(content: bytes, words: str) -> None:
    with pytest.raises(UsageError, match=words) as refused:
        check_program(content)
    assert "\n" not in str(refused.value)


def test_repeated_entries_are_refused() -> None:
    with pytest.warns(UserWarning, match="Duplicate name"):
        content = added("archive/data.pkl", b"x")
    with pytest.raises(UsageError, match="too many or repeated entries"):
        check_program(content)


def test_nothing_was_written() -> None:
    assert not os.path.lexists(TARGET)
