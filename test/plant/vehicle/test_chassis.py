# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chassis section of vehicle files: packaged values, defaults and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import UsageError
from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.scenario.scenario_file import load_scenario
from adk_ros.plant.vehicle.sprung_mass import MAX_RATE, resolve, vertical_modes
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle, load_vehicle, vehicles

CAR = """\
mass: 1800.0
yaw_inertia: 3000.0
cg_to_front_axle: 1.2
cg_to_rear_axle: 1.4
track_width: 1.6
"""


def test_the_papers_vehicle_has_its_sprung_mass() -> None:
    vehicle = load_vehicle("imdv")
    body = resolve(vehicle)
    assert body.sprung_mass == pytest.approx(1648.0)
    assert body.inertia_z == 3658.0
    assert {"imdv", "race_car", "light_truck"} <= set(vehicles())
    for name, sprung in (("mass_plus_160", 1808.0), ("mass_minus_170", 1478.0)):
        assert resolve(load_scenario(name).car()).sprung_mass == pytest.approx(sprung)
    for name, inertia in (("inertia_plus_142", 3800.0), ("inertia_minus_158", 3500.0)):
        assert resolve(load_scenario(name).car()).inertia_z == inertia


@pytest.mark.parametrize("name", vehicles())
def test_centre_of_gravity_equals_that_of_the_planar_model(name: str) -> None:
    vehicle = load_vehicle(name)
    b = resolve(vehicle)
    unsprung = 2.0 * (b.unsprung_f + b.unsprung_r)
    assert b.sprung_mass + unsprung == pytest.approx(vehicle.mass)
    carried = 2.0 * (
        b.unsprung_f * vehicle.cg_to_front_axle - b.unsprung_r * vehicle.cg_to_rear_axle
    )
    assert b.sprung_mass * b.sprung_x + carried == pytest.approx(0.0, abs=1e-9)
    assert b.sprung_mass * b.sprung_z + unsprung * b.wheel_z == pytest.approx(0.0, abs=1e-9)
    assert 2.0 * (b.load_f + b.load_r) == pytest.approx(vehicle.mass * GRAVITY)


@pytest.mark.parametrize("name", vehicles())
def test_modal_frequencies_are_typical_of_a_car(name: str) -> None:
    """Body modes between 1 and 7 Hz, wheel hop above; all damped, none near the limit."""
    vehicle = load_vehicle(name)
    modes = vertical_modes(vehicle, resolve(vehicle))
    assert modes.real.max() < -0.5
    hertz = np.sort(np.abs(modes))[::2] / (2.0 * np.pi)
    assert np.all(hertz[:3] > 1.0)
    assert np.all(hertz[:3] < 7.0)
    assert np.all(hertz[3:] > 7.0)
    assert np.abs(modes).max() < 0.2 * MAX_RATE


def test_defaults_are_those_of_a_passenger_car(tmp_path: Path) -> None:
    path = tmp_path / "car.yaml"
    path.write_text(CAR)
    vehicle = load_vehicle(path)
    assert vehicle.chassis is None
    b = resolve(vehicle)
    heave = np.sqrt(b.spring_f / (b.static_f / GRAVITY)) / (2.0 * np.pi)
    assert heave == pytest.approx(1.3)
    roll_stiffness = 0.5 * 1.6**2 * (b.spring_f + b.spring_r + 2.0 * (b.bar_f + b.bar_r))
    lean = 1800.0 * 0.45 * GRAVITY / roll_stiffness
    assert 2.5 < np.degrees(lean) < 6.0, "degrees of roll at 1 g"
    path.write_text(CAR + "chassis: {spring_front: 55000.0}\n")
    stiffer = resolve(load_vehicle(path))
    assert stiffer.spring_f == 55000.0
    assert stiffer.spring_r == b.spring_r
    assert stiffer.damper_f > b.damper_f, "what is derived follows what is given"


@pytest.mark.parametrize(
    ("chassis", "said"),
    [
        ("{spring_fornt: 3.0}", r"chassis\.spring_fornt: no such parameter"),
        ("{spring_front: -3.0}", r"chassis\.spring_front: .*greater than 0"),
        ("{damper_rear: stiff}", r"chassis\.damper_rear: .*valid number, got 'stiff'"),
        ("{unsprung_mass_front: 800.0}", "the sprung mass is less than a fifth of the mass"),
        ("{unsprung_mass_front: 320.0, unsprung_mass_rear: 320.0}", "yaw inertia is less than"),
        ("{tyre_stiffness_front: 2.0e+7, unsprung_mass_front: 4.0}", "vertical mode .* too fast"),
        ("{damper_front: 2.0e+5}", "too fast for steps of 1 ms"),
        ("{stop_stiffness: 5.0e+6, unsprung_mass_rear: 0.6}", "too fast"),
        ("7", "chassis: .*"),
    ],
)
def test_a_bad_chassis_gives_a_one_line_message(tmp_path: Path, chassis: str, said: str) -> None:
    path = tmp_path / "car.yaml"
    path.write_text(CAR + f"chassis: {chassis}\n")
    with pytest.raises(UsageError, match=said) as caught:
        load_vehicle(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_impossible_chassis_is_refused_with_the_plant(tmp_path: Path) -> None:
    """The yaw inertia is below that of the unsprung masses: refused when the plant is chosen."""
    (tmp_path / "odd.yaml").write_text(CAR.replace("3000.0", "500.0"))
    assert load_vehicle(tmp_path / "odd.yaml").yaw_inertia == 500.0
    trip = tmp_path / "trip.yaml"
    trip.write_text("base: town\nvehicle: odd.yaml\n")
    assert load_scenario(trip).car().yaw_inertia == 500.0
    trip.write_text("base: xyz_edges\nvehicle: odd.yaml\n")
    with pytest.raises(UsageError, match="scenario trip: vehicle: chassis: the yaw inertia"):
        load_scenario(trip)


def test_constants_do_not_depend_on_the_chassis() -> None:
    vehicle = load_vehicle("imdv")
    bare = Vehicle.model_validate(vehicle.model_dump(exclude={"chassis"}))
    assert bare.constants() == vehicle.constants()
