# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk fleet train: shards, parts by vehicle, what is refused, and a training by workers."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.fleet_results import filled
from helpers.train import bag, leave_one_candidate, refused

from adk_ros.api.fleet import training_data
from adk_ros.api.fleet.fleet_run import FleetOptions
from adk_ros.api.fleet.fleet_training import train_fleet
from adk_ros.api.fleet.lost_files import forget_lost_files
from adk_ros.api.fleet.training_data import (
    FleetTrainingOptions,
    fleet_training_data,
    joined_records,
    shard_stage,
    split_of,
)
from adk_ros.cli.main import main
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.train.dataset import TEST, TRAIN, VALIDATION

CARS = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Return a folder of four cars' recordings, a copy of one under another car, and a damaged."""
    folder = tmp_path_factory.mktemp("drives")
    lines = ["recording,vehicle,time,rain"]
    for number, car in enumerate(CARS):
        shutil.copytree(bag("town", 60.0 + 5.0 * number), folder / f"of_{car}")
        lines.append(f"of_{car},{car},,{'yes' if car in 'ab' else 'no'}")
    shutil.copytree(bag("town", 60.0), folder / "same_as_a")
    (folder / "bad.mcap").write_text("no bag")
    lines += ["same_as_a,d,,no", "bad.mcap,a,,no"]
    (folder / "fleet.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def shards(drives, tmp_path_factory):
    """Return a folder with the shards of the drives, written once."""
    folder = tmp_path_factory.mktemp("shards")
    filled(drives, folder, shard_stage(folder, FleetTrainingOptions()))
    return folder


@pytest.fixture
def out(shards, tmp_path):
    """Return a folder with the shards of the drives, to change."""
    return Path(shutil.copytree(shards, tmp_path / "out"))


def chosen(drives, out, **more):
    training = FleetTrainingOptions(**more)
    # Nothing to compute: the cluster is not opened.
    return fleet_training_data(
        [str(drives)], out, 0, training, FleetOptions(cluster="tcp://nowhere:1")
    )


def test_no_vehicle_is_in_two_parts(drives, out) -> None:
    data = chosen(drives, out)
    assert sorted((*data.split.train, *data.split.validation, *data.split.test)) == list(CARS)
    shards = [
        {block.shard for block in blocks}
        for blocks in (data.windows.window(0) + data.windows.window(1), data.validation, data.test)
    ]
    assert sum(map(len, shards)) == len(set.union(*shards)) == 4
    assert data.failed["same_as_a"] == "has the content of of_a"
    assert set(data.failed) == {"bad.mcap", "same_as_a"}
    windows = data.as_dict()["conditions"]
    assert {name.partition("; ")[2] for name in windows} <= {"rain yes", "rain no"}


def test_a_recording_trains_as_it_is_now(drives, out, tmp_path) -> None:
    """A recording that has changed would train with both contents, or be called a copy."""
    folder = tmp_path / "changed"
    shutil.copytree(drives, folder)
    for name, source in (("of_a", "of_b"), ("of_b", "of_a")):
        shutil.rmtree(folder / name)
        shutil.copytree(drives / source, folder / name)
    filled(folder, out, shard_stage(out, FleetTrainingOptions()))
    data = chosen(folder, out, validation=("a",), test=("b",))
    seconds = [sum(block.seconds for block in blocks) for blocks in (data.validation, data.test)]
    assert seconds[0] > seconds[1]
    assert {block.recording for block in data.validation} == {"of_a"}
    assert {block.recording for block in data.test} == {"of_b"}
    assert data.failed["same_as_a"] == "has the content of of_b"


def test_the_parts_are_those_of_the_recordings(drives, out) -> None:
    data = chosen(drives, out, validation=("a",), test=("b",))
    folder = out / "shards"
    split = split_of(folder, data, joined_records(folder, data.windows.window(0)), 0)
    assert {record.name for record in split.of(TRAIN)} <= {"of_c", "of_d"}
    assert {record.name for record in split.of(VALIDATION)} == {"of_a"}
    (test,) = split.of(TEST)
    assert test.name == "of_b"
    assert test.duration_s == pytest.approx(65.0, abs=0.1)
    assert split.kind == "vehicles"


def test_validation_takes_turns_and_no_block_twice(drives, out, monkeypatch) -> None:
    monkeypatch.setattr(training_data, "_SLICE_S", 30.0)
    monkeypatch.setattr(training_data, "_VALIDATION_SLICES", 3)
    data = chosen(drives, out, validation=("a", "b"), test=("c",))
    split = split_of(out / "shards", data, joined_records(out / "shards", []), 0)
    names = [record.name for record in split.of(VALIDATION)]
    assert set(names) == {"of_a", "of_b"}
    assert split.seconds(VALIDATION) <= 91.0


def test_a_lost_shard_is_written_again(drives, out) -> None:
    data = chosen(drives, out)
    (out / "shards" / data.test[0].shard).unlink()
    forget_lost_files(out, "shards", out / "shards", "shard")
    left = {row["recording"] for row in FleetDataset(out).rows("shards")}
    assert data.test[0].recording not in left
    assert len(left) >= 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--test", "z"], "vehicle 'z' has no usable recording; there are a, b, c, d"),
        (["--hours", "0"], "choose at least a minute"),
        (["--steps", "0"], "steps is 0"),
        (["--validation", "a", "--test", "a"], "'a' cannot both validate and test"),
    ],
)
def test_refusals(drives, out, tmp_path, capsys, arguments, message) -> None:
    given = ["fleet", "train", str(drives), "--model", str(tmp_path / "m"), "--out", str(out)]
    assert message in refused(capsys, [*given, *arguments], 2)


def test_dry_run(drives, out, tmp_path, capsys) -> None:
    given = ["fleet", "train", str(drives), "--model", str(tmp_path / "m"), "--out", str(out)]
    assert main([*given, "--dry-run"]) == 0
    assert "6 recordings, 6 done, 0 to process" in (text := capsys.readouterr().out)
    assert "then 4000 training steps" in text


def test_a_model_is_scored_on_an_unseen_vehicle(drives, out, tmp_path, monkeypatch) -> None:
    leave_one_candidate(monkeypatch)
    from adk_ros.api.training import default_settings

    training = FleetTrainingOptions(validation=("a",), test=("b",))
    trained = train_fleet(
        [str(drives)], out, tmp_path / "m",
        settings=default_settings(steps=40), training=training,
        options=FleetOptions(cluster="tcp://nowhere:1"),
    )  # fmt: skip
    facts = json.loads((tmp_path / "m" / "manifest.json").read_text())["training"]
    assert facts["fleet"]["vehicles"] == {
        "train": ["c", "d"], "validation": ["a"], "test": ["b"],
    }  # fmt: skip
    assert facts["split"]["kind"] == "vehicles"
    assert trained.training is not None
    assert trained.training.test is not None
    assert np.isfinite(trained.training.test.ratio).all()
    page = (tmp_path / "m" / "report.html").read_text()
    assert "training: c, d; validation: a; test: b" in page


@pytest.mark.slow(seconds=90)
def test_by_workers(drives, tmp_path, capsys) -> None:
    given = ["fleet", "train", str(drives), "--model", str(tmp_path / "m")]
    given += ["--out", str(tmp_path / "out"), "--workers", "1", "--steps", "30"]
    assert main(given) == 0
    text = "".join(capsys.readouterr())
    assert "not used: bad.mcap: " in text
    assert "in 2 windows" in text
    assert main([*given, "--force", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fleet"]["windows"] == 2
