# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet replay: errors pooled over recordings, the most surprising minutes, table and JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.fleet_results import filled

from adk_ros.api.fleet.fleet_run import FleetEstimate
from adk_ros.api.fleet.index_stage import file_hash
from adk_ros.api.fleet.replay_stage import ReplayStage, surprise_rows
from adk_ros.api.fleet.replay_summary import PooledError, ReplaySummary, replay_summary
from adk_ros.cli.fleet_replay import print_replay
from adk_ros.cli.fleet_run import print_estimate
from adk_ros.cli.main import main
from adk_ros.cli.options import read_options
from adk_ros.fleet.recordings import find_recordings

ERRORS = {"a.mcap": (10, 1.0), "b.mcap": (30, 2.0)}
"""Recording -> rollouts and RMSE of v_x, m/s."""
SURPRISES = {"a.mcap": (9.0, 1.0), "b.mcap": (8.0, 7.0, 6.0, 5.0)}
"""Recording -> root mean squares of its minutes, the largest first."""


def rows_of(recording: str) -> list[dict[str, object]]:
    count, value = ERRORS[recording]
    error = {"kind": "error", "finding": "rmse", "unit": "m/s", "channel": "v_x"}
    rows: list[dict[str, object]] = [
        error | {"horizon_s": horizon, "condition": "", "value": value * horizon,
                 "details": {"count": count}}
        for horizon in (1.0, 2.0)
    ]  # fmt: skip
    turn = {"channel": "yaw_rate", "unit": "rad/s", "condition": "below 30 km/h"}
    if recording == "a.mcap":
        rows.append(error | turn | {"horizon_s": 1.0, "value": 0.01, "details": {"count": 4}})
    rows += [
        {"kind": "surprise", "finding": f"minute {i}", "channel": "v_y", "value": each,
         "details": {"from_s": 60.0 * i}}
        for i, each in enumerate(SURPRISES[recording])
    ]  # fmt: skip
    return rows


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ReplayStage:
    """Return a stage with the results above; the model is never loaded."""
    drives, model = tmp_path / "drives", tmp_path / "model"
    drives.mkdir()
    model.mkdir()
    for name in ERRORS:
        (drives / name).write_text(name)
    monkeypatch.setattr("adk_ros.model.stored_model.inspect_model", lambda _: {"training": {}})
    monkeypatch.setattr(ReplayStage, "run", lambda self, path, name: rows_of(name))
    made = ReplayStage(str(model), read_options(None, None, None, False, None, None))
    filled(drives, tmp_path / "out", made)
    return made


def test_squares_are_averaged_over_rollouts(stage: ReplayStage, tmp_path: Path) -> None:
    recordings = find_recordings([str(tmp_path / "drives")])
    found = replay_summary(tmp_path / "out", stage, recordings)
    values = {(e.condition, e.channel, e.horizon_s): e for e in found.errors}
    pooled = math.sqrt((10 * 1.0 + 30 * 4.0) / 40)
    assert values["", "v_x", 1.0].value == pytest.approx(pooled)
    assert values["", "v_x", 2.0].value == pytest.approx(2.0 * pooled)
    assert (values["", "v_x", 1.0].count, values["", "v_x", 1.0].recordings) == (40, 2)
    assert values["below 30 km/h", "yaw_rate", 1.0].count == 4
    assert len(values) == len(found.errors) == 3
    assert [each.value for each in found.surprises] == [9.0, 8.0, 7.0, 6.0, 5.0]
    one = replay_summary(tmp_path / "out", stage, recordings[:1])
    assert {each.recording for each in one.surprises} == {"a.mcap"}
    assert one.errors[0].value == 1.0
    other = ReplayStage(str(tmp_path / "drives"), stage.options)
    assert replay_summary(tmp_path / "out", other, recordings).errors == ()


def test_rows_are_selected_by_the_model(stage: ReplayStage, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "arrays.npz").write_text("weights")
    dataset = filled(tmp_path / "drives", tmp_path / "out", ReplayStage(str(other)))
    chosen = [file_hash(model) for model in (stage.model, str(other))]
    assert {row["model_hash"] for row in dataset.rows("replay")} == set(chosen)
    for each in chosen:
        assert {row["recording"] for row in dataset.rows("replay", {"model_hash": [each]})} == {
            *ERRORS
        }


def test_a_copy_counts_once(stage: ReplayStage, tmp_path: Path) -> None:
    before = replay_summary(tmp_path / "out", stage, find_recordings([str(tmp_path / "drives")]))
    (tmp_path / "drives" / "c.mcap").write_text("b.mcap")
    filled(tmp_path / "drives", tmp_path / "out", stage)
    found = find_recordings([str(tmp_path / "drives")])
    assert len(found) == 3
    assert replay_summary(tmp_path / "out", stage, found) == before


def test_a_recording_counts_as_it_is_now(
    stage: ReplayStage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives, out = tmp_path / "drives", tmp_path / "out"
    original = replay_summary(out, stage, find_recordings([str(drives)]))
    (drives / "a.mcap").write_text("a longer recording")
    monkeypatch.setitem(ERRORS, "a.mcap", (1000, 9.0))
    filled(drives, out, stage)
    changed = replay_summary(out, stage, find_recordings([str(drives)]))
    assert changed.errors[0].count == 1030
    (drives / "a.mcap").write_text("a.mcap")
    filled(drives, out, stage)
    assert replay_summary(out, stage, find_recordings([str(drives)])) == original


def test_table_and_json(stage: ReplayStage, tmp_path: Path, capsys) -> None:
    given = ["fleet", "replay", str(tmp_path / "drives"), "--model", stage.model]
    given += ["--out", str(tmp_path / "out"), "--cluster", "tcp://nowhere:1"]
    assert main(given) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "RMSE with future commands known (2 recordings)" in lines[0]
    (speed,) = [line.split() for line in lines if line.split()[:1] == ["all"]]
    # In km/h at 1 and 2 s.
    assert speed == ["all", "40", "v_x,", "km/h", "6.49", "12.98"]
    assert any(line.split()[-2:] == ["0.573", "-"] for line in lines)
    assert "surprise: a.mcap from 0 s: 9.00 standard deviations, most in v_y" in lines
    assert lines[-1].startswith("replay: 2 recordings, 2 done before")
    assert main([*given, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["total"] == content["reused"] == 2
    assert content["errors"][0] | {"value": 0.0} == {
        "channel": "v_x", "horizon_s": 1.0, "condition": "", "value": 0.0, "unit": "m/s",
        "count": 40, "recordings": 2,
    }  # fmt: skip
    assert content["surprises"][1] == {
        "recording": "b.mcap", "from_s": 0.0, "channel": "v_y", "value": 8.0
    }  # fmt: skip


TAGS = "recording,vehicle,time,load,rain,serial\na,car 1,,full,yes,\nb,car 2,,full,[no],7\n"


def test_errors_are_pooled_by_the_tags_of_fleet_csv(
    stage: ReplayStage, tmp_path: Path, capsys
) -> None:
    (tmp_path / "drives" / "fleet.csv").write_text(TAGS)
    given = ["fleet", "replay", str(tmp_path / "drives"), "--model", stage.model]
    given += ["--out", str(tmp_path / "out"), "--cluster", "tcp://nowhere:1"]
    assert main([*given, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["errors_by_tag"]
    assert {tag: list(by) for tag, by in found.items()} == {
        "load": ["full"], "rain": ["[no]", "yes"], "serial": ["7"]
    }  # fmt: skip
    (first, _) = found["load"]["full"]
    pooled = math.sqrt((10 * 1.0 + 30 * 4.0) / 40)
    assert first["value"] == pytest.approx(pooled)
    assert (first["horizon_s"], first["count"], first["recordings"]) == (1.0, 40, 2)
    assert [each["value"] for each in found["rain"]["yes"]] == [1.0, 2.0]
    assert [each["recordings"] for each in found["rain"]["[no]"]] == [1, 1]
    assert main(given) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("RMSE by column of fleet.csv") for line in lines)
    rows = [line.split() for line in lines if " = " in line]
    # Recordings and rollouts, then km/h at 1 and 2 s.
    assert ["rain", "=", "yes", "1", "10", "v_x,", "km/h", "3.6", "7.2"] in rows
    assert ["rain", "=", "[no]", "1", "30", "v_x,", "km/h", "7.2", "14.4"] in rows
    assert ["load", "=", "full", "2", "40", "v_x,", "km/h", "6.49", "12.98"] in rows


def test_a_number_for_each_recording_is_no_condition(capsys) -> None:
    error = PooledError("v_x", 1.0, "", 1.0, "m/s", 10, 1)
    print_replay(ReplaySummary((), (), {"mass": {str(i): (error,) for i in range(11)}}))
    printed = capsys.readouterr()
    assert "mass =" not in printed.out
    assert "mass has 11 values: give it as classes, or see --json" in printed.err


def test_a_minute_of_a_few_predictions_is_not_listed() -> None:
    times = np.arange(0, 61_000, 25)
    surprising = np.where(times < 60_000, 1.0, 9.0)
    predictions = [SimpleNamespace(origin_ns=int(t) * 10**6, covariance=np.eye(3)) for t in times]
    replayed = SimpleNamespace(
        predictions=predictions,
        innovations=np.column_stack([surprising] * 3),
        recording=SimpleNamespace(content=SimpleNamespace(start_ns=0)),
    )
    (row,) = surprise_rows(replayed)  # type: ignore[arg-type]
    assert (row["finding"], row["value"]) == ("minute 0", 1.0)


def test_a_cluster_without_workers_has_no_duration(capsys) -> None:
    estimate = FleetEstimate("index", 3, 1, 2, 0, 10**6, 0, None, 1)
    print_estimate(estimate.as_dict(), False)
    text = "duration unknown: no worker is connected to the scheduler"
    assert capsys.readouterr().out.rstrip().endswith(text)
