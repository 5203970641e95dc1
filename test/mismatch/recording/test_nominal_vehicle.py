# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vehicle files that lack what a data sheet does not tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.mismatch import CAR, case

from adk_ros.errors import UsageError
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle, load_nominal_vehicle
from adk_ros.mismatch.simulator import surrogate_of


def loaded(folder: Path, **content: object) -> NominalVehicle:
    path = folder / "vehicle.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_nominal_vehicle(path)


def test_a_data_sheet_is_enough(tmp_path: Path) -> None:
    made = loaded(tmp_path, mass=1600.0, wheelbase=2.7)
    assert made.cg_to_front_axle == pytest.approx(1.3)
    assert made.cg_to_rear_axle == pytest.approx(1.4)
    assert made.yaw_inertia == pytest.approx(1600.0 * 1.3 * 1.4)
    assert (made.track_width, made.cg_height, made.wheel_radius) == pytest.approx(
        (1.6, 0.53, 0.325)
    )
    assert made.assumed == {
        "cg_to_front_axle", "cg_to_rear_axle", "yaw_inertia", "track_width", "cg_height",
        "wheel_radius",
    }  # fmt: skip
    half = loaded(tmp_path, mass=1600.0, wheelbase=2.7, cg_to_rear_axle=1.2, wheel_radius=0.3)
    assert half.cg_to_front_axle == pytest.approx(1.5)
    assert half.wheel_radius == 0.3
    assert half.assumed == {"cg_to_front_axle", "yaw_inertia", "track_width", "cg_height"}


def test_a_complete_file_assumes_nothing(tmp_path: Path) -> None:
    required = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle", "track_width")
    values = {name: getattr(CAR, name) for name in required}
    made = loaded(tmp_path, **values)
    assert not made.assumed
    # As before there were partial files.
    assert made.cg_height == 0.53
    axles = made.cg_to_front_axle + made.cg_to_rear_axle
    assert not loaded(tmp_path, **values, wheelbase=axles).assumed


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"mass": 1600.0}, "cg_to_front_axle"),
        ({"wheelbase": 2.7}, "mass"),
        ({"mass": 1600.0, "wheelbase": 0.01}, "wheelbase: expected a number of 0.05 to 20 m"),
        ({"mass": 1600.0, "wheelbase": "long"}, "wheelbase: expected a number of 0.05 to 20 m"),
        ({"mass": "heavy", "wheelbase": 2.7}, "mass"),
        ({"mass": 1600.0, "wheelbase": 2.7, "cg_to_rear_axle": "far"}, "cg_to_rear_axle"),
        (
            {"mass": 1600.0, "wheelbase": 2.7, "cg_to_rear_axle": 2.8},
            "cg_to_rear_axle is not below",
        ),
        ({"mass": 1600.0, "wheelbase": 2.7, "wheels": 4}, "wheels"),
        (
            {"mass": 1600.0, "wheelbase": 2.7, "cg_to_front_axle": 1.2, "cg_to_rear_axle": 1.2},
            "wheelbase is 2.7 m, but cg_to_front_axle and cg_to_rear_axle add up to 2.4 m",
        ),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, content: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message) as error:
        loaded(tmp_path, **content)
    assert "\n" not in str(error.value)


@pytest.mark.slow(seconds=20)
def test_what_is_assumed_is_identified_from_the_simulation(tmp_path: Path) -> None:
    c = case()
    wheelbase = c.nominal.cg_to_front_axle + c.nominal.cg_to_rear_axle
    sheet = loaded(
        tmp_path, mass=c.nominal.mass, wheelbase=wheelbase, wheel_radius=c.nominal.wheel_radius
    )
    surrogate, notes = surrogate_of(c.simulation, c.recording, sheet, lambda done, text: None)
    for name, tolerance in (("cg_to_front_axle", 0.06), ("yaw_inertia", 0.08)):
        found = surrogate.parameters[INDEX[name]]
        assert found == pytest.approx(getattr(c.nominal, name), rel=tolerance)
        assert np.isfinite(surrogate.deviations[name])
    identified = next(x for x in notes if "identified from the simulation" in x)
    assert "yaw_inertia" in identified
    assert "mass" not in identified
    assert any("assumed, as of a vehicle of this wheelbase: track_width" in x for x in notes)
