# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Synthetic fleets: reproducible, complete, with damaged bags and a label."""

from __future__ import annotations

import csv
import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import UsageError
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_folder import write_fleet
from adk_ros.fleet.demo.fleet_plan import FULL_SIZE, QUICK_SIZE, FleetSize, plan_fleet
from adk_ros.fleet.inference.levels import CAR, CONDITION, RAMP, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan as NumericalPlan
from adk_ros.fleet.inference.numerical_fleet import draw_fleet
from adk_ros.plant.vehicle.vehicle_parameters import load_vehicle

SMALL = FleetSize(3, 6, (20.0, 24.0), 30.0, 2, 1, 5)


def test_a_full_fleet_is_that_of_its_description() -> None:
    plan = plan_fleet(0)
    assert len(plan.drives) == 200
    assert len({d.car for d in plan.drives}) == 12
    assert sum(bool(d.damage) for d in plan.drives) == 5
    assert all(180.0 <= d.duration_s <= 600.0 for d in plan.drives)
    kinds = [term.level.kind for term in plan.terms]
    assert kinds == [SHARED] * 2 + [CAR] * 3 + [RAMP, CONDITION]
    assert plan_fleet(0) == plan
    assert plan_fleet(1) != plan
    assert FULL_SIZE.routes > plan.place.route


def test_a_fleet_without_effects_has_the_same_cars_and_roads() -> None:
    plan = plan_fleet(0)
    empty = plan.without_effects()
    assert not any(empty.effects_of(drive) for drive in empty.drives)
    assert empty.drives == plan.drives
    assert set(empty.place.parameters.values()) <= {0.0, 1.0}
    assert empty.place.parameters.keys() == plan.place.parameters.keys()


def test_the_cars_are_of_the_vehicle_of_the_plan() -> None:
    plan = replace(plan_fleet(3, SMALL), vehicle="light_truck")
    mass = load_vehicle("light_truck").mass
    fleet = FleetDrives(plan)
    assert fleet.nominal.mass == mass
    assert all(abs(car.vehicle.mass / mass - 1.0) < 0.1 for car in fleet.cars.values())


def test_effects_of_a_drive_are_those_of_its_levels() -> None:
    plan = plan_fleet(0)
    shared = {t.effect for t in plan.terms if t.level.kind == SHARED}
    for drive in plan.drives[:30]:
        effects = set(plan.effects_of(drive))
        assert shared <= effects
        assert ("steering_delay" in effects) == (drive.software == "2.1")
    drift = next(t for t in plan.terms if t.level.kind == RAMP)
    own = [d for d in plan.drives if d.car == drift.level.car]
    shares = [plan.share(drift.level, d) for d in own]
    assert shares[0] == 0.0
    assert np.all(np.diff(shares) >= 0.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_shares_are_the_designs_of_the_levels(seed: int) -> None:
    """What grows in one car reaches its full size in the car's last usable recording."""
    plan = plan_fleet(seed, QUICK_SIZE)
    usable = [d for d in plan.drives if not d.damage]
    fleet = draw_fleet(1, NumericalPlan(recordings=len(usable), effects=1))
    fleet = replace(
        fleet,
        cars=tuple(d.car for d in usable),
        days=np.array([d.day for d in usable]),
        tags=tuple(d.tags for d in usable),
    )
    levels = [term.level for term in plan.terms] + [Level(RAMP, onset=20.0)]
    for level in levels:
        shares = [plan.share(level, d) for d in usable]
        np.testing.assert_allclose(shares, level.design(fleet), err_msg=level.text)
        assert max(shares) == 1.0
    # A damaged drive after the last usable one has no more than the full size.
    assert all(plan.share(level, d) <= 1.0 for level in levels for d in plan.drives)


def test_drives_lie_in_one_map_and_repeat() -> None:
    plan = plan_fleet(3, SMALL)
    drives = FleetDrives(plan)
    first, again = (FleetDrives(plan).drive(plan.drives[0]), drives.drive(plan.drives[0]))
    np.testing.assert_array_equal(first.imu, again.imu)
    planned = plan.drives[0]
    assert np.abs(first.pose[:, 0] - 5000.0 * (1 + planned.route)).max() < 2500.0


@pytest.mark.slow(seconds=15)
def test_a_folder_has_bags_tags_and_truth(tmp_path: Path) -> None:
    plan = plan_fleet(3, SMALL)
    out = tmp_path / "fleet"
    write_fleet(plan, out)
    rows = list(csv.DictReader((out / "drives" / "fleet.csv").open()))
    assert [row["recording"] for row in rows] == [d.name for d in plan.drives]
    bags = {path.name for path in (out / "drives").iterdir() if path.is_dir()}
    assert bags == {d.name for d in plan.drives}
    assert {p.name for p in (out / "simulation_routes").iterdir()} == {"route_1", "route_2"}
    truth = json.loads((out / "truth.json").read_text())
    assert len(truth["damaged"]) == 5
    empty = next(name for name, how in truth["damaged"].items() if how == "empty")
    assert all(f.stat().st_size == 0 for f in (out / "drives" / empty).iterdir())
    with pytest.raises(UsageError, match="give a new folder"):
        write_fleet(plan, out)


@pytest.mark.slow(seconds=20)
def test_processes_write_the_same_fleet(tmp_path: Path) -> None:
    plan = plan_fleet(4, FleetSize(2, 3, (10.0, 12.0), 20.0, 1, 1, 1))
    counts = []
    write_fleet(plan, tmp_path / "one")
    write_fleet(plan, tmp_path / "two", lambda *given: counts.append(given), workers=2)
    # Three drives, the simulation, and that on the only route.
    assert counts == [(i, 5) for i in range(1, 6)]
    one, two = (contents(tmp_path / name) for name in ("one", "two"))
    assert one == two
    assert "truth.json" in one


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.slow(seconds=20)
def test_an_interrupted_fleet_continues(tmp_path: Path) -> None:
    """Without the truth, the demonstration would analyse what is there."""

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    plan = plan_fleet(4, FleetSize(2, 3, (10.0, 12.0), 20.0, 1, 1, 1))
    out = tmp_path / "fleet"
    with pytest.raises(KeyboardInterrupt):
        write_fleet(plan, out, stop)
    assert not (out / "truth.json").exists()
    with pytest.raises(UsageError, match="give a new folder"):
        write_fleet(plan_fleet(5, plan.size), out)
    written = {path: path.stat().st_mtime_ns for path in (out / "drives").rglob("*.mcap")}
    assert len(written) == 1
    # What was half-written when the process was killed.
    (out / ".writing" / plan.drives[2].name).mkdir(parents=True)
    counts: list[tuple[int, int]] = []
    write_fleet(plan, out, lambda *given: counts.append(given))
    assert counts == [(4, 5), (5, 5)]
    assert all(path.stat().st_mtime_ns == at for path, at in written.items())
    write_fleet(plan, tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")


def test_one_process_at_a_time_writes_a_fleet(tmp_path: Path) -> None:
    plan = plan_fleet(4, FleetSize(1, 1, (10.0, 10.0), 20.0, 1, 0, 0))
    out = tmp_path / "fleet"
    refusals: list[str] = []

    def second() -> None:
        with pytest.raises(UsageError) as refused:
            write_fleet(plan, out)
        refusals.append(str(refused.value))

    def meanwhile(done: int, total: int) -> None:
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()

    write_fleet(plan, out, meanwhile)
    assert len(refusals) == 3
    assert all("is in use by process" in text for text in refusals)
    assert not (out / ".writing").exists()
