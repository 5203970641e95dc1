# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk info on bags, models, and paths that are neither."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.train import bag, lines, refused, small, small_without_imu

from adk_ros.api import model as api_model
from adk_ros.bags import Bag, BagWriter, message
from adk_ros.bags.recording import RecordingOptions
from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.model.manifest import MANIFEST
from adk_ros.model.pipeline import PipelineSettings
from adk_ros.model.stored_model import ARRAYS, ENCODER
from adk_ros.model.uncertainty.fallback import Fallback
from adk_ros.offline.replay import TWIST_TOPIC, TWIST_TYPE, ReplayOutput, replay


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run `adk info` and return its output."""
    assert main(["info", *map(str, arguments)]) == 0
    result = capsys.readouterr()
    # A slow machine also sees the progress.
    assert [line for line in lines(result.err) if not line.startswith("reading ")] == []
    return result.out


def test_a_bag_as_text(capsys) -> None:
    head, *rest, verdict = lines(printed(capsys, bag()))
    topics, table = rest[:3], rest[3:]
    assert head.startswith(f"bag {bag()}: 30.0 s, ")
    assert verdict.strip() == "usable for training and replay"
    assert any("predict v_x" in line and "training needs 60 s" in line for line in table)
    found = {}
    for line in topics:
        name, kind, count, rate, unit, role = line.split()
        found[name] = (kind, int(count), float(rate), unit, role)
    assert found["/imu/data"][0] == "sensor_msgs/msg/Imu"
    assert found["/imu/data"][2] == pytest.approx(200.0, rel=0.01)
    assert found["/odometry"][4] == "odometry"
    assert found["/vehicle/command"][3:] == ("Hz", "command")
    # The counts are right-aligned.
    ends = {
        line.index(str(found[line.split()[0]][1])) + len(str(found[line.split()[0]][1]))
        for line in topics
    }
    assert len(ends) == 1


def test_a_bag_is_read_once(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    """Further messages are those that choose topics: the first ones of a topic."""
    read = 0
    messages = Bag.messages

    def counted(
        self: Bag, topics: Collection[str] | None = None
    ) -> Iterator[tuple[str, int, Any]]:
        nonlocal read
        for each in messages(self, topics):
            read += 1
            yield each

    monkeypatch.setattr(Bag, "messages", counted)
    about = json.loads(printed(capsys, bag(), "--json"))
    assert about["messages"] <= read <= about["messages"] + 20


def test_a_bag_as_json(capsys) -> None:
    about = json.loads(printed(capsys, bag(), "--json"))
    assert about["kind"] == "bag"
    assert about["seconds"] == pytest.approx(30.0, abs=0.1)
    assert about["messages"] == sum(topic["count"] for topic in about["topics"])
    assert about["used_as"] == {
        "imu": "/imu/data",
        "odometry": "/odometry",
        "command": "/vehicle/command",
    }
    assert about["warnings"] == []
    scope = {row["name"]: row["possible"] for row in about["scope"]}
    assert scope["predict v_x"] == "reduced"
    assert scope["grade"] == "yes"


def test_a_bag_without_an_imu(capsys) -> None:
    text = printed(capsys, bag("town", 30.0, imu=False))
    assert "usable for training and replay (no IMU: yaw rate from odometry)" in text


def test_a_short_bag_is_not_called_usable(capsys) -> None:
    text = printed(capsys, bag("town", 11.0))
    assert "not usable for training or replay: the car moves for 11 s only" in text


def test_an_unusable_bag_is_described(capsys, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic(TWIST_TOPIC, TWIST_TYPE)
        writer.write(TWIST_TOPIC, message(TWIST_TYPE), 10**9)
    text = printed(capsys, tmp_path / "b")
    assert TWIST_TOPIC in text
    assert "not usable for training or replay: " in lines(text)[-1]
    about = json.loads(printed(capsys, tmp_path / "b", "--json"))
    assert about["used_as"] == {}
    assert about["topics"][0]["rate_hz"] is None


@pytest.mark.slow
def test_a_model_as_text(capsys) -> None:
    text = printed(capsys, small().path)
    test = small().run.test
    assert test is not None
    assert lines(text)[0] == f"model {small().path}: complete, hashes match"
    assert "handling (120 s)" in text
    assert "25 ms" in text
    assert "3 past samples -> lifted state of 11" in text
    assert "method windowed" in text
    assert "yaw rate    gyro" in text
    assert f"RMSE {test.as_json()['geometric_mean_ratio']:.3f} of the best naive" in text
    assert "odometry (trained without an IMU)" in printed(capsys, small_without_imu())


@pytest.mark.slow(seconds=15)
def test_a_model_says_which_naive_predictors_take_over(capsys, tmp_path: Path) -> None:
    loaded = artefact.load(small().path)
    weights = np.zeros((2, 3, 80, 3))
    weights[0, 2, :20, 0] = 0.75
    program = (small().path / ENCODER).read_bytes()
    for given in (weights, 0.0 * weights):
        model = replace(loaded.model, fallback=Fallback(given))
        artefact.save(tmp_path / "m", program, model, {})
        found = [
            line for line in lines(printed(capsys, tmp_path / "m")) if line.startswith("  naive ")
        ]
        if given.any():
            assert found == [
                "  naive       v_x, commands known: IMU integration, weight 0.75 at 0.025 s, 0.75 "
                "at 0.25 s, 0.75 at 0.5 s"
            ]
        else:
            assert found == []


def test_a_model_as_json(capsys) -> None:
    about = json.loads(printed(capsys, small().path, "--json"))
    manifest = json.loads((small().path / MANIFEST).read_text())
    assert about == {"kind": "model", "path": str(small().path)} | manifest


def test_a_model_without_training_facts(capsys, tmp_path: Path) -> None:
    loaded = artefact.load(small().path)
    program = (small().path / ENCODER).read_bytes()
    artefact.save(tmp_path / "m", program, loaded.model, {})
    assert "kind        unknown" in printed(capsys, tmp_path / "m")


def test_other_files_are_refused_in_one_line(capsys, tmp_path: Path) -> None:
    notes, noise, empty = tmp_path / "notes.txt", tmp_path / "noise.mcap", tmp_path / "empty"
    notes.write_text("not a bag")
    noise.write_bytes(bytes(range(256)) * 40)
    empty.mkdir()
    no_content = tmp_path / "no_content.db3"
    no_content.touch()
    for path in (notes, noise, empty, no_content):
        assert main(["info", str(path)]) in (2, 3)
        result = capsys.readouterr()
        assert result.out == ""
        assert len(lines(result.err)) == 1
        assert result.err.startswith("adk: ")
        assert path.name in result.err


@pytest.mark.parametrize("name", [ENCODER, ARRAYS])
def test_a_damaged_model_is_refused(capsys, tmp_path: Path, name: str) -> None:
    path = tmp_path / "m"
    shutil.copytree(small().path, path)
    content = (path / name).read_bytes()
    (path / name).write_bytes(content[:-1])
    assert name in refused(capsys, ["info", path], 2)
    (path / name).unlink()
    assert "cannot be read" in refused(capsys, ["info", path], 2)


def test_a_bag_of_predictions_is_described(capsys, tmp_path: Path) -> None:
    model = artefact.load(small().path).model
    replay(bag(), model, PipelineSettings(), RecordingOptions(), ReplayOutput(tmp_path / "p"))
    assert main(["info", str(tmp_path / "p")]) == 0
    text = capsys.readouterr().out
    assert TWIST_TOPIC in text
    assert lines(text)[-1].strip() == (
        "usable for training and replay (no IMU: yaw rate from odometry); v_x, v_y and yaw rate "
        "can only be predicted in reduced scope: the recording has no command"
    )


def test_a_bag_is_described_without_importing_pytorch() -> None:
    """PyTorch takes seconds to import and only models need it."""
    script = (
        "import sys\n"
        "from adk_ros.cli.main import main\n"
        f"code = main(['info', {str(bag())!r}])\n"
        "print(code, 'torch' in sys.modules)"
    )
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert process.stdout.splitlines()[-1] == "0 False"


def test_the_manifest_of_a_model_has_the_name_that_info_looks_for() -> None:
    assert api_model.MANIFEST == MANIFEST
    assert api_model.is_model_folder(small().path)
    assert not api_model.is_model_folder(bag())
