# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vehicle and scenario files: accepted content and one-line refusals."""

from __future__ import annotations

from pathlib import Path

import pytest

from adk_ros.errors import UsageError
from adk_ros.plant.scenario.scenario_file import load_scenario, scenarios
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle, vehicles

LENGTHS_AND_MASSES = """\
mass: 1800.0
yaw_inertia: 3000
cg_to_front_axle: 1.2
cg_to_rear_axle: 1.4
track_width: 1.6
cg_height: 0.5
wheel_radius: 0.31
wheel_inertia: 1.1
side_force_area: 3.0
yaw_moment_volume: 1.0
"""
STIFF = "front_tyre: {b_x: 40.0, mu: 2.5, relaxation_length_x: 0.05}\n"
ROUTE = """\
duration_s: 5.0
route:
  - straight: 100
  - bend: {radius: 60, angle_deg: 180}
  - straight: 100
  - bend: {radius: 30, angle_deg: 90}
  - straight: 50
  - bend: {radius: 30, angle_deg: 90}
"""


def write(folder: Path, text: str, name: str = "file.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_table_1_vehicle_is_packaged() -> None:
    vehicle = load_vehicle("imdv")
    assert "imdv" in vehicles()
    assert (vehicle.mass, vehicle.yaw_inertia) == (2070.0, 3658.0)
    assert (vehicle.cg_to_front_axle, vehicle.cg_to_rear_axle) == (1.315, 1.355)
    assert vehicle.track_width == 1.715


def test_masses_and_lengths_suffice_for_a_vehicle(tmp_path: Path) -> None:
    vehicle = load_vehicle(write(tmp_path, LENGTHS_AND_MASSES))
    assert vehicle.mass == 1800.0
    assert vehicle.yaw_inertia == 3000.0
    assert vehicle.front_tyre.b_y < vehicle.rear_tyre.b_y, "the default car understeers"


def test_constants_contain_every_parameter() -> None:
    vehicle = load_vehicle("imdv")
    constants = vehicle.constants()
    assert constants.mass == vehicle.mass
    assert constants.b_y_f == vehicle.front_tyre.b_y
    assert constants.relaxation_length_r == vehicle.rear_tyre.relaxation_length


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            LENGTHS_AND_MASSES.replace("mass:", "masss:"),
            "masss: no such parameter, did you mean mass.$",
        ),
        (LENGTHS_AND_MASSES.replace("mass: 1800.0\n", ""), "mass: is missing"),
        (LENGTHS_AND_MASSES.replace("1800.0", "heavy"), "mass: .*valid number, got 'heavy'"),
        (LENGTHS_AND_MASSES.replace("1800.0", "-1.0"), "mass: .*greater than 0"),
        (LENGTHS_AND_MASSES.replace("1800.0", ".nan"), "mass: .*finite"),
        (LENGTHS_AND_MASSES.replace("1800.0", "true"), "mass: .*valid number, got True"),
        (LENGTHS_AND_MASSES + "front_tyre: {b_y: 0.0}\n", r"front_tyre\.b_y: "),
        (LENGTHS_AND_MASSES + "mass: 1900.0\n", "key 'mass' is given twice at line 11"),
        (LENGTHS_AND_MASSES + "wheel_inertia: [", "at line"),
        (LENGTHS_AND_MASSES.replace("1.1", "0.3") + STIFF, "front wheels are too light for"),
        ("? [1, 2]\n: 3\n", "unhashable key at line 1"),
        ("1: 2\n", "1: .*string"),
        ("mass: " + 9000 * "9", "not valid YAML"),
        (f"mass: {9000 * 'x'}\n", r"mass: .*got 'x{39}\.\.\. \(and 4 more\)"),
        ("mass: !!python/name:os.system\n", "could not determine a constructor"),
        ("- 1\n- 2\n", "expected a mapping"),
        ("", "expected a mapping"),
    ],
)
def test_a_bad_vehicle_message_names_file_and_key(tmp_path: Path, text: str, said: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(UsageError, match=said) as caught:
        load_vehicle(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no such vehicle file"):
        load_vehicle(tmp_path / "none.yaml")
    with pytest.raises(UsageError, match=r"ghost: no such vehicle; .*imdv"):
        load_vehicle("ghost")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00mass")
    with pytest.raises(UsageError, match="not UTF-8"):
        load_vehicle(binary)
    with pytest.raises(UsageError, match="cannot read"):
        load_vehicle(_folder(tmp_path))


def _folder(tmp_path: Path) -> Path:
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("name", scenarios())
def test_packaged_scenarios_load(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.planned_route().length > 500.0


def test_a_vehicle_path_is_relative_to_the_scenario(tmp_path: Path) -> None:
    write(tmp_path, LENGTHS_AND_MASSES, "car.yaml")
    scenario = load_scenario(write(tmp_path, "vehicle: car.yaml\n" + ROUTE, "trip.yaml"))
    assert scenario.car().mass == 1800.0
    assert scenario.name == "trip"


def test_single_parameters_of_the_vehicle_can_be_changed(tmp_path: Path) -> None:
    path = write(tmp_path, "vehicle_changes: {mass: 2230.0}\n" + ROUTE)
    car = load_scenario(path).car()
    assert (car.mass, car.yaw_inertia) == (2230.0, 3658.0)
    with pytest.raises(UsageError, match=r"vehicle_changes: mas: no such parameter"):
        load_scenario(write(tmp_path, "vehicle_changes: {mas: 2230.0}\n" + ROUTE))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROUTE.replace("angle_deg: 180", "angle_deg: 150"), "whole circles in total, not by 330"),
        (
            ROUTE.replace("straight: 50", "straight: 50\n    bend: {radius: 90, angle_deg: 90}"),
            r"route\.4: give exactly one of straight, bend, slalom",
        ),
        (
            ROUTE.replace("radius: 60, angle_deg: 180", "radius: 20, angle_deg: 180"),
            "become shorter than 5 m",
        ),
        (ROUTE + "places: [{start: 10.0, end: 9000.0, mu: 0.4}]\n", "a place ends at 9000 m"),
        (ROUTE + "places: [{start: 10.0, end: 5.0}]\n", r"places\.0: end must be greater"),
        (ROUTE + "sensors: {command: {rate_hz: 30.0}}\n", "whole milliseconds"),
        (ROUTE + "vehicle: ghost\n", "ghost: no such vehicle"),
        (ROUTE.replace("duration_s: 5.0", "duration_s: 0"), "duration_s: .*greater than 0.1"),
    ],
)
def test_a_bad_scenario_gives_a_one_line_message(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        load_scenario(write(tmp_path, text))
    assert "\n" not in str(caught.value)
