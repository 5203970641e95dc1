# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of single recordings that the page of a fleet links."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import pytest
from helpers.fleet import text_fleet
from helpers.fleet_results import filled

from adk_ros.api.fleet.fleet_mismatch import RECORDINGS, _reports
from adk_ros.api.fleet.report_stage import ReportStage
from adk_ros.errors import DataError
from adk_ros.fleet.recordings import find_recordings


@pytest.fixture
def stages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[ReportStage]:
    """Return stages of two simulations, whose reports are the text of the simulation."""

    def explain(simulation: str, path: Path, **given: object) -> SimpleNamespace:
        def write(folder: Path, force: bool) -> None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "report.html").write_text(Path(simulation).read_text() + path.read_text())

        return SimpleNamespace(write=write)

    monkeypatch.setattr("adk_ros.api.explain.explain", explain)
    monkeypatch.setattr(
        "adk_ros.api.fleet.report_stage.explanation_rows",
        lambda explanation: [{"kind": "verdict", "finding": "none", "details": {}}],
    )
    made = []
    for name in ("before", "after"):
        (tmp_path / name).write_text(name)
        made.append(ReportStage(str(tmp_path / name), str(tmp_path / "report" / RECORDINGS)))
    return made


def test_the_page_links_reports_of_its_simulation(
    stages: list[ReportStage], tmp_path: Path
) -> None:
    drives, out = tmp_path / "drives", tmp_path / "out"
    text_fleet(drives, {"a": " a", "b#1": " b"})
    for stage in stages:
        filled(drives, out, stage)
    found = find_recordings([str(drives)])
    for stage, name in zip(stages, ("before", "after"), strict=True):
        links, failed = _reports(out, stage, found[:1])
        assert (list(links), failed) == (["a.mcap"], {})
        assert (tmp_path / "report" / links["a.mcap"]).read_text() == f"{name} a"
    (link,) = _reports(out, stages[0], found[1:])[0].values()
    assert quote("b#1.mcap") in link
    Path(stages[1].simulation).write_text("changed")
    assert _reports(out, stages[1], found) == ({}, {})


def test_a_report_that_failed_says_why(
    stages: list[ReportStage], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def explain(simulation: str, path: Path, **given: object) -> SimpleNamespace:
        raise DataError("it stands still")

    text_fleet(tmp_path / "drives", {"a": " a"})
    monkeypatch.setattr("adk_ros.api.explain.explain", explain)
    filled(tmp_path / "drives", tmp_path / "out", stages[0])
    found = find_recordings([str(tmp_path / "drives")])
    assert _reports(tmp_path / "out", stages[0], found) == ({}, {"a.mcap": "it stands still"})
