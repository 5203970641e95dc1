# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 1:10 car with a partial vehicle file, from its bags to the missing physics."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from adk_ros.cli.main import main
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

SECONDS = 75.0
SHEET = "mass: 3.0\nwheelbase: 0.26\n"
SOFTER = 0.84
"""Cornering stiffness of the recorded car's front tyres over that of the simulated one's."""


def simulated(folder: Path, name: str, seed: int, **changes: Any) -> Path:
    """Write the bag of a drive on the handling course, scaled to the car of the data sheet."""
    scenario = load_scenario("handling").model_dump(exclude_none=True, exclude={"vehicle_changes"})
    scenario |= {"name": name, "seed": seed, "duration_s": SECONDS, "vehicle": "car.yaml"}
    path = folder / f"{name}.scenario.yaml"
    path.write_text(yaml.safe_dump(scenario | {"vehicle_changes": changes}))
    assert main(["simulate", str(path), "--out", str(folder / name)]) == 0
    return folder / name


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    capsys.readouterr()
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow(seconds=120)
def test_a_scale_car_is_described_checked_and_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    car = tmp_path / "car.yaml"
    car.write_text(SHEET)
    stiffness = load_vehicle(car).front_tyre.b_y
    simulation = simulated(tmp_path, "simulation", 1)
    softer = {"front_tyre": {"b_y": SOFTER * stiffness}}
    recording = simulated(tmp_path, "recording", 2, **softer)

    about = printed(capsys, "info", recording)
    assert about["verdict"] == "usable for training and replay"
    assert about["warnings"] == []
    # A torque of 0.1 N·m is no pedal position.
    assert {row["possible"] for row in about["scope"]} == {"yes"}

    checked = printed(capsys, "check", recording, "--vehicle", car)
    findings = {x["name"]: x for x in checked["findings"]}
    assert [x for x in findings.values() if x["verdict"] == "finding"] == []
    assert findings["steering_ratio"]["verdict"] == "ok"
    assert "pedal_map" not in findings
    assert checked["parameters"] == {}
    assert any("wheel_radius missing: what needs them" in text for text in checked["warnings"])

    result = printed(
        capsys, "mismatch", "--simulation", simulation, "--recording", recording,
        "--vehicle", car, "--out", tmp_path / "report",
    )  # fmt: skip
    assert result["verdict"] == "explained"
    (effect,) = result["effects"]
    assert effect["name"] == "front_tyre_stiffness"
    (size,) = effect["parameters"].values()
    assert size["value"] == pytest.approx(SOFTER, abs=0.03)
    assert {row["possible"] for row in result["scope"]["rows"]} == {"yes"}
    assert any("a scale model" in note for note in result["notes"])
    assert np.isfinite(result["fit"]["after"]["yaw_rate"])
