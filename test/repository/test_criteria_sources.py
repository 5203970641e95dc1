# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the constants of the decision come from: documentation and docstrings agree."""

from __future__ import annotations

import ast
import importlib
import re
from itertools import pairwise
from pathlib import Path

import pytest

from adk_ros.bench.mismatch.criteria_sensitivity import criterion_names
from adk_ros.mismatch.library import criteria

ROOT = Path(__file__).resolve().parents[2]


def table() -> dict[str, tuple[int, list[str]]]:
    """Return source -> stated number, names; of the table in the documentation."""
    text = (ROOT / "doc" / "mismatch.md").read_text(encoding="utf-8")
    _, _, rows = text.partition("**Sources of the constants.**")
    rows, _, _ = rows.partition("\n### ")
    found = re.findall(r"^\| (.+?) \| (\d+) \| (.+) \|$", rows, re.MULTILINE)
    return {source: (int(n), re.findall(r"`(\w+)`", names)) for source, n, names in found}


def docstrings() -> dict[str, str]:
    """Return the docstring of each constant in one line."""
    body = ast.parse(Path(criteria.__file__).read_text(encoding="utf-8")).body
    out = {}
    for assigned, after in pairwise(body):
        if isinstance(assigned, ast.Assign):
            target: ast.expr = assigned.targets[0]
        elif isinstance(assigned, ast.AnnAssign):
            target = assigned.target
        else:
            continue
        assert isinstance(after, ast.Expr)
        out[ast.unparse(target)] = " ".join(str(ast.literal_eval(after.value)).split())
    return out


def source_of(name: str) -> str:
    return next(source for source, (_, names) in table().items() if name in names)


def test_every_constant_has_one_source() -> None:
    listed = [name for _, names in table().values() for name in names]
    assert sorted(listed) == criterion_names() == sorted(docstrings())


def test_the_numbers_are_those_of_the_lists() -> None:
    rows = table()
    assert all(number == len(names) for number, names in rows.values())
    text = (ROOT / "doc" / "mismatch.md").read_text(encoding="utf-8")
    assert f"The {len(criterion_names())} constants of `library/criteria.py`" in text


@pytest.mark.parametrize(
    ("word", "sources"),
    [
        ("Convention", ["convention"]),
        ("alibrated to a factor of two", ["by choice, to a factor", "lists of"]),
        ("By choice", ["by choice"]),
    ],
)
def test_the_docstrings_name_the_same_source(word: str, sources: list[str]) -> None:
    stated = [name for name, text in docstrings().items() if word in text]
    assert stated
    for name in stated:
        assert source_of(name).startswith(tuple(sources)), name


def test_the_modules_with_other_constants_exist() -> None:
    text = criteria.__doc__ or ""
    constants = re.findall(r"`([a-z_.]+)\.(_?[A-Z][A-Z_]+)`", text)
    modules = [(module, "") for module in re.findall(r"`([a-z_]+\.[a-z_.]+)`", text)]
    assert len(constants) > 15
    assert len(modules) > 10
    for name, constant in (*constants, *modules):
        package = "adk_ros" if name.startswith("numerics.") else "adk_ros.mismatch"
        module = importlib.import_module(f"{package}.{name}")
        assert not constant or hasattr(module, constant), f"{name}.{constant}"
