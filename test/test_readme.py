# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""README says what the code says."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

from adk_ros.cli.main import VERBS

ROOT = Path(__file__).resolve().parent.parent


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fill_readme", ROOT / "doc" / "fill_readme.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_tables_are_those_of_the_code() -> None:
    text = (ROOT / "README.md").read_text()
    assert _script().filled(text) == text, "run: .venv/bin/python doc/fill_readme.py"


def test_every_verb_and_linked_file_is_real() -> None:
    text = (ROOT / "README.md").read_text()
    for verb in re.findall(r"\badk ([a-z]+)", text):
        assert verb in {*VERBS, "bench"}, verb
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert link.startswith("https://") or (ROOT / link).is_file(), link


def test_all_verbs_are_described() -> None:
    text = (ROOT / "README.md").read_text()
    for verb in VERBS:
        assert f"adk {verb}" in text or f"make {verb}" in text, verb
