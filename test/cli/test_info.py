# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk info: on bags, models, and what is neither."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from helpers.train import bag, lines, refused, small, small_without_imu

from adk_ros.bags import BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.offline.replay import TWIST_TOPIC, TWIST_TYPE, replay


def told(capsys, *arguments: object) -> str:
    assert main(["info", *map(str, arguments)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return said.out


def test_a_bag_for_people(capsys) -> None:
    head, *topics, verdict = lines(told(capsys, bag()))
    assert head.startswith(f"bag {bag()}: 30.0 s, ")
    assert verdict.strip() == "can be trained on and replayed"
    found = {}
    for line in topics:
        name, kind, count, rate, unit, role = line.split()
        found[name] = (kind, int(count), float(rate), unit, role)
    assert found["/imu/data"][0] == "sensor_msgs/msg/Imu"
    assert found["/imu/data"][2] == pytest.approx(200.0, rel=0.01)
    assert found["/odometry"][4] == "odometry"
    assert found["/vehicle/command"][3:] == ("Hz", "command")
    # Columns: the counts end at the same place.
    ends = {
        line.index(str(found[line.split()[0]][1])) + len(str(found[line.split()[0]][1]))
        for line in topics
    }
    assert len(ends) == 1


def test_a_bag_for_programs(capsys) -> None:
    about = json.loads(told(capsys, bag(), "--json"))
    assert about["kind"] == "bag"
    assert about["seconds"] == pytest.approx(30.0, abs=0.1)
    assert about["messages"] == sum(topic["count"] for topic in about["topics"])
    assert about["used_as"] == {
        "imu": "/imu/data",
        "odometry": "/odometry",
        "command": "/vehicle/command",
    }
    assert about["warnings"] == []


def test_a_bag_without_an_imu(capsys) -> None:
    said = told(capsys, bag("town", 20.0, imu=False))
    assert "can be trained on and replayed (no IMU: yaw rate from odometry)" in said


def test_a_bag_that_is_of_no_use_is_still_described(capsys, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic(TWIST_TOPIC, TWIST_TYPE)
        writer.write(TWIST_TOPIC, message(TWIST_TYPE), 10**9)
    said = told(capsys, tmp_path / "b")
    assert TWIST_TOPIC in said
    assert "cannot be trained on or replayed: " in lines(said)[-1]
    about = json.loads(told(capsys, tmp_path / "b", "--json"))
    assert about["used_as"] == {}
    assert about["topics"][0]["rate_hz"] is None


def test_a_model_for_people(capsys) -> None:
    said = told(capsys, small().path)
    test = small().run.test
    assert test is not None
    assert lines(said)[0] == f"model {small().path}: whole, hashes fit"
    assert "handling (120 s)" in said
    assert "25 ms" in said
    assert "3 past samples -> lifted state of 11" in said
    assert "method windowed" in said
    assert "yaw rate    gyro" in said
    assert f"RMSE {test.as_json()['geometric_mean_ratio']:.3f} of the best naive" in said
    assert "odometry (trained without an IMU)" in told(capsys, small_without_imu())


def test_a_model_for_programs(capsys) -> None:
    about = json.loads(told(capsys, small().path, "--json"))
    manifest = json.loads((small().path / artefact.MANIFEST).read_text())
    assert about == {"kind": "model", "path": str(small().path)} | manifest


def test_a_model_of_the_papers_kind_or_without_facts(capsys, tmp_path: Path) -> None:
    loaded = artefact.load(small().path)
    program = (small().path / artefact.ENCODER).read_bytes()
    artefact.save(tmp_path / "m", program, loaded.model, {})
    assert "trained as  unknown" in told(capsys, tmp_path / "m")


def test_garbage_is_refused_in_one_line(capsys, tmp_path: Path) -> None:
    text, noise, empty = tmp_path / "notes.txt", tmp_path / "noise.mcap", tmp_path / "empty"
    text.write_text("not a bag")
    noise.write_bytes(bytes(range(256)) * 40)
    empty.mkdir()
    nothing = tmp_path / "nothing.db3"
    nothing.touch()
    for path in (text, noise, empty, nothing):
        assert main(["info", str(path)]) in (2, 3)
        said = capsys.readouterr()
        assert said.out == ""
        assert len(lines(said.err)) == 1
        assert said.err.startswith("adk: ")
        assert path.name in said.err


@pytest.mark.parametrize("name", [artefact.ENCODER, artefact.ARRAYS])
def test_a_damaged_model_is_refused(capsys, tmp_path: Path, name: str) -> None:
    path = tmp_path / "m"
    shutil.copytree(small().path, path)
    content = (path / name).read_bytes()
    (path / name).write_bytes(content[:-1])
    assert name in refused(capsys, ["info", path], 2)
    (path / name).unlink()
    assert "cannot be read" in refused(capsys, ["info", path], 2)


def test_what_replay_writes_is_described(capsys, tmp_path: Path) -> None:
    model = artefact.load(small().path).model
    replay(bag(), model, PipelineSettings(), RecordingOptions(), tmp_path / "p")
    said = told(capsys, tmp_path / "p")
    assert TWIST_TOPIC in said
    assert "no topic of type sensor_msgs/msg/JointState" in lines(said)[-1]
