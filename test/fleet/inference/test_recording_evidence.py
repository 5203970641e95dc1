# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of simulated recordings: the injected effect, and the file of the simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from adk_ros.errors import UsageError
from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_plan import FleetPlan, FleetSize, InjectedTerm, plan_fleet
from adk_ros.fleet.inference.evidence import Evidence
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.place_evidence import Cell, cells_along
from adk_ros.fleet.inference.recording_evidence import UNPLACED, PlacedValue, evidence_rows
from adk_ros.numerics.arrays import FloatArray

pytestmark = pytest.mark.slow(seconds=60)


@cache
def drives() -> FleetDrives:
    plan = plan_fleet(5, FleetSize(2, 3, (60.0, 70.0), 120.0, 2, 1, 0))
    drag = InjectedTerm("aero_drag", {"cda": 0.2}, Level(SHARED))
    return FleetDrives(FleetPlan(plan.seed, plan.size, (drag,), plan.place, plan.drives))


@cache
def simulation() -> FleetSimulation:
    fleet = drives()
    recording = fleet.drive(fleet.plan.drives[0])
    return FleetSimulation.identify(fleet.simulation(), recording, fleet.nominal)


def drag_of(one: Evidence) -> float:
    """The drag area that fits best, with all nuisance parameters."""
    first = one.columns.first_effect
    index = np.append(np.arange(first), first + one.columns.effects.index("aero_drag.cda"))
    normal = one.information[np.ix_(index, index)] + np.diag([1.0] * first + [0.0])
    return float(np.linalg.solve(normal, one.score[index])[-1] * 0.03)


def test_the_score_points_to_the_injected_effect() -> None:
    fleet = drives()
    planned = next(d for d in fleet.plan.drives if d.route != fleet.plan.place.route)
    rows = evidence_rows(fleet.drive(planned), simulation())
    one = Evidence.from_row(rows[0])
    size = drag_of(one)
    assert size == pytest.approx(0.2, abs=0.05)
    # Linearised at the truth, the same absolute evidence.
    there = evidence_rows(fleet.drive(planned), simulation(), {"aero_drag.cda": 0.2})
    two = Evidence.from_row(there[0])
    assert drag_of(two) == pytest.approx(size, rel=0.05)
    assert two.loss < one.loss
    assert {row["kind"] for row in rows[1:]} == {"place"}
    assert rows[0][UNPLACED] is False


def test_where_a_place_is_claimed_a_recording_says_nothing_of_other_effects() -> None:
    fleet = drives()
    at_place = next(d for d in fleet.plan.drives if d.route == fleet.plan.place.route)
    log = fleet.drive(replace(at_place, start=fleet.plan.place.begin - 0.05, duration_s=90.0))
    key = {"road_grade": "road_grade.grade", "road_bank": "road_bank.bank"}[
        fleet.plan.place.effect
    ]
    cells = tuple({Cell(*row) for row in cells_along(_poses_on(fleet)).tolist()})
    whole = Evidence.from_row(evidence_rows(log, simulation())[0])
    rows = [
        evidence_rows(log, simulation(), local=[PlacedValue(key, cells, size)])
        for size in (0.02, 0.04)
    ]
    one, other = (Evidence.from_row(found[0]) for found in rows)
    assert 0.5 * whole.counted_s < one.counted_s < whole.counted_s - 3.0
    assert one.counted_s == other.counted_s
    assert one.expected_loss < whole.expected_loss
    # Its size does not matter, beyond what whitening remembers of it.
    k = one.columns.first_effect + one.columns.effects.index("aero_drag.cda")
    assert one.score[k] == pytest.approx(other.score[k], rel=0.01)
    # The rows of places have all of them.
    assert {row["cell"] for row in rows[0][1:]} == {
        row["cell"] for row in evidence_rows(log, simulation())[1:]
    }


def _poses_on(fleet: FleetDrives) -> FloatArray:
    path = fleet.place_path()
    step = np.diff(path, axis=0)
    return np.column_stack([path[:-1], np.arctan2(step[:, 1], step[:, 0])])


def test_a_drive_that_begins_at_its_own_origin_has_no_places() -> None:
    fleet = drives()
    log = fleet.drive(fleet.plan.drives[0])
    log.pose[:, :2] -= log.pose[0, :2]
    (row,) = evidence_rows(log, simulation())
    assert row[UNPLACED] is True


def test_a_file_holds_the_simulation(tmp_path: Path) -> None:
    path = tmp_path / "simulation.npz"
    simulation().save(path)
    loaded = FleetSimulation.load(path)
    recording = drives().drive(drives().plan.drives[0])
    one, two = (evidence_rows(recording, s)[0] for s in (simulation(), loaded))
    assert one == two
    assert loaded.evidence.to_row() == simulation().evidence.to_row()
    path.write_bytes(b"nothing")
    with pytest.raises(UsageError, match="is no simulation of a fleet"):
        FleetSimulation.load(path)
