# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The README: short, complete, with commands and links that exist."""

from __future__ import annotations

import re
from pathlib import Path

from adk_ros.cli.main import VERBS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
MAX_LINES = 180


def test_readme_is_short() -> None:
    assert len(README.splitlines()) <= MAX_LINES


def test_every_command_and_linked_file_exists() -> None:
    for verb in re.findall(r"\badk ([a-z]+)", README):
        assert verb in {*VERBS, "bench", "fleet"}, verb
    for target in re.findall(r"\bmake ([a-z-]+)", README):
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), target
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert link.startswith("https://") or (ROOT / link).is_file(), link


def test_every_command_is_described() -> None:
    for verb in VERBS:
        assert f"adk {verb}" in README or f"make {verb}" in README, verb


def test_sections_are_in_reading_order() -> None:
    sections = re.findall(r"^## (.*)$", README, re.MULTILINE)
    assert sections == [
        "Quick start", "Find what a simulation lacks", "Train and predict", "Your own data",
        "How good is it", "Documentation", "Licence",
    ]  # fmt: skip


def test_demonstration_states_its_output() -> None:
    output = re.search(r"<!-- mismatch output -->\n```\n(.+)\n```\n<!-- /", README, re.DOTALL)
    assert output is not None
    assert "drag" in output[1]
