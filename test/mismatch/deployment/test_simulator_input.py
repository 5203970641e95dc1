# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulator given as a YAML file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import case
from helpers.mismatch_report import drag

from adk_ros.cli.main import main
from adk_ros.errors import UsageError
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.deployment.simulator_input import (
    driving_envelope,
    load_simulator,
    simulate_matched_drive,
)
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.inference.result import EXPLAINED
from adk_ros.mismatch.library.surrogate_parameters import default_parameters
from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle, nominal_vehicle_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.offline.sensor_log_bag import write_sensor_log
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle


def vehicle() -> Vehicle:
    return load_vehicle("imdv")


def test_matched_drive_covers_the_recording() -> None:
    recording = case().recording
    driven = simulate_matched_drive(vehicle(), recording)
    made, asked = driving_envelope(driven), driving_envelope(recording)
    assert 0.95 < made.top / asked.top < 1.2
    assert 0.9 < made.lateral / asked.lateral < 2.0
    assert made.forward > 0.8 * asked.forward
    assert made.braking > 0.8 * asked.braking
    again = simulate_matched_drive(vehicle(), recording)
    np.testing.assert_array_equal(again.imu, driven.imu)


@pytest.mark.slow(seconds=90)
def test_drag_missing_in_a_vehicle_file_is_identified() -> None:
    plain = vehicle()
    real = plain.model_copy(update={"cda": plain.cda + 1.0})
    driven = simulate_matched_drive(real, case().recording, "recording")
    rng = np.random.default_rng(0)
    noisy = replace(
        driven, imu=driven.imu + np.array([0.06, 0.06, 0.003]) * rng.normal(size=driven.imu.shape),
        odometry=driven.odometry
        + np.array([0.03, 0.03, 0.003]) * rng.normal(size=driven.odometry.shape),
    )  # fmt: skip
    found = identify_mismatch(
        simulate_matched_drive(plain, noisy), noisy, nominal_vehicle_of(plain)
    )
    assert found.verdict == EXPLAINED
    (one,) = found.effects
    assert one.effect.name == "aero_drag"
    assert one.parameters["cda"].value == pytest.approx(1.0, abs=0.05)


def test_packaged_vehicle_is_a_nominal_vehicle() -> None:
    plain = load_vehicle("imdv")
    assert load_nominal_vehicle("imdv") == nominal_vehicle_of(plain)


def test_vehicle_file_with_one_further_parameter(tmp_path: Path) -> None:
    file = tmp_path / "car.yaml"
    file.write_text(yaml.safe_dump({**nominal_vehicle_of(vehicle()).model_dump(), "cda": 0.9}))
    assert load_nominal_vehicle(file) == nominal_vehicle_of(vehicle())
    file.write_text("mas: 1500.0\n")
    with pytest.raises(UsageError, match="mas"):
        load_nominal_vehicle(file)


def test_load_simulator(tmp_path: Path) -> None:
    file = tmp_path / "simulation.yaml"
    file.write_text(surrogate_yaml(default_parameters()))
    found = load_simulator(file)
    assert isinstance(found, SurrogateModel)
    np.testing.assert_allclose(found.parameters, default_parameters())
    terms = [{"effect": "aero_drag", "parameters": {"cda": 1.0}}]
    file.write_text(surrogate_yaml(default_parameters(), terms=terms))
    with pytest.raises(UsageError, match=r"give the simulation\.yaml"):
        load_simulator(file)
    with pytest.raises(UsageError, match="does not exist"):
        load_simulator(tmp_path / "none.yaml")
    file.write_text("mass: heavy\n")
    with pytest.raises(UsageError, match="mass"):
        load_simulator(file)


def test_command_takes_a_surrogate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file, bag = tmp_path / "simulation.yaml", tmp_path / "recording"
    file.write_text(surrogate_yaml(default_parameters()))
    write_sensor_log(case().recording, bag)
    given = []

    def known(simulation: object, recording: object, *rest: object) -> object:
        given.append(simulation)
        return drag()

    monkeypatch.setattr("adk_ros.mismatch.analysis.identify_mismatch", known)
    arguments = ["mismatch", "--simulation", str(file), "--recording", str(bag)]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    assert isinstance(given[0], SurrogateModel)
    summary = capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "0.92 m² more drag area" in summary
    assert "0.92 m² more drag area" in page
    car = tmp_path / "vehicle.yaml"
    car.write_text("mass: 1500.0\n")
    assert main([*arguments, "--out", str(tmp_path / "o"), "--vehicle", str(car)]) == 2
    assert "use --vehicle only with a bag of the simulator" in capsys.readouterr().err
