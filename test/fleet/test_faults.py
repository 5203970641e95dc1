# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""scripts/fleet_faults.py: the results of disturbed runs are those of undisturbed ones."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import fleet_faults
import pytest
from fleet_faults import FULL, INDEX, SECOND, STORE, Faults, Tally, criteria_of

from adk_ros.api.fleet.evidence_stage import EvidenceStage, write_point
from adk_ros.bench.fleet import disturbed_runs
from adk_ros.bench.fleet.disturbed_runs import (
    LoggedKeepingStage,
    LoggedStage,
    Repeats,
    _stored,
    different_rows,
    repeats_of,
    work_of,
)
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.stage import StageVersion, keeps_recordings, version_of


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    """Return the runs on a small fleet, and its undisturbed result."""
    return Faults(tmp_path_factory.mktemp("faults"), 0)


@pytest.mark.slow(seconds=30)
@pytest.mark.parametrize(
    ("kind", "verb"),
    [("scheduler", INDEX), ("driver", INDEX), (FULL, INDEX), (STORE, INDEX), (SECOND, INDEX)],
)
def test_results_of_a_disturbed_run(faults, capsys, kind, verb) -> None:
    fleet_faults.run_faults(faults, [kind], [verb], times=1, outage_s=3.0)
    printed = capsys.readouterr().out.splitlines()
    verdicts = [line[:4] for line in printed if re.match("PASS|FAIL|-   ", line)]
    if kind == FULL and verdicts == ["-   "]:
        # Where no file system can be mounted, the script says so.
        assert any("mount" in line or "unshare" in line for line in printed), printed
        return
    (row,) = [line for line in printed if line.startswith(f"| {kind}")]
    _, _, times, _, _, compared, different, _, stored, _ = map(str.strip, row.split("|"))
    assert (times, different, stored) == ("1", "0", "0"), printed
    assert int(compared) > 0
    assert set(verdicts) == {"PASS"}, printed


def test_what_counts_as_done_twice(tmp_path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    dataset = FleetDataset(tmp_path / "out")
    works = {name: work_of("index", "inputs", name) for name in ("once", "killed", "again")}
    for name in ("once", "killed", "killed", "again"):
        (log / f"{works[name]}-1-{len(list(log.iterdir()))}").touch()
    dataset.append(
        "index", [{"recording": name, "inputs_hash": "inputs", "key": name} for name in works]
    )
    assert repeats_of(log, tmp_path / "out") == Repeats(started=1, stored=0)
    (log / f"{works['again']}-{2**62}-9").touch()
    assert repeats_of(log, tmp_path / "out") == Repeats(started=2, stored=1)


def test_a_logged_stage_has_the_keys_of_its_stage(tmp_path, monkeypatch) -> None:
    point, log = tmp_path / "point.json", tmp_path / "log"
    write_point(point, {"a": {"payload.mass": 120.0}}, [])
    log.mkdir()
    stage = EvidenceStage("", str(point))
    logged = LoggedStage(stage, str(log), 0.0, stage.name, stage.inputs_hash, stage.shared_paths)
    for name in ("a", "b"):
        assert version_of(logged).key("content", name) == version_of(stage).key("content", name)
    monkeypatch.setattr(EvidenceStage, "run", lambda *_: [])
    logged.run(tmp_path, "a")
    (started,) = (path.name.split("-")[0] for path in log.iterdir())
    row = {"recording": "a", "inputs_hash": version_of(stage).inputs_of("a"), "key": "k"}
    FleetDataset(tmp_path / "out").append(stage.name, [row])
    assert [work for work, _ in _stored(tmp_path / "out")] == [started]


def test_differences_of_rows() -> None:
    assert different_rows(Counter("aab"), Counter("baa")) == []
    assert different_rows(Counter("aab"), Counter("ab")) == ["a"]
    assert len(different_rows(Counter("aab"), Counter("aac"))) == 1
    assert different_rows(Counter("ab"), Counter("abcd")) == ["c", "d"]


def test_criteria_of_a_failed_run() -> None:
    good = Tally("worker killed, index", faults=1, ended=1, compared=9)
    assert {each.is_met for each in criteria_of([good])} == {True}
    bad = Tally("worker killed, index", 1, 0, 1, 9, 1, 2, 1, 0, ["exit code 2: adk: no"], "row")
    assert [each.line for each in criteria_of([bad])] == [
        "FAIL worker killed, index: 1 of 9 rows differ from the undisturbed run (the first: row)",
        "FAIL worker killed, index: 1 recordings are computed again after their result was stored",
        "FAIL worker killed, index: 1 runs have to be started again (exit code 2: adk: no)",
    ]
    left = Tally("driver killed, index", 1, 0, 1, 9, left=2)
    assert [each.is_met for each in criteria_of([left])] == [True, True, False]


def test_a_stage_that_keeps_recordings_does_so_while_it_is_logged(tmp_path) -> None:
    """Else kills would never meet what workers keep of a recording for further passes."""
    stage = EvidenceStage("simulation.npz")
    traced = LoggedKeepingStage(stage, str(tmp_path), 0.0, "evidence", "inputs", ())
    assert keeps_recordings(traced)
    of_content = traced.of_content("abc")
    assert of_content.stage == stage.of_content("abc")
    assert of_content.run_kept("a") is None
    assert list(tmp_path.iterdir()) == []


@dataclass(frozen=True)
class Kept(EvidenceStage):
    """A stage that has kept everything."""

    def run_kept(self, recording: str) -> list[dict[str, Any]]:
        return [{"kind": recording}]


def test_a_start_from_what_was_kept_is_logged(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(disturbed_runs, "version_of", lambda stage: StageVersion("", "", "inputs"))
    traced = LoggedKeepingStage(Kept(""), str(tmp_path), 0.0, "evidence", "inputs", ())
    assert traced.run_kept("a") == [{"kind": "a"}]
    (started,) = tmp_path.iterdir()
    assert started.name.startswith(work_of("evidence", "inputs", "a"))
