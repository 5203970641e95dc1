# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tags of a fleet over several runs: kept with the results, and what does not match."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.fleet import TextStage, text_fleet, text_stage
from helpers.fleet_results import filled

from adk_ros.api.fleet.fleet_run import FleetOptions, estimate_fleet, run_fleet
from adk_ros.api.fleet.results import fleet_frame
from adk_ros.cli import fleet as fleet_cli
from adk_ros.fleet.recordings import FleetRecording
from adk_ros.fleet.run import RunSummary
from adk_ros.fleet.tags import read_tags

HEAD = "recording,vehicle,time,rain\n"


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    folder = tmp_path / "drives"
    text_fleet(folder, {"a": "ok 1", "b": "ok 2", "c": "ok 3"})
    (folder / "fleet.csv").write_text(f"{HEAD}a,car 1,2026-03-01,yes\nb,car 2,,no\n")
    return folder


@pytest.fixture
def stage(tmp_path: Path, drives: Path) -> TextStage:
    """Return a stage whose results are there: its runs start no worker."""
    made: TextStage = text_stage(tmp_path / "log")
    filled(drives, tmp_path / "out", made)
    return made


def run(stage: TextStage, given: Path, out: Path, tags: Path | None = None) -> RunSummary:
    return run_fleet(stage, [str(given)], out, FleetOptions(cluster="tcp://nowhere:1", tags=tags))


def vehicles(out: Path) -> dict[str, str]:
    frame = fleet_frame(out, "text")
    return dict(zip(frame["recording"], frame["vehicle"].fillna(""), strict=True))


def test_a_run_over_a_part_keeps_the_tags_of_the_others(
    drives: Path, stage: TextStage, tmp_path: Path
) -> None:
    out, other = tmp_path / "out", tmp_path / "other.csv"
    run(stage, drives, out)
    assert vehicles(out) == {"a.mcap": "car 1", "b.mcap": "car 2", "c.mcap": ""}
    other.write_text("recording,vehicle,time,tyres\nc,car 3,,worn\n")
    run(stage, drives / "c*", out, other)
    assert vehicles(out) == {"a.mcap": "car 1", "b.mcap": "car 2", "c.mcap": "car 3"}
    other.write_text(f"{HEAD}a,car 9,,yes\n")
    run(stage, drives / "a*", out, other)
    assert vehicles(out) == {"a.mcap": "car 9", "b.mcap": "car 2", "c.mcap": "car 3"}
    frame = fleet_frame(out, "text").set_index("recording")
    assert frame.loc["b.mcap", "rain"].iloc[0] == "no"
    assert frame.loc["c.mcap", "tyres"].iloc[0] == "worn"


def test_what_does_not_match_is_counted(
    drives: Path, stage: TextStage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = drives / "fleet.csv"
    path.write_text(f"{HEAD}a,car 1,,yes\nbb,car 2,,no\nx,,,no\n")
    summary = run(stage, drives, tmp_path / "out")
    expected = (
        f"{path}: 2 of 3 rows match no recording: bb (line 3), x (line 4)",
        f"{path}: 2 of 3 recordings have no row: b.mcap, c.mcap",
    )
    assert summary.notes == expected
    assert estimate_fleet(stage, [str(drives)], tmp_path / "out").notes == expected
    fleet_cli._print_summary(stage, summary, tmp_path / "out")
    printed = "".join(capsys.readouterr().err.split())
    assert all("".join(line.split()) in printed for line in expected)
    path.unlink()
    assert run(stage, drives, tmp_path / "out").notes == ()


def test_a_folder_names_the_recording_that_lies_in_it_alone(tmp_path: Path) -> None:
    """As a bag that has lost its metadata.yaml."""
    names = ("alone/x.mcap", "two/a.mcap", "two/b.mcap")
    recordings = [FleetRecording(name, str(tmp_path / name), (), 0, "") for name in names]
    table = tmp_path / "fleet.csv"
    table.write_text(f"{HEAD}alone,car 1,,no\ntwo,car 2,,no\n")
    found = read_tags(table, recordings)
    assert {name: each.vehicle for name, each in found.tags.items()} == {"alone/x.mcap": "car 1"}
    assert "two (line 3)" in found.notes[0]


def test_the_table_of_the_recordings_is_not_rewritten(drives: Path, tmp_path: Path) -> None:
    """Results may lie in the folder of the recordings."""
    stage = text_stage(tmp_path / "log")
    filled(drives, drives, stage)
    before = (drives / "fleet.csv").read_text()
    run(stage, drives, drives)
    assert (drives / "fleet.csv").read_text() == before
    assert vehicles(drives)["b.mcap"] == "car 2"
