# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk train, as a person runs it: several bags, the table, JSON, the report, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.train import bag, lines, refused, small

from adk_ros.bags import BagWriter, message
from adk_ros.cli.main import main
from adk_ros.model import artefact
from adk_ros.train import network_fit

QUICK = ["--steps", "20", "--hidden", "8", "--history", "2", "--no-report"]


def test_two_bags_a_table_and_a_report(capsys, tmp_path: Path) -> None:
    out = tmp_path / "models" / "m"
    bags = [str(bag("handling", 60.0)), str(bag("town", 30.0))]
    assert main(["train", *bags, "--out", str(out), *QUICK[:-1]]) == 0
    said = capsys.readouterr()
    told = lines(said.err)
    for path, line in zip(bags, told, strict=False):
        seconds = "60.0" if "handling" in path else "30.0"
        assert line == (
            f"{path}: imu /imu/data, odometry /odometry, command /vehicle/command; {seconds} s"
        )
    assert lines(said.out)[0].startswith("RMSE on ")
    assert "persistence" in said.out
    assert f"report: {out / 'report.html'}" in told
    assert any(line.startswith("trained on 90 s of driving in ") for line in told)
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


def test_json_is_all_there_is_on_stdout(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    assert main([*arguments, "--json", "--seed", "7"]) == 0
    told = json.loads(capsys.readouterr().out)
    manifest = artefact.load(tmp_path / "m").manifest
    assert told["model"] == str(tmp_path / "m")
    assert told["seconds"] > 0.0
    assert {key: told[key] for key in manifest["training"]} == manifest["training"]
    assert told["settings"]["seed"] == 7
    assert (told["settings"]["steps"], told["settings"]["hidden"]) == (20, 8)
    assert set(told["held_out"]["ratio_to_best_naive"]) == {"v_x", "v_y", "yaw_rate"}


def test_an_interrupted_training_goes_on(capsys, monkeypatch, tmp_path: Path) -> None:
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
    said = capsys.readouterr().err
    assert "going on" not in said
    assert "the same command goes on from the last checkpoint" in said
    assert main(arguments) == 0
    assert "going on from step 10, where it was interrupted" in lines(capsys.readouterr().err)
    assert "add --force to replace it" in refused(capsys, arguments, 2)
    assert main([*arguments[:-1], "--json", "--force"]) == 0
    assert "going on" not in capsys.readouterr().err


def test_without_the_imu(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    assert main([*arguments, "--no-imu", "--json"]) == 0
    said = capsys.readouterr()
    assert "imu none (yaw rate from odometry)" in said.err
    assert json.loads(said.out)["data"][0]["imu"] is False
    assert artefact.load(tmp_path / "m").model.uses_imu is False


def test_the_papers_way(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), "--no-report"]
    assert "--epochs is for --paper" in refused(capsys, [*arguments, "--epochs", "1"], 2)
    arguments += ["--force"]
    assert main([*arguments, "--paper", "dk", "--epochs", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "dk"
    assert told["settings"]["hidden"] == 128
    assert artefact.load(tmp_path / "m").model.n_z == 15
    line = refused(capsys, [*arguments, "--no-imu", "--paper", "aldk", "--epochs", "1"], 3)
    assert "ALDK needs accelerations" in line


def test_scalars_for_tensorboard(capsys, tmp_path: Path) -> None:
    arguments = ["train", str(bag("handling", 60.0)), "--out", str(tmp_path / "m"), *QUICK]
    arguments += ["--steps", "60", "--tensorboard", str(tmp_path / "scalars")]
    assert main(arguments) == 0
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path / "scalars"))
    events.Reload()
    assert set(events.Tags()["scalars"]) == {"loss/train", "loss/validation", "learning_rate"}
    assert [event.step for event in events.Scalars("loss/train")][:2] == [20, 40]
    rates = [event.value for event in events.Scalars("learning_rate")]
    assert rates == sorted(rates, reverse=True)


def test_five_seconds_are_not_enough(capsys, tmp_path: Path) -> None:
    line = refused(capsys, ["train", bag("town", 5.0), "--out", tmp_path / "m"], 3)
    assert "5 s of data are too short" in line
    assert not list(tmp_path.iterdir())


def without(path: Path, missing: str) -> Path:
    kinds = {
        "/imu": "sensor_msgs/msg/Imu",
        "/odometry": "nav_msgs/msg/Odometry",
        "/command": "sensor_msgs/msg/JointState",
    }
    with BagWriter(path) as writer:
        for topic, kind in kinds.items():
            if topic != missing:
                writer.add_topic(topic, kind)
                for step in range(100):
                    at = 10**9 + 25_000_000 * step
                    writer.write(topic, message(kind, header={"stamp": at}), at)
    return path


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ("/odometry", "no odometry: no topic of type nav_msgs/msg/Odometry"),
        ("/command", "no command: no topic of type sensor_msgs/msg/JointState"),
    ],
)
@pytest.mark.parametrize("verb", ["train", "replay", "rollout"])
def test_a_topic_that_is_missing_is_named(
    capsys, tmp_path: Path, verb: str, missing: str, said: str
) -> None:
    path = without(tmp_path / "b", missing)
    arguments = {
        "train": ["train", path, "--out", tmp_path / "m"],
        "replay": ["replay", path, "--model", small().path],
        "rollout": ["rollout", "--model", "imdv", "--bag", path, "--out", tmp_path / "r.csv"],
    }[verb]
    line = refused(capsys, arguments, 3)
    assert said in line
    assert str(path) in line


def test_a_bag_of_refused_commands_says_why(capsys, tmp_path: Path) -> None:
    """The joints have other names: no sample can come of it, and the reason is in the line."""
    line = refused(capsys, ["train", without(tmp_path / "b", "-"), "--out", tmp_path / "m"], 3)
    assert "no usable command messages" in line
    assert "100 command messages refused: joint 'drive' is missing" in line
