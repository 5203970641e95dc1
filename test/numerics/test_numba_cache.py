# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The kernel cache: a fresh process sees every change, and only changes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LOWER = """
from adk_ros.numerics.numba_cache import strict_kernel

FACTOR = 2.0


@strict_kernel
def callee(x):
    return FACTOR * x + 1.0
"""
UPPER = """
from kernels import lower
from kernels.lower import callee
from adk_ros.numerics.numba_cache import strict_kernel


@strict_kernel
def caller(x):
    return callee(x)


@strict_kernel
def reads_constant(x):
    return x + lower.FACTOR
"""
RUN = """
from kernels.upper import caller, reads_constant

for kernel in (caller, reads_constant):
    print(kernel(3.0), sum(kernel.stats.cache_hits.values()))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "lower.py").write_text(LOWER)
    (folder / "upper.py").write_text(UPPER)
    return tmp_path


def run(package: Path) -> list[tuple[float, int]]:
    """Return (value, cache hits) of both kernels in a fresh process."""
    path = os.pathsep.join([str(package), *sys.path])
    environment = os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True
    )
    lines = [line.split() for line in done.stdout.splitlines()]
    return [(float(value), int(hits)) for value, hits in lines]


def edit_lower(package: Path, old: str, new: str) -> None:
    path = package / "kernels" / "lower.py"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_unchanged_sources_are_a_cache_hit(package: Path) -> None:
    assert run(package) == [(7.0, 0), (5.0, 0)]
    assert run(package) == [(7.0, 1), (5.0, 1)]


def test_a_changed_callee_in_another_file_is_compiled_again(package: Path) -> None:
    run(package)
    edit_lower(package, "+ 1.0", "+ 4.0")
    (value, hits), constant = run(package)
    assert (value, hits) == (10.0, 0)
    # The constant did not change: its reader is not compiled again.
    assert constant == (5.0, 1)


def test_a_changed_constant_in_another_file_is_compiled_again(package: Path) -> None:
    run(package)
    edit_lower(package, "FACTOR = 2.0", "FACTOR = 5.0")
    assert run(package) == [(16.0, 0), (8.0, 0)]
    assert run(package) == [(16.0, 1), (8.0, 1)]
