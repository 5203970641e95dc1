# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surrogate model as the car of `adk simulate`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adk_ros.cli.main import main
from adk_ros.errors import DataError
from adk_ros.mismatch.deployment.open_loop import OpenLoopPredictor
from adk_ros.mismatch.deployment.scenario_drive import position_dependent_terms, simulate_scenario
from adk_ros.mismatch.deployment.surrogate_file import load_surrogate
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.library.surrogate_parameters import INDEX, default_parameters
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm
from adk_ros.numerics.arrays import FloatArray
from adk_ros.offline.export import write_bag
from adk_ros.plant.environment.road import locate
from adk_ros.plant.scenario.scenario_file import Scenario, load_scenario
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive

SECONDS = 40.0
DRAG = [{"effect": "aero_drag", "parameters": {"cda": 2.0}, "where": {"kind": "always"}}]
PLACED = [{
    "effect": "road_bank", "parameters": {"bank": 0.1},
    "where": {"kind": "place", "lap": 500.0, "stretches": [[100.0, 200.0]],
              "line": [[0.0, 0.0, 0.0, 0.0], [500.0, 500.0, 0.0, 0.0]]},
}]  # fmt: skip
CONSTANT = [FeatureTerm("v_x", "constant", -0.5, 0.0)]


def vector(**changes: float) -> FloatArray:
    """Parameters of a car of two tons."""
    p = default_parameters()
    p[INDEX["mass"]], p[INDEX["yaw_inertia"]] = 2000.0, 3500.0
    for name, value in changes.items():
        p[INDEX[name]] = value
    return p


@pytest.fixture(scope="module")
def clean() -> Scenario:
    """The handling course without sensor noise."""
    scenario = load_scenario("handling")
    return scenario.model_copy(update={"sensors": scenario.sensors.clean()})


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("driven") / "simulation.yaml"
    path.write_text(surrogate_yaml(vector()))
    return path


@pytest.fixture(scope="module")
def drive(clean: Scenario, file: Path) -> SimulatedDrive:
    return simulate_scenario(load_surrogate(file), clean, duration_s=SECONDS)


def driven_with(
    tmp_path: Path,
    scenario: Scenario,
    p: FloatArray | None = None,
    **content: Any,
) -> SimulatedDrive:
    path = tmp_path / "corrected.yaml"
    path.write_text(surrogate_yaml(vector() if p is None else p, **content))
    return simulate_scenario(load_surrogate(path), scenario, duration_s=SECONDS)


def test_car_follows_the_route_reproducibly(
    clean: Scenario, file: Path, drive: SimulatedDrive
) -> None:
    table, spacing = drive.route.table, drive.route.spacing
    for place, (x, y, _) in zip(drive.arc_length[::40], drive.pose[::40], strict=True):
        assert abs(locate(table, spacing, float(place), float(x), float(y))[1]) < 2.0
    assert np.isfinite(drive.x).all()
    assert drive.x[:, 0].max() > 12.0
    assert np.abs(drive.x[:, 2]).max() > 0.2
    again = simulate_scenario(load_surrogate(file), clean, duration_s=SECONDS)
    np.testing.assert_array_equal(again.x, drive.x)
    np.testing.assert_array_equal(again.commands, drive.commands)
    other = simulate_scenario(load_surrogate(file), clean, seed=5, duration_s=SECONDS)
    assert not np.array_equal(other.commands, drive.commands)


def test_surrogate_predicts_its_own_bag(file: Path, drive: SimulatedDrive, tmp_path: Path) -> None:
    """Open-loop rollouts along the simulated bag reproduce its odometry."""
    write_bag(drive, tmp_path / "bag")
    log = read_sensor_log(tmp_path / "bag")
    starts = np.arange(5.0, SECONDS - 3.0, 1.0)
    predicted = OpenLoopPredictor(load_surrogate(file).content, log).predict(starts, 40)
    at = np.searchsorted(log.odometry_s, starts + 1.0 - 1e-6)
    error = predicted[:, -1] - log.odometry[at]
    change = log.odometry[at] - log.odometry[np.searchsorted(log.odometry_s, starts - 1e-6)]
    np.testing.assert_array_less(np.sqrt((error**2).mean(axis=0)), [0.02, 0.01, 0.003])
    np.testing.assert_array_less([0.3, 0.02, 0.05], np.sqrt((change**2).mean(axis=0)))


def test_terms_act(clean: Scenario, drive: SimulatedDrive, tmp_path: Path) -> None:
    """The driver compensates drag and a constant feature with the expected torque."""
    dragged = driven_with(tmp_path, clean, terms=DRAG)
    speed = drive.x[200:, 0]
    asked = (dragged.u[200:, 0] - drive.u[200:, 0]).mean()
    due = (0.5 * 1.225 * 2.0 * speed**2).mean() * 0.325
    assert asked == pytest.approx(due, rel=0.15)
    pushed = driven_with(tmp_path, clean, feature_terms=CONSTANT)
    asked = (pushed.u[200:, 0] - drive.u[200:, 0]).mean()
    assert asked == pytest.approx(0.5 * 2000.0 * 0.325, rel=0.15)


def test_position_dependent_terms_are_left_out(
    clean: Scenario, drive: SimulatedDrive, tmp_path: Path
) -> None:
    placed = driven_with(tmp_path, clean, terms=PLACED)
    assert position_dependent_terms(load_surrogate(tmp_path / "corrected.yaml").content) == [
        "road_bank"
    ]
    np.testing.assert_array_equal(placed.x, drive.x)


def test_friction_of_the_scenario_acts(
    clean: Scenario, drive: SimulatedDrive, tmp_path: Path
) -> None:
    slippery = clean.model_copy(update={"mu": 0.3})
    with pytest.raises(DataError, match="leaves the road of handling after"):
        driven_with(tmp_path, slippery, vector(grip_f=0.3, grip_r=0.3))


def test_command_line(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, corrected = tmp_path / "bag", tmp_path / "corrected.yaml"
    corrected.write_text(surrogate_yaml(vector(), terms=PLACED))
    given = ["simulate", "town", "--model", str(corrected), "--out", str(out), "--duration", "5"]
    assert main([*given, "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["seconds"] == 5.0
    assert "road are left out: road_bank" in " ".join(printed.err.split())
    assert len(read_sensor_log(out).odometry_s) > 200
    vehicle = tmp_path / "vehicle.yaml"
    vehicle.write_text("mass: 2000.0\n")
    given[3] = str(vehicle)
    assert main([*given[:5], str(tmp_path / "other")]) == 2
    assert "vehicle.yaml" in capsys.readouterr().err
