# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk rollout: columns and times of the CSV file, and the kinds of models."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.train import bag, drive, lines, refused, small

from adk_ros.bags.recording import read_recording
from adk_ros.cli.main import main
from adk_ros.signals.channels import TICK_NS

COLUMNS = ["start_s", "t_s", "v_x", "v_y", "yaw_rate"]


def rolled(capsys, model: object, recording: Path, out: Path, *more: str) -> np.ndarray:
    """Run `adk rollout --force`; return the table (starts, steps, columns)."""
    arguments = ["rollout", "--model", str(model), "--bag", str(recording), "--out", str(out)]
    assert main([*arguments, "--force", *more]) == 0
    printed = capsys.readouterr()
    assert printed.out == "" or "--json" in more
    with out.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == COLUMNS
    table = np.array(rows, dtype=float)
    starts = np.unique(table[:, 0])
    table = table.reshape(starts.size, -1, len(COLUMNS))
    assert np.all(table[:, :, 0] == starts[:, None])
    assert np.isfinite(table).all()
    return table


@pytest.fixture
def models(tmp_path: Path) -> dict[str, object]:
    file = tmp_path / "vehicle.yaml"
    file.write_text(yaml.safe_dump(drive().vehicle.model_dump()))
    return {"folder": small().path, "yaml": file, "name": "imdv"}


@pytest.mark.parametrize("kind", ["folder", "yaml", "name"])
def test_columns_times_and_accuracy(
    capsys, tmp_path: Path, models: dict[str, object], kind: str
) -> None:
    recording = bag("town", 30.0, clean=True)
    table = rolled(capsys, models[kind], recording, tmp_path / "r.csv", "--horizon", "1.0")
    starts, times = table[:, 0, 0], table[:, :, 1]
    assert table.shape[1] == 40
    ahead = np.tile(0.025 * np.arange(1, 41), (starts.size, 1))
    np.testing.assert_allclose(times - starts[:, None], ahead, atol=2e-6)
    expected = 2.0 + 0.5 * np.arange(starts.size)
    assert np.all((starts >= expected - 1e-6) & (starts < expected + 0.025))
    assert starts[-1] + 1.0 > 28.9
    # Compared with the true states at the times given in the file.
    truth = drive("town", 30.0, clean=True)
    start_ns = read_recording(recording).start_ns
    rows = np.rint((times * 1e9 + start_ns - truth.stamp_ns[0]) / TICK_NS).astype(int)
    error = np.sqrt(np.mean((table[:, -1, 2:] - truth.x[rows[:, -1]]) ** 2, axis=0))
    assert np.all(error < ([1.0, 0.2, 0.1] if kind == "folder" else [0.01, 0.002, 0.001])), error


def test_horizon_and_stride(capsys, tmp_path: Path) -> None:
    table = rolled(capsys, "imdv", bag(), tmp_path / "r.csv", "--horizon", "0.25", "--stride", "2")
    assert table.shape[1] == 10
    np.testing.assert_allclose(np.diff(table[:, 0, 0]), 2.0, atol=0.026)
    longer = rolled(capsys, "imdv", bag(), tmp_path / "r.csv", "--horizon", "2", "--stride", "2")
    assert longer.shape[1] == 80
    # The first steps do not depend on the horizon.
    np.testing.assert_array_equal(longer[:, :10], table[: len(longer)])


def test_printed_lines_and_json(capsys, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    arguments = ["rollout", "--model", "imdv", "--bag", str(bag()), "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    count = len(out.read_text().splitlines()) // 40
    assert lines(printed.err) == [f"{count} rollouts of 1 s (40 ticks of 25 ms) in {out}"]
    assert main([*arguments, "--json", "--force"]) == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "starts": count, "steps": 40}


def test_a_missing_imu_is_reported(capsys, tmp_path: Path) -> None:
    arguments = ["--bag", str(bag("town", 20.0, imu=False)), "--out", str(tmp_path / "r.csv")]
    assert main(["rollout", "--model", str(small().path), *arguments]) == 0
    first, *_ = lines(capsys.readouterr().err)
    assert first.startswith("warning: the model was trained with an IMU and there is none: ")
    assert main(["rollout", "--model", "imdv", *arguments, "--force"]) == 0
    assert "warning" not in capsys.readouterr().err


def test_a_bag_that_is_too_short_is_refused(capsys, tmp_path: Path) -> None:
    arguments = ["rollout", "--model", "imdv", "--bag", bag("town", 2.5), "--out", tmp_path / "r"]
    assert "no start after 2 s has commands" in refused(capsys, arguments, 3)
    assert not list(tmp_path.iterdir())
