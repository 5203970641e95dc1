# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A TorchScript program from somebody else computes features and does nothing else."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
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


class Selecting(nn.Module):
    """A program that writes out a slice of a row."""

    def __init__(self, dim: int, start: int, end: int, step: int) -> None:
        super().__init__()
        self.dim, self.start, self.end, self.step = dim, start, end, step

    def forward(self, row: Tensor) -> Tensor:
        out: Tensor = torch.ops.aten.slice(row, self.dim, self.start, self.end, self.step)
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


@pytest.mark.parametrize(
    "place", [(1, 0, 4, 0), (1, 0, 4, -1), (7, 0, 4, 1), (1, 3, 2, 1), (0, 0, 1, 1)]
)
def test_slices_have_the_right_shape(place: tuple[int, int, int, int]) -> None:
    with pytest.raises(UsageError):
        Lifting(to_torchscript(Selecting(*place)), 15, 4)


def test_slices_are_accepted() -> None:
    lifting = Lifting(to_torchscript(Selecting(1, 2, 10, 2)), 15, 4)
    assert lifting(np.arange(15, dtype=np.float32)).tolist() == [2.0, 4.0, 6.0, 8.0]


def repacked(content: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """Copy a program with changed entries."""
    with zipfile.ZipFile(io.BytesIO(content)) as old:
        return zipped({name: change(name, old.read(name)) for name in old.namelist()})


def zipped(entries: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as new:
        for name, entry in entries.items():
            new.writestr(name, entry)
    return buffer.getvalue()


def added(name: str, entry: bytes) -> bytes:
    buffer = io.BytesIO(program())
    with zipfile.ZipFile(buffer, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, entry)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (added("archive/extra/run.sh", b"x"), "entry 'extra/run.sh' is unknown"),
        (zipped({"archive/code/a.py": b""}), "entry 'data.pkl' is missing"),
        (added("archive/data/99", bytes(80 << 20)), "the encoder unpacks to more than 64 MiB"),
        (bytes(17 << 20), "the encoder has 17 MiB: at most 16 MiB"),
        (added("archive/code/a.py", b"import os"), r"has code outside of classes \(Import\)"),
        (added("archive/code/a.py", b"class A(Module:"), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"(" * 5000), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"\xff\xfe"), "not a readable TorchScript program"),
        (added("archive/code/a.py", b"#" * (300 << 10)), "is too long"),
        (
            repacked(program(), lambda n, x: x[:-1] + b"c__torch__.torch.classes.a\nB\n)\x81."
                     if n.endswith("/data.pkl") else x),
            "contains '__torch__.torch.classes.a.B'",
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


@pytest.mark.parametrize(
    ("found", "instead", "words"),
    [
        (b"K\x00(", b"K\x01(", "a tensor is larger than its storage"),
        (b"K\x00(", b"J\xff\xff\xff\xff(", "offset, size or stride is no number"),
        (b"K\x00(", b"J\xff\xff\xff\x7f(", "a tensor is larger than its storage"),
        (b"X\x03\x00\x00\x00cpu", b"X\x03\x00\x00\x00gpu", "a storage is not described as one"),
        (b"FloatStorage", b"DoubleStorage", "storage 0 does not have the size"),
        (b"FloatStorage", b"QInt8Storage", "contains 'torch.QInt8Storage'"),
        (b"\x89ccoll", b"Nccoll", "a tensor has hooks"),
        (b"\x89ccoll", b"]ccoll", "the operation EMPTY_LIST"),
        (b"q\x00", b"r\x00\x00\x00\x7f", "an object that is not there"),
        (b"_rebuild_tensor_v2", b"_rebuild_parameter", "torch._utils._rebuild_parameter"),
        (b".", b".c", "something follows"),
        (b".", b"K\x01.", "too many values"),
        (b"Nub", b"Nub}b", "attributes are given twice"),
    ],
)
def test_attributes_lie_within_the_archive(found: bytes, instead: bytes, words: str) -> None:
    """PyTorch's reader would read, or crash, beyond the storage of a tensor."""

    def change(name: str, content: bytes) -> bytes:
        if not name.endswith("/data.pkl"):
            return content
        place = content.rindex(found) if found == b"." else content.index(found)
        return content[:place] + instead + content[place + len(found) :]

    with pytest.raises(UsageError, match=words):
        check_program(repacked(program(), change))


def test_attributes_are_those_of_a_module() -> None:
    changed = repacked(program(), lambda n, x: b"\x80\x02}." if n.endswith("/data.pkl") else x)
    with pytest.raises(UsageError, match="they are not those of a module"):
        check_program(changed)


def test_shortened_storage_is_refused() -> None:
    shortened = repacked(program(), lambda n, x: x[:-4] if n.endswith("/data/0") else x)
    with pytest.raises(UsageError, match="storage 0 does not have the size"):
        check_program(shortened)


def test_pytorch_reads_only_what_was_checked() -> None:
    """Debug information, which PyTorch would read on an error, is not among it."""
    checked = check_program(repacked(program(), lambda n, x: b"x" if "debug" in n else x))
    with zipfile.ZipFile(io.BytesIO(checked.archive)) as archive:
        assert not any("debug" in name for name in archive.namelist())


def test_nothing_was_written() -> None:
    assert not os.path.lexists(TARGET)
