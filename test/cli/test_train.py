# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk train: several bags, the score table, JSON, the report, errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.train import bag, lines, refused, small

from adk_ros.bags import BagWriter, message
from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.train import network_fit

pytestmark = pytest.mark.usefixtures("one_candidate")

QUICK = ["--steps", "20", "--hidden", "8", "--history", "2", "--no-report"]


@pytest.mark.slow
def test_training_on_two_bags_prints_a_table_and_writes_a_report(capsys, tmp_path: Path) -> None:
    out = tmp_path / "models" / "m"
    bags = [str(bag("handling", 60.0)), str(bag("town", 30.0))]
    assert main(["train", *bags, "--out", str(out), *QUICK[:-1]]) == 0
    printed = capsys.readouterr()
    notes = lines(printed.err)
    for path, line in zip(bags, notes, strict=False):
        seconds = "60.0" if "handling" in path else "30.0"
        assert line == (
            f"{path}: imu /imu/data, odometry /odometry, command /vehicle/command; {seconds} s"
        )
    assert lines(printed.out)[0].startswith("RMSE on ")
    assert "persistence" in printed.out
    assert f"report: {out / 'report.html'}" in notes
    assert any(line.startswith("trained on 90 s of recordings in ") for line in notes)
    names = {path.name for path in out.iterdir()}
    assert names == {
        "manifest.json",
        "encoder.pt",
        "arrays.npz",
        "report.html",
        "held_out.json",
        "training.png",
        "horizon.png",
        "prediction.png",
    }
    data = artefact.load(out).manifest["training"]["data"]
    assert [item["name"] for item in data] == [Path(path).name for path in bags]


@pytest.mark.slow
def test_with_json_stdout_contains_only_json(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    assert main([*arguments, "--json", "--seed", "7"]) == 0
    printed = json.loads(capsys.readouterr().out)
    manifest = artefact.load(tmp_path / "m").manifest
    assert printed["model"] == str(tmp_path / "m")
    assert printed["seconds"] > 0.0
    assert {key: printed[key] for key in manifest["training"]} == manifest["training"]
    assert printed["settings"]["seed"] == 7
    assert (printed["settings"]["steps"], printed["settings"]["hidden"]) == (20, 8)
    assert set(printed["held_out"]["ratio_to_best_naive"]) == {"v_x", "v_y", "yaw_rate"}


@pytest.mark.slow
def test_an_interrupted_training_resumes(capsys, monkeypatch, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    monkeypatch.setattr(network_fit, "_CHECKPOINT_EVERY", 5)
    one_step = network_fit._Trainer.one_step

    def interrupted(trainer: network_fit._Trainer, step: int, stage: int, running: float) -> float:
        if step == 12:
            raise KeyboardInterrupt
        return one_step(trainer, step, stage, running)

    with monkeypatch.context() as patch:
        patch.setattr(network_fit._Trainer, "one_step", interrupted)
        assert main(arguments) == 130
    notes = capsys.readouterr().err
    assert "resuming" not in notes
    assert "the same command resumes from the last checkpoint" in notes
    assert main(arguments) == 0
    assert "resuming from training step 10, where training was interrupted" in lines(
        capsys.readouterr().err
    )
    assert "add --force to replace it" in refused(capsys, arguments, 2)
    assert main([*arguments[:-1], "--json", "--force"]) == 0
    assert "resuming" not in capsys.readouterr().err


@pytest.mark.slow
def test_without_the_imu(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    assert main([*arguments, "--no-imu", "--json"]) == 0
    printed = capsys.readouterr()
    assert "imu none (yaw rate from odometry)" in printed.err
    assert json.loads(printed.out)["data"][0]["imu"] is False
    assert artefact.load(tmp_path / "m").model.uses_imu is False


def test_training_as_in_the_paper(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), "--no-report"]
    assert "--epochs needs --paper" in refused(capsys, [*arguments, "--epochs", "1"], 2)
    arguments += ["--force"]
    without_effect = [*arguments, "--paper", "dk", "--steps", "9", "--hidden", "8"]
    assert "--steps, --hidden: no effect with --paper" in refused(capsys, without_effect, 2)
    assert main([*arguments, "--paper", "dk", "--epochs", "1", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["kind"] == "dk"
    assert printed["settings"]["hidden"] == 128
    assert artefact.load(tmp_path / "m").model.n_z == 15
    line = refused(capsys, [*arguments, "--no-imu", "--paper", "aldk", "--epochs", "1"], 3)
    assert "ALDK needs accelerations" in line


@pytest.mark.slow
def test_scalars_for_tensorboard(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    arguments[arguments.index("--steps") + 1] = "60"
    arguments += ["--tensorboard", str(tmp_path / "scalars")]
    assert main(arguments) == 0
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path / "scalars"))
    events.Reload()
    assert set(events.Tags()["scalars"]) == {"loss/train", "loss/validation", "learning_rate"}
    assert [event.step for event in events.Scalars("loss/train")][:2] == [20, 40]
    rates = [event.value for event in events.Scalars("learning_rate")]
    assert rates == sorted(rates, reverse=True)


def test_a_recording_of_five_seconds_is_refused(capsys, tmp_path: Path) -> None:
    line = refused(capsys, ["train", bag("town", 5.0), "--out", tmp_path / "m"], 3)
    assert "5 s of data are too short" in line
    assert not list(tmp_path.iterdir())


def without(path: Path, missing: str) -> Path:
    """Write a bag that lacks one topic."""
    types = {
        "/imu": "sensor_msgs/msg/Imu",
        "/odometry": "nav_msgs/msg/Odometry",
        "/command": "sensor_msgs/msg/JointState",
    }
    with BagWriter(path) as writer:
        for topic, kind in types.items():
            if topic != missing:
                writer.add_topic(topic, kind)
                for step in range(100):
                    at = 10**9 + 25_000_000 * step
                    writer.write(topic, message(kind, header={"stamp": at}), at)
    return path


NO_ODOMETRY = "no odometry: no topic of type nav_msgs/msg/Odometry"
NO_COMMAND = "no command: a rollout predicts with the recorded commands"


@pytest.mark.parametrize(
    ("verb", "missing", "text"),
    [
        ("train", "/odometry", NO_ODOMETRY),
        ("replay", "/odometry", NO_ODOMETRY),
        ("rollout", "/odometry", NO_ODOMETRY),
        ("rollout", "/command", NO_COMMAND),
    ],
)
def test_a_missing_topic_is_named(
    capsys, tmp_path: Path, verb: str, missing: str, text: str
) -> None:
    path = without(tmp_path / "b", missing)
    arguments = {
        "train": ["train", path, "--out", tmp_path / "m"],
        "replay": ["replay", path, "--model", small().path],
        "rollout": ["rollout", "--model", "imdv", "--bag", path, "--out", tmp_path / "r.csv"],
    }[verb]
    line = refused(capsys, arguments, 3)
    assert text in line
    assert str(path) in line


def test_refused_commands_are_reported_with_the_reason(capsys, tmp_path: Path) -> None:
    """All commands are refused because their joints have other names."""
    line = refused(capsys, ["train", without(tmp_path / "b", "-"), "--out", tmp_path / "m"], 3)
    assert "no usable command messages" in line
    assert "100 command messages refused: joint 'drive' is missing" in line
