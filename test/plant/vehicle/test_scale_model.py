# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 1:10 and a 1:5 car from mass and wheelbase: they load, and drive the packaged scenarios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import UsageError
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.scenario.simulate import simulate
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle


def vehicle_file(folder: Path, text: str) -> str:
    path = folder / "car.yaml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("text", ["mass: 3.0\nwheelbase: 0.26\n", "mass: 21.0\nwheelbase: 0.57\n"])
@pytest.mark.parametrize("name", ["town", "mountain"])
def test_a_scale_model_drives_a_scenario(tmp_path: Path, name: str, text: str) -> None:
    base = load_scenario(name)
    car = base.model_copy(update={"vehicle": vehicle_file(tmp_path, text), "vehicle_changes": {}})
    drive = simulate(car, duration_s=30.0)
    size = drive.vehicle.length_scale
    # Town and mountain roads are driven at 7 to 30 m/s in full size, up to 0.5 g.
    assert drive.x[:, 0].min() > 4.0 * np.sqrt(size)
    assert drive.x[:, 0].max() < 33.0 * np.sqrt(size)
    assert np.abs(np.arctan2(drive.x[:, 1], drive.x[:, 0])).max() < 0.15
    assert 2.0 < np.abs(drive.x[:, 0] * drive.x[:, 2]).max() < 6.0
    assert drive.route.length == pytest.approx(size * base.planned_route().length)


def test_values_of_a_scale_model_that_are_given_are_kept(tmp_path: Path) -> None:
    text = "mass: 3.0\nwheelbase: 0.26\nwheel_radius: 0.033\nfront_tyre: {b_y: 4.0}\n"
    car = load_vehicle(vehicle_file(tmp_path, text))
    assert car.wheel_radius == 0.033
    assert car.front_tyre.b_y == 4.0
    assert car.front_tyre.nominal_load == pytest.approx(7.5)
    assert car.constants().slip_speed_min == pytest.approx(2.0 * np.sqrt(0.26 / 2.7))


def test_a_mass_in_tonnes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="mass should be at least 50 for a vehicle of this"):
        load_vehicle(vehicle_file(tmp_path, "mass: 1.5\nwheelbase: 2.7\n"))


def test_a_full_size_vehicle_has_the_constants_of_the_kernels() -> None:
    constants = load_vehicle("imdv").constants()
    assert (constants.length_scale, constants.slip_speed_min, constants.load_min) == (
        1.0,
        2.0,
        10.0,
    )
