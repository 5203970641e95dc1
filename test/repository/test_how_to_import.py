# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""doc/how-to/import.md: its commands run as they stand, and print what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "doc" / "how-to" / "import.md").read_text(encoding="utf-8")


def blocks(heading: str, language: str) -> list[str]:
    """Return the code blocks of a section."""
    section = TEXT.split(f"\n## {heading}\n")[1].split("\n## ")[0] if heading else ""
    section = section or TEXT.split("To follow along")[1].split("\n## ")[0]
    every = re.findall(r"^```(\w*)\n(.*?)^```$", section, flags=re.DOTALL | re.MULTILINE)
    return [text for of, text in every if of == language]


def run(script: str, folder: Path) -> str:
    """Run a script in a folder, as a user with the package on the path; return what it printed."""
    paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
    done = subprocess.run(
        ["bash", "-e", "-c", script], cwd=folder, capture_output=True, text=True, check=False,
        env=os.environ | {"PATH": os.pathsep.join(paths), "COLUMNS": "120"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def spaced(text: str) -> str:
    """Return a text with single spaces, as a terminal's width breaks lines and pads tables."""
    return " ".join(text.split())


@pytest.mark.slow(seconds=120)
def test_every_step_does_what_the_page_says(tmp_path: Path) -> None:
    (recording,) = blocks("", "bash")
    run(recording, tmp_path)

    (propose,) = blocks("1. Propose a map", "bash")
    run(propose, tmp_path)
    proposed = (tmp_path / "map.yaml").read_text(encoding="utf-8")
    (shown,) = blocks("1. Propose a map", "yaml")
    assert shown in proposed

    ratio = "ratio: 16.5"
    assert ratio in proposed
    corrected = proposed.replace(ratio, "ratio: 15.8")
    (tmp_path / "map.yaml").write_text(corrected, encoding="utf-8")
    (convert,) = blocks("2. Correct it and import", "bash")
    printed = spaced(run(convert, tmp_path))
    (table,) = blocks("2. Correct it and import", "")
    lines = [line for line in table.splitlines() if line.strip() not in {"", "..."}]
    assert [line for line in lines if spaced(line) not in printed] == []

    (check,) = blocks("3. Check the sensors", "bash")
    (ends,) = re.findall(r"ends with `(.*?)`", TEXT)
    assert ends in run(check, tmp_path)

    (compare,) = blocks("4. Compare with the data sheet", "bash")
    printed = spaced(run(compare, tmp_path))
    (said,) = re.findall(r"^finds `(.*?)`", TEXT, flags=re.MULTILINE)
    assert spaced(said) in printed
    (differs,) = re.findall(r"differs by (-?[\d.]+ m/s²)", TEXT)
    assert differs in printed

    (export,) = blocks("5. Export", "bash")
    run(export, tmp_path)
    made = ("signals.csv", "signals", "signals.foxglove.json", "signals.plotjuggler.xml")
    assert [name for name in (*made, "drive.mat") if not (tmp_path / name).exists()] == []
