# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each reported defect of `adk mismatch` has a test."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [
    line
    for line in (ROOT / "doc" / "reported-defects.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| seen", "| ---"))
]


def test_all_defects_are_listed() -> None:
    assert len(ROWS) >= 13


@pytest.mark.parametrize("row", ROWS)
def test_a_defect_names_tests_that_exist(row: str) -> None:
    named = re.findall(r"`(test/[\w/]+\.py)::(\w+)`", row)
    assert named, row
    for path, name in named:
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        defined = {x.name for x in tree.body if isinstance(x, ast.FunctionDef)}
        assert name in defined, f"{path}::{name}"
