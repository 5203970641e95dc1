# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hash of the code changes with whatever decides what a command writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from adk_ros.files.code_digest import code_digest, digest_of


@pytest.fixture
def package(tmp_path: Path) -> Path:
    for name in ("a.py", "data/car.vehicle.yaml", "templates/page.html.j2"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("1")
    return tmp_path


@pytest.mark.parametrize("name", ["a.py", "data/car.vehicle.yaml", "templates/page.html.j2"])
def test_sources_and_data_count(package: Path, name: str) -> None:
    before = digest_of(package)
    (package / name).write_text("2")
    changed = digest_of(package)
    assert changed != before
    (package / name).rename(package / f"b_{Path(name).name}")
    assert digest_of(package) not in {before, changed}


def test_what_python_keeps_does_not_count(package: Path) -> None:
    before = digest_of(package)
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "a.cpython-311.pyc").write_text("compiled")
    assert digest_of(package) == before
    assert len(code_digest()) == 64
