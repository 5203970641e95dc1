# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Headers, ruff, mypy, and what the ament linters of ROS 2 Jazzy find."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHECKED = ["adk_ros", "examples", "launch", "scripts", "setup.py", "test"]
SOURCES = sorted(
    path
    for place in CHECKED
    for path in (ROOT.joinpath(place).rglob("*.py") if place != "setup.py" else [ROOT / place])
)
HEADER = "# Copyright 2026 The adk_ros authors\n# SPDX-License-Identifier: Apache-2.0\n"

# D400: a summary may ask a question, which D415 allows. D401: a property says what it is, not what
# to do. D402: a formula in a summary is not a signature. D403: a
# summary may begin with a symbol. D406, D407, D413: no NumPy sections.
NOT_ASKED = ["D400", "D401", "D402", "D403", "D406", "D407", "D413"]


def complaints(*command: str) -> str:
    """What a checker, run in the repository with this Python, finds; "" if it is content."""
    # Under colcon the package is installed elsewhere, and that copy is not the one to check.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, env=environment,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode == 0:
        return ""
    said = (done.stdout + done.stderr).splitlines()
    # The ament linters also list what they have looked at.
    return "\n".join(line for line in said if line and not line.startswith(("* ", "checking ")))


def faults(path: Path) -> Iterator[str]:
    """Yield what is wrong with header, docstring and width of a source file."""
    text = path.read_text(encoding="utf-8")
    if not text.startswith(HEADER):
        yield "no header"
    tree = ast.parse(text)
    if tree.body and not ast.get_docstring(tree):
        yield "no docstring"
    # ruff lets a line end in a pragma beyond the limit; ament_flake8, which is slow, does not.
    if any(len(line) > 99 for line in text.splitlines()):
        yield "a line is too long"


def test_header_docstring_and_width(tmp_path: Path) -> None:
    assert not [f"{path}: {fault}" for path in SOURCES for fault in faults(path)]
    wrong = tmp_path / "wrong.py"
    wrong.write_text(f"x = {100 * '1'}")
    assert list(faults(wrong)) == ["no header", "no docstring", "a line is too long"]


def test_headers_elsewhere() -> None:
    for name in ("Makefile", ".ci/run"):
        text = (ROOT / name).read_text()
        assert re.sub(r"^#!.*\n", "", text).startswith(HEADER), name


def test_ruff() -> None:
    said = complaints("ruff", "check", "--no-cache", "--output-format=concise", ".")
    assert not said, said


def test_ruff_format() -> None:
    said = complaints("ruff", "format", "--no-cache", "--check", ".")
    assert not said, said


@pytest.mark.slow
def test_mypy() -> None:
    said = complaints("mypy", "--no-pretty")
    assert not said, said


@pytest.mark.slow
def test_ament_pep257() -> None:
    said = complaints("ament_pep257.main", "--add-ignore", *NOT_ASKED, "--", "adk_ros", "launch")
    assert not said, said


@pytest.mark.slow
def test_ament_flake8() -> None:
    said = complaints("ament_flake8.main", "--config", "setup.cfg", "--", *CHECKED)
    assert not said, said


@pytest.mark.parametrize(
    ("checker", "source"),
    [
        (["ruff", "check", "--no-cache", "--isolated"], '"""Doc."""\n\nimport os\n'),
        (["ruff", "format", "--no-cache", "--isolated", "--check"], '"""Doc."""\n\nx=1\n'),
        (["mypy", "--strict", "--cache-dir", os.devnull], '"""Doc."""\n\nx: int = "1"\n'),
        (["ament_pep257.main"], '"""doc without a stop"""\n'),
        (["ament_flake8.main", "--config", "setup.cfg"], '"""Doc."""\n\n\n\n\nx=1\n'),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_the_checkers_do_check(tmp_path: Path, checker: list[str], source: str) -> None:
    (tmp_path / "bad.py").write_text(source)
    assert "bad.py" in complaints(*checker, str(tmp_path / "bad.py"))
