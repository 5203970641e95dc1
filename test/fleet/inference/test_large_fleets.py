# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fleets of which some recordings stand for all in the early passes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.analysed_fleets import PLACE, evidence_of, rows_at

from adk_ros.fleet.inference.analysis import analyse_fleet
from adk_ros.fleet.inference.evidence import RECORDING, SIMULATION, Row
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.representative_recordings import (
    EARLY_RECORDINGS,
    representative_recordings,
)

REASON = "TimeoutError: longer than 60 s"


def large_fleet() -> tuple[FleetEvidence, dict[str, RecordingTags]]:
    """Return a fleet with a drag of all cars and the tyres of one, and its tags."""
    drag = Injection("aero_drag.cda", Level(SHARED), 6.0)
    tyre = Injection("front_tyre_stiffness.scale", Level(CAR, car="car03"), 8.0)
    plan = FleetPlan(
        cars=5, recordings=120, effects=7, bias=0.0, deviation=0.2, injections=(drag, tyre)
    )
    fleet = draw_fleet(3, plan)
    cars_and_days = zip(fleet.names, fleet.cars, fleet.days.tolist(), strict=True)
    return fleet, {name: RecordingTags(car, day) for name, car, day in cars_and_days}


def test_early_passes_of_a_large_fleet_are_of_some_recordings() -> None:
    fleet, tags = large_fleet()
    asked: list[set[str]] = []

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        asked.append(set(chosen))
        return [row for name in chosen for row in rows_at(fleet, name, at, True)], {}

    early = representative_recordings(tags)
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    late = set(fleet.names) - early
    assert len(early) == EARLY_RECORDINGS
    assert asked[0] == set(fleet.names)
    with_late = next(i for i, names in enumerate(asked[1:], 1) if names & late)
    assert set().union(*asked[1:with_late]) == early
    # The others once, at the estimate of these.
    assert Counter(name for names in asked[1:] for name in names & late) == Counter(late)
    claims = {(claim.effect, claim.level) for claim in found.result.claims}
    assert claims == {("aero_drag", "all cars"), ("front_tyre_stiffness", "car03")}
    assert all(len(c.candidate.design) == len(fleet.names) for c in found.estimate.claims)
    (place,) = found.estimate.places
    assert place.size == pytest.approx(6.0, rel=0.1)
    assert set(place.recordings) == set(fleet.names)
    assert len(found.result.recordings) == len(fleet.names)


def test_a_place_of_the_early_passes_is_that_of_all_recordings_that_pass_it() -> None:
    """A third of the recordings passes, and one of them fails when it is linearised there."""
    fleet, tags = large_fleet()
    passing = set(fleet.names[::3])
    early = representative_recordings(tags)
    slow = sorted(passing - early)[0]

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        failed = {slow: REASON} if at is not None and slow in chosen else {}
        rows = [
            row
            for name in chosen
            if name not in failed
            for row in rows_at(fleet, name, at, True)
            if row["kind"] == RECORDING or name in passing or row["cell"] != PLACE.text
        ]
        return rows, failed

    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    (place,) = found.estimate.places
    assert set(place.recordings) == passing - {slow}
    assert place.freedom >= 10.0
    assert found.outdated == {slow: REASON}
    assert {claim.effect for claim in found.result.claims} == {"aero_drag", "front_tyre_stiffness"}


def test_a_large_fleet_of_which_nothing_is_claimed_is_analysed_whole() -> None:
    fleet = draw_fleet(5, FleetPlan(cars=5, recordings=120, effects=7, bias=0.0))
    tags = {name: RecordingTags(car) for name, car in zip(fleet.names, fleet.cars, strict=True)}
    asked: list[int] = []

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        asked.append(len(chosen))
        return [row for name in chosen for row in rows_at(fleet, name, at, False)], {}

    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    assert found.result.claims == ()
    assert len(found.estimate.fleet.names) == 120
    assert asked == [120]
