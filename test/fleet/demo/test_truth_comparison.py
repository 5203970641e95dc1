# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What counts as named, tied, false and inside, and where a place lies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_plan import FleetSize, plan_fleet
from adk_ros.fleet.demo.truth_comparison import compare_with_truth
from adk_ros.fleet.inference.fleet_result import Claim, FleetResult, PlaceClaim


def claim(
    effect: str, kind: str, car: str = "", ties: tuple[str, ...] = (), **given: Any
) -> Claim:
    tag, value = given.get("condition", ("", ""))
    low, high = given.get("interval", (-0.2, 0.0))
    return Claim(
        effect, "scale", "-", kind, "level", car, tag, value, None, None, None, -0.1, low, high,
        30.0, 1e-9, 0.0, 0.0, ties,
    )  # fmt: skip


def injected(effect: str, kind: str, car: str = "", tag: str = "", value: str = "") -> Any:
    level = {"kind": kind, "car": car, "tag": tag, "value": value, "onset": 5.0}
    return {"effect": effect, "parameters": {"scale": 0.9}, "level": level}


def place(effect: str, *centres: tuple[float, float]) -> PlaceClaim:
    return PlaceClaim(effect, "grade", "rad", 0.1, 0.0, 0.2, 1e-9, 5, 2, 3, (), centres, ())


def compared(effects: list[Any], claims: list[Claim], places: tuple[PlaceClaim, ...] = ()):
    truth = {"effects": effects, "place": {"effect": "road_grade", "path": [[0.0, 0.0], [10, 0]]}}
    result = FleetResult((), (), tuple(claims), places, (), (), (), (), 1)
    return compare_with_truth(result, truth)


def test_found_missed_and_false() -> None:
    effects = [injected("gyro_scale", "car", "A"), injected("yaw_inertia", "shared")]
    effects += [injected("brake_torque_gain", "ramp", "B")]
    claims = [claim("gyro_scale", "car", "A"), claim("yaw_inertia", "car", "A")]
    claims += [claim("brake_torque_gain", "step", "B")]
    found = compared(effects, claims, (place("road_bank", (0.0, 0.0)),))
    assert [line.split(":")[0] for line in found.lines] == [
        "found  gyro_scale (A)",
        "MISSED yaw_inertia (all cars)",
        "found  brake_torque_gain (growing from day 5 on in B)",
        "MISSED road_grade (at a place)",
        "FALSE  yaw_inertia (level)",
        "FALSE  road_bank (at a place)",
    ]
    assert found.summary == (
        "2 of 4 injected effects are named at the right level; 2 false claims; "
        "1 of 1 sizes in their 90 % interval"
    )


def test_a_second_claim_of_one_effect_is_false() -> None:
    """Of the two the one with the injected shape counts, whichever comes first."""
    ramp, step = (claim("brake_torque_gain", kind, "B") for kind in ("ramp", "step"))
    for claims in ([ramp, step], [step, ramp]):
        found = compared([injected("brake_torque_gain", "ramp", "B")], claims)
        assert (found.named, found.false, found.sized) == (1, 1, 1)
        assert "FALSE  brake_torque_gain (level): -0.1" in found.lines


def test_a_size_outside_its_interval() -> None:
    effects = [injected("gyro_scale", "condition", tag="tyres", value="winter")]
    outside: dict[str, Any] = {"condition": ("tyres", "winter"), "interval": (-0.09, 0.0)}
    found = compared(effects, [claim("gyro_scale", "condition", **outside)])
    assert (found.named, found.sized, found.inside) == (1, 1, 0)
    found = compared(effects, [claim("gyro_scale", "condition", condition=("tyres", "summer"))])
    assert (found.named, found.false) == (0, 1)


def test_a_tie_counts_as_named_and_its_claim_not_as_false() -> None:
    effects = [injected("yaw_inertia", "car", "A"), injected("gyro_scale", "step", "B")]
    ties = ("yaw_inertia (A)", "gyro_scale (growing from day 3 on in B)")
    found = compared(effects, [claim("payload", "car", "A", ties)])
    assert (found.named, found.tied, found.false, found.sized) == (2, 2, 0, 0)
    assert "2 in a tie" in found.summary
    found = compared(effects, [claim("payload", "car", "A", ("yaw_inertia (B)",))])
    assert (found.named, found.false) == (0, 1)
    # An effect that is claimed itself needs no tie.
    both = [claim("yaw_inertia", "car", "A"), claim("payload", "car", "A", ties[:1])]
    found = compared(effects[:1], both)
    assert (found.named, found.tied, found.false) == (1, 0, 1)


def test_two_effects_that_are_a_tie_together_both_count_as_named() -> None:
    effects = [injected("yaw_inertia", "shared"), injected("gyro_scale", "shared")]
    pair = ("gyro_scale (all cars) and yaw_inertia (all cars)",)
    found = compared(effects, [claim("payload", "shared", ties=pair)])
    assert (found.named, found.tied, found.false) == (2, 2, 0)


def test_a_place_is_found_where_it_is() -> None:
    assert compared([], [], (place("road_grade", (500.0, 0.0), (30.0, 30.0)),)).named == 1
    elsewhere = compared([], [], (place("road_grade", (100.0, 0.0)),))
    assert (elsewhere.named, elsewhere.false) == (0, 1)


def test_without_a_place_every_claimed_one_is_false() -> None:
    result = FleetResult((), (), (), (place("road_grade", (0.0, 0.0)),), (), (), (), (), 1)
    found = compare_with_truth(result, {"effects": [], "place": None})
    assert (found.injected, found.named, found.false) == (0, 0, 1)
    assert found.lines == ("FALSE  road_grade (at a place): 0.1",)


def test_the_path_of_a_place_is_on_the_way_of_the_drives() -> None:
    plan = plan_fleet(3, FleetSize(2, 4, (60.0, 60.0), 30.0, 1, 1, 0))
    drives = FleetDrives(plan)
    path = drives.place_path()
    length = drives.route(0).length
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    wanted = (plan.place.end - plan.place.begin) * length
    assert abs(steps.sum() - wanted) < 20.0
    # A drive that starts at its beginning passes all of it, within a lane.
    drive = replace(plan.drives[0], start=plan.place.begin)
    pose = drives.drive(drive).pose[:, :2]
    nearest = np.linalg.norm(pose[:, None] - path[None], axis=2).min(axis=0)
    assert nearest.max() < 3.0
