# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import adk_ros`: lazy, typed, documented, silent."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import adk_ros

FUNCTIONS = (
    "adapted_predictor", "explain", "load_model", "read_recording", "replay", "rollout",
    "simulate", "train_model",
)  # fmt: skip


def test_importing_the_package_is_fast_and_loads_nothing_heavy() -> None:
    script = (
        "import sys, adk_ros\n"
        "heavy = {'torch', 'pandas', 'numpy', 'numba', 'matplotlib', 'rosbags', 'rclpy'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
        "adk_ros.read_recording\n"
        "print('torch' in sys.modules)\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert process.stdout.splitlines() == ["[]", "False"]


def test_every_public_name_can_be_loaded() -> None:
    assert set(FUNCTIONS) <= set(adk_ros.__all__) <= set(dir(adk_ros))
    for name in adk_ros.__all__:
        assert getattr(adk_ros, name).__doc__ or name == "Progress", name
    with pytest.raises(AttributeError, match="has no attribute 'trian'"):
        _ = adk_ros.trian


def test_type_checkers_see_every_public_name() -> None:
    source = Path(inspect.getfile(adk_ros)).read_text(encoding="utf-8")
    (block,) = (node for node in ast.parse(source).body if isinstance(node, ast.If))
    names = {
        alias.asname: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(str(name) for name in names) == adk_ros.__all__
    for name, (module, original) in names.items():
        assert name == original
        assert getattr(adk_ros, str(name)) is getattr(sys.modules[str(module)], original)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_function_is_documented_with_an_example(name: str) -> None:
    function = getattr(adk_ros, name)
    text = inspect.getdoc(function) or ""
    assert f"adk_ros.{name}(" in text, "no example"
    assert ":raises UsageError:" in text
    for parameter in inspect.signature(function).parameters:
        if parameter not in ("progress", "on_step"):
            documented = text.split(":param ")
            assert any(parameter in part.split(":")[0] for part in documented), parameter
