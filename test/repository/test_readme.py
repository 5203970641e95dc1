# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""README says what the code says."""

from __future__ import annotations

import base64
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from helpers.paper import good_board
from matplotlib import pyplot as plt

from adk_ros.bench.paper.criteria import evaluate_paper_criteria
from adk_ros.bench.paper.headline import headline
from adk_ros.cli.main import VERBS

ROOT = Path(__file__).resolve().parents[2]


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


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """What a run of `adk bench paper` leaves, with one figure and one table."""
    folder = tmp_path / "run"
    for name in ("tables", "figures"):
        (folder / name).mkdir(parents=True)
    board = good_board()
    headline(board, "One seed.").write(folder)
    (folder / "bars.txt").write_text(
        "".join(f"{bar}\n" for bar in evaluate_paper_criteria(board, None))
    )
    figure, axis = plt.subplots()
    axis.plot(np.random.default_rng(1).standard_normal((500, 3)))
    figure.savefig(folder / "figures" / "summary.png")
    plt.close(figure)
    picture = base64.b64encode((folder / "figures" / "summary.png").read_bytes()).decode()
    (folder / "report.html").write_text(f'<img src="data:image/png;base64,{picture}">')
    (folder / "claims.md").write_text("# The paper's claims\n")
    (folder / "tables" / "summary.md").write_text("### Summary\n")
    (folder / "scores.csv").write_text("not for the repository\n")
    return folder


def test_a_report_goes_into_the_readme(run: Path, tmp_path: Path) -> None:
    script, paper = _script(), tmp_path / "paper"
    text = (ROOT / "README.md").read_text()
    bare = script.filled(text, paper)
    assert "<!-- paper -->\n<!-- /paper -->" in bare
    (paper / "tables").mkdir(parents=True)
    (paper / "tables" / "old.md").write_text("of the report before")
    size = script.take(run, paper)
    files = {path.relative_to(paper).as_posix() for path in paper.rglob("*") if path.is_file()}
    assert files == {
        "report.html", "headline.md", "headline.csv", "claims.md", "bars.txt",
        "tables/summary.md", "figures/summary.png",
    }  # fmt: skip
    assert size == sum((paper / name).stat().st_size for name in files)
    picture = (paper / "figures" / "summary.png").read_bytes()
    assert len(picture) < 0.8 * (run / "figures" / "summary.png").stat().st_size
    assert base64.b64encode(picture).decode() in (paper / "report.html").read_text()
    full = script.filled(text, paper)
    assert "| **adk_ros** | **0.100** |" in full
    assert "- **PASS** `geometric-mean`: 0.100 of" in full
    assert "doc/paper/figures/summary.png" in full
    assert script.filled(full, paper) == full
    (paper / "headline.md").unlink()
    assert script.filled(full, paper) == bare


def test_what_is_no_report_or_too_large_changes_nothing(run: Path, tmp_path: Path) -> None:
    script, paper = _script(), tmp_path / "paper"
    with pytest.raises(SystemExit, match=r"it has no report\.html"):
        script.take(tmp_path / "nothing", paper)
    script.MOST_BYTES = 1000
    with pytest.raises(SystemExit, match="MB for doc/paper"):
        script.take(run, paper)
    assert not paper.exists()
