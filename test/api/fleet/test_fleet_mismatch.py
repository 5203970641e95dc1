# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evidence of a fleet: rows in the dataset, tags, the point of linearisation, the truth."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adk_ros.api.fleet.evidence_stage import (
    EvidenceStage,
    evidence_row,
    evidence_text,
    read_point,
    write_point,
)
from adk_ros.api.fleet.fleet_demo import read_truth
from adk_ros.api.fleet.fleet_evidence import CurrentEvidence, point_file
from adk_ros.api.fleet.fleet_mismatch import fleet_mismatch, recording_tags
from adk_ros.api.fleet.fleet_run import FleetOptions, chosen_recordings
from adk_ros.api.fleet.identified_simulation import _tried
from adk_ros.api.fleet.recording_minutes import recording_minutes
from adk_ros.errors import DataError, UsageError
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.inference.evidence import RECORDING, Columns, Row
from adk_ros.fleet.inference.linearisation_point import rounded_values
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.recording_evidence import PlacedValue
from adk_ros.fleet.recording_work import run_on_recording
from adk_ros.fleet.recordings import FleetRecording, find_recordings
from adk_ros.fleet.run import Limits
from adk_ros.fleet.stage import StageVersion, version_of
from adk_ros.fleet.store import file_system
from adk_ros.fleet.tags import Tags
from adk_ros.mismatch.recording.sensor_log import SensorLog


def test_evidence_survives_the_dataset() -> None:
    row = {"kind": RECORDING, "score": b"\x00\x01\xff", "counted_s": 1.5, "recording": "a"}
    back = evidence_row(evidence_text(row), "cars/b")
    assert back == row | {"recording": "cars/b"}


def test_a_recording_is_linearised_at_its_own_values(tmp_path: Path) -> None:
    path = tmp_path / "point.json"
    cell = Cell.of_text("3/-2/1")
    placed = PlacedValue("road_grade.grade", (cell,), 0.05)
    write_point(path, {"b": {"payload.mass": 120.0}, "a": {}}, [placed])
    assert read_point(str(path), "b") == ({"payload.mass": 120.0}, [placed])
    assert read_point(str(path), "other") == ({}, [placed])
    assert read_point("", "b") == ({}, [])


def a_log() -> SensorLog:
    times, three, two = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 2))
    return SensorLog("drive", 1.0, times, three, times, three, three, times, two)


def test_a_recording_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag, logs = tmp_path / "drive.mcap", tmp_path / "logs"
    bag.write_bytes(b"drive")
    logs.mkdir()
    decoded: list[Path] = []

    def read_log(path: Path, *_: object, **__: object) -> SensorLog:
        decoded.append(path)
        return a_log()

    def evidence_rows(log: SensorLog, *_: object, **__: object) -> list[Row]:
        assert (log.name, log.imu.shape) == ("drive", (3, 3))
        return [{"kind": RECORDING, "loss_ratio": 1.0}]

    simulation = SimpleNamespace(surrogate=SimpleNamespace(parameters=np.ones(100)))
    monkeypatch.setattr("adk_ros.api.recording.read_log", read_log)
    monkeypatch.setattr("adk_ros.api.fleet.evidence_stage._simulation", lambda *_: simulation)
    monkeypatch.setattr("adk_ros.fleet.inference.recording_evidence.evidence_rows", evidence_rows)
    stage = EvidenceStage("", logs=str(logs))
    assert stage.inputs_hash == EvidenceStage("").inputs_hash
    (recording,) = find_recordings([str(bag)])
    rows = [run_on_recording(stage, recording, (), "1") for _ in range(2)]
    assert rows[0] == rows[1]
    assert decoded == [bag]
    # A file that is cut off, other options, another content: decoded again.
    (kept,) = logs.iterdir()
    kept.write_bytes(kept.read_bytes()[:50])
    run_on_recording(stage, recording, (), "1")
    run_on_recording(replace(stage, without_imu=True), recording, (), "1")
    run_on_recording(stage, recording, (), "2")
    assert len(decoded) == 4
    for nowhere in ("", str(tmp_path / "none")):
        run_on_recording(replace(stage, logs=nowhere), recording, (), "1")
    run_on_recording(stage, recording)
    assert len(decoded) == 7
    bag.write_bytes(b"while it is read")
    with pytest.raises(UsageError, match="has changed while it was read"):
        run_on_recording(stage, recording, (), "1")


def test_what_is_decoded_is_not_copied_from_a_store_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, _ = file_system("memory://kept")
    memory.pipe("/kept/a.mcap", b"drive")
    (recording,) = find_recordings(["memory://kept"])
    copied: list[str] = []

    def copy(system: object, name: str, target: Path) -> None:
        copied.append(name)
        target.write_bytes(b"drive")

    monkeypatch.setattr("adk_ros.fleet.recordings._copy_file", copy)
    monkeypatch.setattr("adk_ros.api.recording.read_log", lambda *_, **__: a_log())
    monkeypatch.setattr(EvidenceStage, "_rows", lambda *_: [])
    monkeypatch.setattr(EvidenceStage, "_identified", lambda _: None)
    monkeypatch.setattr("adk_ros.api.fleet.evidence_stage._wheel_radius", lambda _: 0.3)
    for _ in range(3):
        run_on_recording(EvidenceStage("", logs=str(tmp_path)), recording, (), "1")
    assert copied == ["/kept/a.mcap"]


def test_another_point_is_another_result(tmp_path: Path) -> None:
    simulation, point = tmp_path / "simulation.npz", tmp_path / "point.json"
    simulation.write_bytes(b"1")

    def keys(point: Path | None = None) -> list[str]:
        version = version_of(EvidenceStage(str(simulation), "" if point is None else str(point)))
        return [version.key("content", name) for name in ("a", "b")]

    without = keys()
    found = {without[0]}
    for mass in (1.0, 2.0):
        write_point(point, {"a": {"payload.mass": mass}, "b": {}}, [])
        found.add(keys(point)[0])
        # Nothing acts in this one: it is linearised without effects already.
        assert keys(point)[1] == without[1]
    write_point(point, {}, [PlacedValue("road_grade.grade", (Cell.of_text("3/-2/1"),), 0.05)])
    found |= {*keys(point)}
    simulation.write_bytes(b"2")
    found.add(keys()[0])
    assert len(found) == 5


def test_a_further_drive_leaves_the_others_where_they_were_linearised(tmp_path: Path) -> None:
    def estimate(drag: float, names: list[str]) -> Any:
        return SimpleNamespace(
            fleet=SimpleNamespace(names=names),
            point_of=lambda name: rounded_values(
                {"aero_drag.cda": drag, "payload.mass": 0.001}, Columns(0, ())
            ),
            local_values=list,
        )

    def key(drag: float, names: list[str]) -> str:
        stage = EvidenceStage("", point_file(tmp_path, estimate(drag, names)))
        return version_of(stage).key("content", "a")

    before = key(0.5003, ["a", "b"])
    assert key(0.5009, ["a", "b", "c"]) == before
    assert key(0.6, ["a", "b", "c"]) != before
    assert point_file(tmp_path, None) == ""


def test_evidence_that_no_run_uses_again_is_removed(tmp_path: Path) -> None:
    (tmp_path / "s.npz").write_bytes(b"1")
    stage = EvidenceStage(str(tmp_path / "s.npz"))
    version = version_of(stage)
    found = [FleetRecording(name, f"/{name}", (), 1, "") for name in ("a", "b")]
    dataset = FleetDataset(tmp_path)
    dataset.append_hashes(
        [{"uri": x.uri, "version": x.version, "content_hash": x.name} for x in found]
    )

    details = evidence_text({"kind": RECORDING})

    def row(name: str, finding: str, at: StageVersion = version) -> dict[str, str]:
        return {
            "status": "ok",
            "content_hash": name,
            "details": details,
            "recording": name,
            "finding": finding,
            "key": at.key(name, name),
            "code_version": at.code_version,
            "inputs_hash": at.inputs_of(name),
        }

    elsewhere = replace(version, recording_inputs=lambda name: "another point")
    dataset.append(stage.name, [row(x, "current") for x in ("a", "b")])
    dataset.append(stage.name, [row("a", "superseded", elsewhere), row("c", "kept", elsewhere)])
    dataset.append(stage.name, [row("a", "old", replace(version, code_version="old"))])
    dataset.append(stage.name, [row("a", "kept", replace(version, inputs_hash="simulation 2"))])
    CurrentEvidence(tmp_path).prune()
    assert len(dataset.rows(stage.name)) == 6
    current = CurrentEvidence(tmp_path)
    current.of(stage, found)
    current.prune()
    left = [(x["recording"], x["finding"]) for x in dataset.rows(stage.name)]
    assert sorted(left) == [("a", "current"), ("a", "kept"), ("b", "current"), ("c", "kept")]


def test_days_count_from_the_first_recording() -> None:
    rows = [
        {"kind": RECORDING, "recording": "a", "start_ns": 86_400 * 10**9 * 10},
        {"kind": RECORDING, "recording": "b", "start_ns": 0},
        {"kind": "place", "recording": "b", "start_ns": 0},
    ]
    tags = {"b": Tags("car", 86_400.0 * 12, {"tyres": "worn"})}
    found = recording_tags(rows, tags)
    assert (found["a"].car, found["a"].day) == ("a", 0.0)
    assert (found["b"].car, found["b"].day, found["b"].tags) == ("car", 2.0, {"tyres": "worn"})


def test_only_results_of_the_stage_are_combined(tmp_path: Path) -> None:
    (tmp_path / "s.npz").write_bytes(b"1")
    stage = EvidenceStage(str(tmp_path / "s.npz"))
    version = version_of(stage)
    names = ("good", "stale", "other", "changed", "renamed", "bad", "good again")
    found = [FleetRecording(name, f"/{name}", (), 1, "") for name in names]
    dataset = FleetDataset(tmp_path)
    dataset.append_hashes(
        [
            {"uri": x.uri, "version": x.version, "content_hash": f"that of {x.name.split()[0]}"}
            for x in found
        ]
    )
    text = evidence_text({"kind": RECORDING, "recording": "x"})

    def row(name: str, content: str = "", at: StageVersion = version) -> dict[str, object]:
        content = content or f"that of {name}"
        key: dict[str, object] = {"key": at.key(content, name), "content_hash": content}
        return {"recording": name, "status": "ok", "details": text} | key

    dataset.append(
        stage.name,
        [
            row("good"),
            row("stale", at=replace(version, code_version="old")),
            row("other", at=replace(version, inputs_hash="another point")),
            row("changed", "before"),
            row("changed"),
            # What it was before, and what another recording is now.
            row("renamed", "that of good"),
            row("of an earlier run"),
            row("bad") | {"status": "failed", "reason": "too short"},
            # A copy is no further evidence.
            row("good again", "that of good"),
        ],
    )
    rows, failed = CurrentEvidence(tmp_path).of(stage, found)
    assert [each["recording"] for each in rows] == ["changed", "good"]
    assert failed == {
        "bad": "too short",
        "good again": "has the content of good",
        **dict.fromkeys(("stale", "other", "renamed"), "has no evidence"),
    }


def test_unusable_input_is_one_line(tmp_path: Path) -> None:
    drives = tmp_path / "drives"
    drives.mkdir()
    (drives / "a.mcap").write_bytes(b"no bag")
    given = [str(drives)]
    with pytest.raises(UsageError, match=r"--simulation .*sim does not exist"):
        fleet_mismatch(tmp_path / "sim", given, tmp_path / "out")
    bag = drives / "a.mcap"
    for further, problem in ((tmp_path / "route", "does not exist"), (bag, "is given already")):
        with pytest.raises(UsageError, match=f"--further-simulation .*{further.name} {problem}"):
            fleet_mismatch(bag, given, tmp_path / "out", further_simulations=[further])
    with pytest.raises(DataError, match=r"a\.mcap"):
        fleet_mismatch(drives / "a.mcap", given, tmp_path / "out")


def test_the_truth_of_an_earlier_version_is_a_line(tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps({"effects": [], "place": {"effect": "road_grade"}}))
    with pytest.raises(DataError, match=r"truth\.json: written by an earlier version"):
        read_truth(truth, seed=0, quick=True)


@pytest.mark.parametrize(("seed", "quick"), [(0, False), (3, True)])
def test_a_demonstration_of_another_fleet_needs_another_folder(
    tmp_path: Path, seed: int, quick: bool
) -> None:
    truth = tmp_path / "truth.json"
    (tmp_path / "simulation_routes").mkdir()
    place = {"effect": "road_grade", "path": [[0.0, 0.0]]}
    truth.write_text(json.dumps({"seed": 0, "drives": 48, "effects": [], "place": place}))
    assert read_truth(truth, seed=0, quick=True)["drives"] == 48
    with pytest.raises(UsageError, match=r"has 48 drives of seed 0, not (200|48) of seed [03]: "):
        read_truth(truth, seed=seed, quick=quick)


@pytest.mark.parametrize(
    ("timeout_s", "reason"), [(600.0, "neither MCAP"), (1e-3, "takes longer than 0.001 s")]
)
def test_no_usable_recording_says_why(
    timeout_s: float, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The typical recording is decoded in another process, within the limits of the stages."""
    monkeypatch.setattr(
        "adk_ros.api.fleet.identified_simulation.read_log", lambda *args, **given: None
    )
    drives, simulation = tmp_path / "drives", tmp_path / "simulation"
    drives.mkdir()
    simulation.mkdir()
    (drives / "a.mcap").write_bytes(b"no bag")
    options = FleetOptions(limits=Limits(timeout_s=timeout_s))
    with pytest.raises(DataError, match=rf"none of 1 recordings .* a.mcap: .*{reason}"):
        fleet_mismatch(simulation, [str(drives)], tmp_path / "out", options=options)
    assert not (tmp_path / "out" / ".typical.npz").exists()


def test_what_is_tried_is_spread_over_the_fleet() -> None:
    few = [FleetRecording(f"{i}", f"{i}", (), 0, "") for i in range(12)]
    assert _tried(few) == few
    many = [FleetRecording(f"{i}", f"{i}", (), 0, "") for i in range(1010)]
    tried = [int(each.name) for each in _tried(many)]
    assert tried == [*range(10), *range(60, 1010, 100)]


def test_workers_of_other_folders_find_the_files_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    estimate = SimpleNamespace(
        fleet=SimpleNamespace(names=["a.mcap"]),
        point_of=lambda name: {"payload.mass": 120.0},
        local_values=list,
    )
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives" / "a.mcap").write_bytes(b"no bag")
    (tmp_path / "simulation").mkdir()
    stages = []

    def identified(inputs: object, found: object, out: Path, *_: object) -> Path:
        return out / "simulation-1.npz"

    def run_stage(stage: EvidenceStage, *_: object) -> None:
        stages.append(stage)

    def analyse(evidence_at: Callable[..., object], *_: object) -> None:
        evidence_at(estimate, None)
        raise RuntimeError("ended")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("adk_ros.api.fleet.fleet_mismatch.identified_simulation", identified)
    monkeypatch.setattr("adk_ros.api.fleet.fleet_mismatch.run_stage", run_stage)
    monkeypatch.setattr("adk_ros.fleet.inference.analysis.analyse_fleet", analyse)
    monkeypatch.setattr(
        "adk_ros.fleet.inference.fleet_simulation.FleetSimulation.load", lambda path: None
    )
    options = FleetOptions(cluster="tcp://nowhere:1")
    with pytest.raises(RuntimeError, match="ended"):
        fleet_mismatch("simulation", ["drives"], "out", options=options)
    (stage,) = stages
    assert stage.simulation == str(tmp_path / "out" / "simulation-1.npz")
    assert Path(stage.point).parent == tmp_path / "out"
    assert stage.shared_paths == (stage.simulation, stage.point, stage.logs)
    assert Path(stage.logs) == tmp_path / "out" / "logs"
    assert Path(stage.logs).is_dir()


def test_a_limit_chooses_the_same_recordings_for_all_passes() -> None:
    found = [FleetRecording(f"car_{i // 10}/{i}", "", (), 1, "") for i in range(40)]
    assert chosen_recordings(found, None) == chosen_recordings(found, 99) == found
    few, more = (chosen_recordings(found, count) for count in (6, 12))
    assert (len(few), len(more)) == (6, 12)
    assert set(few) < set(more)
    assert few == [each for each in found if each in few]
    assert len({each.name.partition("/")[0] for each in more}) == 4


def test_minutes_of_recordings(tmp_path: Path) -> None:
    dataset = FleetDataset(tmp_path)
    found = [FleetRecording(f"{i}", f"memory://x/{i}", (), 500, "") for i in range(4)]
    assert recording_minutes(found, dataset) is None
    row = {"recording": "0", "kind": "content", "finding": "duration", "value": 60.0}
    dataset.append("index", [row | {"bytes": 1000}])
    assert recording_minutes(found, dataset) == pytest.approx(2.0)
