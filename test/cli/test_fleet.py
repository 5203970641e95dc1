# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet: what it says and refuses, and its stages on real recordings."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.fleet_results import filled
from helpers.small_fleet_result import small_result
from helpers.train import bag, refused, small

from adk_ros.api.explain import explain
from adk_ros.api.fleet.default_rates import DEFAULT_CORE_S
from adk_ros.api.fleet.explain_stage import ExplainStage
from adk_ros.api.fleet.fleet_run import FleetOptions, estimate_fleet, run_fleet
from adk_ros.api.fleet.index_stage import IndexStage, file_hash
from adk_ros.api.fleet.mismatch_estimate import _is_reported
from adk_ros.api.fleet.replay_stage import ReplayStage
from adk_ros.api.fleet.report_stage import ReportStage
from adk_ros.api.fleet.results import fleet_frame, fleet_summary
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.fleet.columns import checked_row
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.recordings import find_recordings
from adk_ros.fleet.report.fleet_page import write_fleet_page
from adk_ros.fleet.run import RunSummary
from adk_ros.fleet.stage import version_of


@pytest.fixture
def drives(tmp_path):
    """Return a folder of two recordings, one damaged, and their tags."""
    folder = tmp_path / "drives"
    shutil.copytree(bag(), folder / "town")
    (folder / "bad.mcap").write_text("no bag")
    (folder / "fleet.csv").write_text("recording,vehicle,time,rain\ntown,car 1,2026-03-01,yes\n")
    return folder


def test_index(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    filled(drives, out, IndexStage())
    shutil.copy(drives / "fleet.csv", out)
    frame = fleet_frame(out, "index")
    town = frame[frame["recording"] == "town"]
    assert set(town["vehicle"]) == {"car 1"}
    assert set(town["rain"]) == {"yes"}
    # No model takes part in it.
    assert set(frame["model_hash"]) == {""}
    duration = town[town["finding"] == "duration"]
    assert float(duration["value"].iloc[0]) == pytest.approx(30.0, abs=0.1)
    assert {"content", "usable", "scope", "check"} <= set(town["kind"])
    bad = frame[frame["recording"] == "bad.mcap"]
    assert list(bad["failure"]) == ["unusable"]
    assert "neither MCAP" in bad["reason"].iloc[0]
    (summary,) = fleet_summary(out)
    assert (summary["recordings"], summary["failed"]) == (2, {"unusable": 1})
    assert main(["fleet", "report", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "index: 2 recordings, 1 failed" in printed
    assert "failed: bad.mcap: " in printed
    assert main(["fleet", "report", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["stage"] == "index"


def test_a_newer_result_replaces_an_older_one(drives, tmp_path) -> None:
    out = tmp_path / "out"
    dataset = filled(drives, out, IndexStage())
    row = dataset.rows("index")[0]
    newer = row | {"key": "other", "finding": "newer", "written_s": row["written_s"] + 9.0}
    dataset.append("index", [newer])
    frame = fleet_frame(out, "index")
    assert list(frame[frame["recording"] == row["recording"]]["finding"]) == ["newer"]


def test_replay(tmp_path) -> None:
    stage = ReplayStage(str(small().path))
    rows = [checked_row(row) for row in stage.run(bag(), "")]
    kinds = {row["kind"] for row in rows}
    assert {"error", "baseline", "surprise"} <= kinds
    errors = [row for row in rows if row["kind"] == "error"]
    whole = {(r["channel"], r["horizon_s"]): r for r in errors if r["condition"] == ""}
    assert len(whole) == 15
    # The classes of speed are a partition: their mean of squares is that of all.
    for key, row in whole.items():
        parts = [r for r in errors if (r["channel"], r["horizon_s"]) == key]
        parts = [r for r in parts if r["condition"].endswith("km/h")]
        count = [json.loads(r["details"])["count"] for r in parts]
        pooled = np.average([r["value"] ** 2 for r in parts], weights=count)
        assert np.sqrt(pooled) == pytest.approx(row["value"])
    surprises = [row["value"] for row in rows if row["kind"] == "surprise"]
    assert surprises == sorted(surprises, reverse=True)
    assert all(0.0 < value < 100.0 for value in surprises)
    assert stage.inputs_hash != ReplayStage("").inputs_hash


def test_dry_run(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["fleet", "index", str(drives), "--out", str(out), "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "2 recordings, 0 done, 2 to process" in text
    # Half a minute; the damaged file has six bytes.
    seconds = DEFAULT_CORE_S["index"] * 0.5
    assert "s of a core for a minute of recording, as an AMD EPYC takes" in text
    given = ["fleet", "index", str(drives), "--out", str(out), "--workers", "1"]
    assert main([*given, "--dry-run", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["seconds"] == pytest.approx(seconds, rel=0.02)
    assert not out.exists()
    filled(drives, out, IndexStage())
    options = ["--dry-run", "--workers", "2", "--json"]
    # Another vehicle file: the same recordings, to be processed again at the measured rate.
    given = ["fleet", "index", str(drives), "--out", str(out), "--vehicle", "imdv", *options]
    assert main(given) == 0
    estimate = json.loads(capsys.readouterr().out)
    assert (estimate["reused"], estimate["missing"], estimate["measured"]) == (0, 2, 1)
    assert estimate["seconds"] > 0.0
    done = estimate_fleet(IndexStage(), [str(drives)], out)
    assert (done.reused, done.missing, done.seconds) == (2, 0, 0.0)


def test_dry_run_of_all_passes(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    given = ["fleet", "mismatch", str(drives), "--simulation", str(bag()), "--out", str(out)]
    assert main([*given, "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "evidence: 2 recordings, 0 done, 2 to process" in text
    assert "counts of the first of about 3 passes" in text
    assert "by a default of 0.4 s of a core for a minute of recording and pass" in text
    assert not out.exists()
    # Half a minute, three times; the damaged file has six bytes.
    assert main([*given, "--dry-run", "--json", "--workers", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["seconds"] == pytest.approx(0.6, rel=0.02)
    # At the rate of one recording that took 30 s: one to do and both again in two passes.
    row = {"recording": "town", "key": "1", "status": "ok", "seconds": 30.0}
    size = find_recordings([str(drives)])[-1].size
    FleetDataset(out).append("evidence", [row | {"bytes": size}])
    assert main([*given, "--dry-run", "--json", "--workers", "1"]) == 0
    estimate = json.loads(capsys.readouterr().out)
    assert estimate["seconds"] == pytest.approx(90.0, rel=0.01)
    assert main([*given, "--dry-run", "--json", "--limit", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["total"] == 1


def test_an_analysis_that_was_stopped_after_a_pass_is_not_done(tmp_path) -> None:
    """The report of an earlier analysis is not that of its evidence."""
    out = tmp_path / "out"
    (out / "report").mkdir(parents=True)
    report = out / "report" / "fleet.json"
    report.write_text("{}")
    row = {"recording": "town", "key": "1", "status": "ok", "seconds": 30.0, "bytes": 1}
    FleetDataset(out).append("evidence", [row | {"written_s": report.stat().st_mtime + 1.0}])
    assert not _is_reported(out, "evidence")
    os.utime(report, (time.time() + 9.0,) * 2)
    assert _is_reported(out, "evidence")


@pytest.mark.slow(seconds=90)
def test_a_recording_gets_its_own_report(tmp_path) -> None:
    simulation = tmp_path / "simulation.yaml"
    simulated = tmp_path / "simulated"
    explain(bag("handling", 120.0), bag("xyz_edges", 60.0), "imdv", simulated)
    shutil.copy(simulated / "simulation.yaml", simulation)
    stage = ReportStage(str(simulation), str(tmp_path / "reports"))
    rows = [checked_row(row) for row in stage.run(bag("town", 60.0), "day 1/town")]
    (verdict,) = [row for row in rows if row["kind"] == "verdict"]
    page = json.loads(verdict["details"])["report"]
    assert page.endswith("/day 1/town/report.html")
    assert (tmp_path / "reports" / page).stat().st_size > 10_000
    before = stage.inputs_hash
    simulation.write_text(simulation.read_text() + "# changed")
    assert stage.inputs_hash != before


def test_the_summary_names_the_page(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    filled(drives, out, IndexStage())
    assert main(["fleet", "report", str(out)]) == 0
    assert "page" not in capsys.readouterr().out
    (out / "report").mkdir()
    (out / "report" / "fleet.html").write_text("<html></html>")
    assert main(["fleet", "report", str(out)]) == 0
    assert "page of 'adk fleet mismatch':" in capsys.readouterr().out


@pytest.mark.usefixtures("unrendered")
def test_the_report_writes_the_page_again(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    filled(drives, out, IndexStage())
    (out / "report").mkdir()
    page = write_fleet_page(small_result(), out / "report")
    text, lines = page.read_text(), [f"page of 'adk fleet mismatch': {page}"]
    page.unlink()
    assert main(["fleet", "report", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1:] == lines
    assert page.read_text() == text
    page.unlink()
    assert main(["fleet", "report", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["stage"] == "index"
    assert page.read_text() == text
    # While a run works in the folder, the page stays as it is.
    page.write_text("earlier")
    with (out / ".lock").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert main(["fleet", "report", str(out)]) == 0
    said = capsys.readouterr()
    assert "the page is not written again:" in said.err
    assert "is in use by" in said.err
    assert said.out.splitlines()[-1:] == lines
    assert page.read_text() == "earlier"
    (out / "report" / "fleet.json").write_text('{"schema": 1}')
    assert main(["fleet", "report", str(out)]) == 0
    said = capsys.readouterr()
    assert "index: 2 recordings, 1 failed" in said.out
    assert said.out.splitlines()[-1:] == lines
    assert page.read_text() == "earlier"
    assert "fleet.json is of another version of adk_ros (schema 1, not 2)" in said.err


def test_a_run_with_nothing_to_do_starts_no_worker(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    filled(drives, out, IndexStage())
    summary = run_fleet(IndexStage(), [str(drives)], out, FleetOptions(cluster="tcp://nowhere:1"))
    assert (summary.reused, summary.computed) == (2, 0)
    assert (out / "fleet.csv").read_text().startswith("recording,vehicle,time,rain\n")
    assert main(["fleet", "index", str(drives), "--out", str(out)]) == 0
    assert "index: 2 recordings, 2 done before" in capsys.readouterr().out


def test_the_vehicle_is_found_from_any_folder(drives, tmp_path, monkeypatch) -> None:
    stages = []

    def note(stage, *_):
        stages.append(stage)
        return RunSummary(0, 0, 0, 0.0, {})

    monkeypatch.setattr("adk_ros.api.fleet.fleet_run.run_fleet", note)
    monkeypatch.chdir(tmp_path)
    Path("vehicle.yaml").write_text("mass: 1")
    for name in ("vehicle.yaml", "imdv"):
        assert main(["fleet", "index", str(drives), "--out", "o", "--vehicle", name]) == 0
    assert [each.vehicle for each in stages] == [str(tmp_path / "vehicle.yaml"), "imdv"]


def test_the_hash_of_the_inputs(tmp_path) -> None:
    simulation = tmp_path / "sim.yaml"
    simulation.write_text("a")
    stage = ExplainStage(str(simulation))
    before = stage.inputs_hash
    assert before != ExplainStage(str(simulation), "imdv").inputs_hash
    assert before != ExplainStage(str(simulation), without_imu=True).inputs_hash
    wheels = RecordingOptions(odometry="/wheel_odometry")
    assert before != ExplainStage(str(simulation), options=wheels).inputs_hash
    assert before != ReportStage(str(simulation), "reports").inputs_hash
    simulation.write_text("b")
    assert before != stage.inputs_hash


def test_the_model_is_hashed_once_for_a_run(tmp_path, monkeypatch) -> None:
    simulation = tmp_path / "sim.yaml"
    hashed: list[str] = []

    def counted(path):
        hashed.append(path)
        return file_hash(path)

    monkeypatch.setattr("adk_ros.api.fleet.explain_stage.file_hash", counted)
    simulation.write_text("a")
    stage = ExplainStage(str(simulation), "imdv")
    version = version_of(stage)
    assert hashed == [str(simulation), "imdv"]
    assert version.inputs_hash == stage.inputs_hash
    assert version.model_hash == file_hash(str(simulation))
    # Another vehicle or topic is another result of the same model.
    other = version_of(ExplainStage(str(simulation), options=RecordingOptions(imu="/imu_2")))
    assert other.inputs_hash != version.inputs_hash
    assert other.model_hash == version.model_hash


def test_named_topics_reach_the_checks() -> None:
    stage = IndexStage(options=RecordingOptions(imu="/none"))
    rows = stage.run(bag(), "town")
    (text,) = [row["text"] for row in rows if row["finding"] == "not checked"]
    assert "/none" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["index", "{d}/none", "--out", "{o}"], "none does not exist"),
        (["index", "{d}", "--out", "{o}", "--workers", "0"], "--workers 0: at least one"),
        (["index", "{d}", "--out", "{o}", "--timeout", "0"], "--timeout 0: must be positive"),
        (["index", "{d}", "--out", "{o}", "--memory", "-1"], "--memory -1: must be positive"),
        (["index", "{d}", "--out", "{o}", "--limit", "0"], "--limit 0: at least one"),
        (
            ["index", "{d}", "--out", "{o}", "--workers", "1", "--cluster", "tcp://x:1"],
            "leave it out with --cluster",
        ),
        (["index", "{d}", "--out", "{d}/fleet.csv"], "cannot be written"),
        (["index", "{d}", "--out", "{o}", "--tags", "{d}/no.csv"], "cannot be read"),
        (["explain", "{d}", "--simulation", "{d}/no", "--out", "{o}"], "no does not exist"),
        (["mismatch", "{d}", "--simulation", "{d}/no", "--out", "{o}"], "no does not exist"),
        (
            ["mismatch", "{d}", "--simulation", "{d}", "--out", "{d}/fleet.csv"],
            "fleet.csv cannot be written",
        ),
        (["compare", "{d}", "{d}", "--out", "{o}"], "has no result of 'adk fleet mismatch'"),
        (["replay", "{d}", "--model", "{d}/no", "--out", "{o}"], "no"),
        (["report", "{o}"], "no results of 'adk fleet'"),
    ],
)
def test_refusals(drives, tmp_path, capsys, arguments, message) -> None:
    given = [each.format(d=drives, o=tmp_path / "out") for each in arguments]
    assert message in refused(capsys, ["fleet", *given], 2)


@pytest.mark.slow(seconds=60)
def test_index_by_workers(drives, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["fleet", "index", str(drives), "--out", str(out), "--workers", "1"]) == 0
    text = capsys.readouterr().out
    assert "2 recordings, 0 done before, 2 processed" in text
    assert "failed: 1 unusable" in text
    (summary,) = fleet_summary(out)
    assert list(summary["reasons"]) == ["bad.mcap"]
    assert set(fleet_frame(out, "index")["rain"].dropna()) == {"yes"}
