# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Further drives of the simulation: what the surrogate's error feigns in all cars is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from adk_ros.fleet.demo.fleet_drives import FleetDrives
from adk_ros.fleet.demo.fleet_plan import FleetSize, InjectedTerm, plan_fleet
from adk_ros.fleet.inference.assessment import Assessment
from adk_ros.fleet.inference.evidence import RECORDING, SIMULATION, Evidence, SimulationError
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.further_simulations import DifferentCar
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.recording_evidence import evidence_rows
from adk_ros.fleet.inference.shared_error import remaining_error, shared_error
from adk_ros.numerics.arrays import FloatArray

KEY = "aero_downforce.cla"


def known_with(fleet: FleetEvidence, vector: FloatArray, variance: float = 0.0) -> FleetEvidence:
    """Return the fleet of the same rows with a simulation whose error is known."""
    d = fleet.columns.size
    rows = [
        Evidence(
            name, RECORDING, fleet.columns, fleet.scores[i], fleet.informations[i], 150.0,
            expected_loss=float(fleet.expected_loss[i]),
            loss=float(fleet.expected_loss[i] + fleet.excess[i]),
        ).to_row()
        for i, name in enumerate(fleet.names)
    ]  # fmt: skip
    simulation = Evidence(
        "simulation", SIMULATION, fleet.columns, np.zeros(d), np.eye(d), 150.0,
        scatter=np.zeros((d, d)), blocks=30,
        error=SimulationError(vector, np.full(d, variance), 3),
    )  # fmt: skip
    return FleetEvidence.of([simulation.to_row(), *rows], {})


def in_all_cars(fleet: FleetEvidence, key: str) -> tuple[Selection, Assessment]:
    selection = Selection(fleet)
    level = Level(SHARED)
    candidate = Candidate(fleet.columns.effects.index(key), level, level.design(fleet))
    return selection, selection.assess(FleetModel((), {}), candidate)


def feigned(size: float) -> tuple[FleetEvidence, FloatArray]:
    """Return a fleet in which the surrogate's error feigns an effect, and that error."""
    fault = Injection(KEY, Level(SHARED), size)
    fleet = draw_fleet(4, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=(fault,)))
    error = np.zeros(fleet.columns.size)
    error[fleet.columns.first_effect + fleet.columns.effects.index(KEY)] = size
    return fleet, error


def test_what_the_simulation_says_of_itself_is_no_effect_of_the_cars() -> None:
    fleet, error = feigned(-2.0 * shared_error(KEY))
    known = known_with(fleet, error)
    _, found = in_all_cars(known, KEY)
    assert abs(found.size) < 0.5
    assert known.without_error().error is None
    np.testing.assert_allclose(known.without_error().scores, fleet.scores, atol=1e-9)
    np.testing.assert_allclose(known.without_error().excess, fleet.excess, rtol=1e-9)


def test_a_weaker_effect_is_found_where_the_error_is_known() -> None:
    """Twice the usual error, of which none is the simulation's."""
    fleet, error = feigned(-2.0 * shared_error(KEY))
    for one, is_claimable in ((fleet, False), (known_with(fleet, 0.0 * error), True)):
        selection, found = in_all_cars(one, KEY)
        assert selection.is_claimable(found) == is_claimable
        effect = fleet.columns.effects.index(KEY)
        left = remaining_error(KEY) if is_claimable else shared_error(KEY)
        assert one.systematic_deviation(effect) == left


def test_noise_of_the_simulation_widens_the_interval() -> None:
    fleet, error = feigned(3.0)
    effect = fleet.columns.effects.index(KEY)
    noisy = known_with(fleet, error, variance=1.0)
    expected = np.hypot(remaining_error(KEY), 1.0)
    assert noisy.systematic_deviation(effect) == pytest.approx(expected)
    (low, high), (quiet_low, quiet_high) = (
        in_all_cars(one, KEY)[1].interval for one in (noisy, known_with(fleet, error))
    )
    assert high - low > quiet_high - quiet_low + 1.0


@cache
def drives() -> FleetDrives:
    plan = plan_fleet(5, FleetSize(2, 2, (60.0, 70.0), 120.0, 2, 1, 0))
    return FleetDrives(plan.without_effects())


@cache
def simulation() -> FleetSimulation:
    fleet = drives()
    return FleetSimulation.identify(
        fleet.simulation(),
        fleet.drive(fleet.plan.drives[0]),
        fleet.nominal,
        further=[fleet.further_simulation(i) for i in range(2)],
    )


def mean_size(fleet: FleetEvidence, key: str) -> float:
    return in_all_cars(fleet, key)[1].size


@pytest.mark.slow(seconds=60)
def test_the_error_on_the_routes_is_most_of_what_seems_an_effect() -> None:
    known = simulation()
    rows = [
        row
        for planned in drives().plan.drives
        for row in evidence_rows(drives().drive(planned), known)
    ]
    fleet = FleetEvidence.of([known.evidence.to_row(), *rows], {})
    assert fleet.error is not None
    assert fleet.error.drives == 2
    keys = ("rotating_inertia.inertia", "yaw_inertia.scale")
    before = [abs(mean_size(fleet.without_error(), key)) for key in keys]
    after = [abs(mean_size(fleet, key)) for key in keys]
    assert sum(after) < 0.5 * sum(before)


@pytest.mark.slow(seconds=10)
def test_a_file_holds_the_error(tmp_path: Path) -> None:
    path = tmp_path / "simulation.npz"
    simulation().save(path)
    assert FleetSimulation.load(path).evidence.to_row() == simulation().evidence.to_row()


@pytest.mark.slow(seconds=30)
def test_a_drive_of_another_car_is_refused() -> None:
    fleet = drives()
    term = InjectedTerm("payload", {"mass": 250.0}, Level(SHARED))
    other = FleetDrives(replace(fleet.plan, terms=(term,)))
    planned = fleet.plan.drives[0]
    # Of what resembles it, any may be the clearest.
    like = r"(payload \(mass \+2|(drive_torque_gain|wheel_radius) \(scale )"
    with pytest.raises(DifferentCar, match=f"drive_000: differs .* most clearly like {like}"):
        FleetSimulation.identify(
            fleet.simulation(), fleet.drive(planned), fleet.nominal, further=[other.drive(planned)]
        )
