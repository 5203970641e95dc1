# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk watch refuses wrong options in one line; the node is tested in test/ros."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.watch import surrogate

from adk_ros.cli.main import main
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "simulation.yaml"
    path.write_text(simulation_yaml(surrogate()))
    return path


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--run"], "--out"),
        (["--duration", "0"], "--duration"),
        (["--imu", "not a topic"], "not a topic"),
        (["--namespace", "9 cars"], "9 cars"),
    ],
)
def test_wrong_options_are_refused(
    arguments: list[str], named: str, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["watch", "--model", str(model), *arguments]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("adk: ")
    assert named in line


def test_a_model_that_is_no_surrogate_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "car.yaml"
    path.write_text("mass: 1500.0\n")
    assert main(["watch", "--model", str(path)]) == 2
    assert "car.yaml" in capsys.readouterr().err
    assert main(["watch", "--model", str(tmp_path / "none.yaml")]) == 2


def test_an_inferred_torque_is_refused(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "params.yaml"
    params.write_text(
        "/**:\n  ros__parameters:\n    command_type: ackermann\n    mass: 1500.0\n"
        "    wheel_radius: 0.3\n"
    )
    assert main(["watch", "--model", str(model), "--params", str(params)]) == 2
    assert "wheel torque" in capsys.readouterr().err
