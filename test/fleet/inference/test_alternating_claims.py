# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Claims that alternate between linearisations: the better one stays."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.analysed_fleets import evidence_of, rows_at

from adk_ros.fleet.inference.alternating_claims import AlternatingClaims
from adk_ros.fleet.inference.analysis import analyse_fleet
from adk_ros.fleet.inference.evidence import SIMULATION, Evidence, Row
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate, estimate_fleet
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.fleet_model import FleetModel
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

DRAG, TYRE, FAULT = (0, Level(SHARED)), (6, Level(SHARED)), (3, Level(CAR, car="car04"))
ONE, OTHER = frozenset({DRAG, TYRE}), frozenset({DRAG, FAULT})


@pytest.mark.parametrize(
    ("loss_of_one", "loss_of_other", "refused"),
    [(100.0, 900.0, FAULT), (900.0, 100.0, TYRE)],
)
def test_of_two_that_alternate_the_worse_is_refused(
    loss_of_one: float, loss_of_other: float, refused: object
) -> None:
    claims = AlternatingClaims()
    assert not claims.settle(ONE, loss_of_one, OTHER)
    assert claims.refused == frozenset()
    # Linearised at the other, the fleet shows the one again.
    assert claims.settle(OTHER, loss_of_other, ONE) is (refused == TYRE)
    assert claims.refused == {refused}


def test_claims_that_stay_or_are_new_are_no_alternation() -> None:
    claims = AlternatingClaims()
    assert not claims.settle(ONE, 100.0, ONE)
    assert not claims.settle(ONE, 100.0, OTHER)
    assert not claims.settle(OTHER, 100.0, frozenset({DRAG}))
    assert claims.refused == frozenset()


def test_what_is_claimed_only_from_afar_is_refused() -> None:
    """Though it leaves less of the loss: linearised at it, it is not claimable."""
    claims = AlternatingClaims()
    more = ONE | {FAULT}
    claims.settle(ONE, 100.0, more)
    assert not claims.settle(more, 50.0, ONE)
    assert claims.refused == {FAULT}
    claims = AlternatingClaims()
    claims.settle(more, 50.0, ONE)
    assert claims.settle(ONE, 100.0, more)
    assert claims.refused == {FAULT}


def test_fleets_do_not_alternate(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drag that is claimed wherever the fleet is not linearised at it, and only there."""
    drag = Injection("aero_drag.cda", Level(SHARED), 6.0)
    plan = FleetPlan(cars=5, recordings=15, effects=1, bias=0.0, deviation=0.2, injections=(drag,))
    fleet = draw_fleet(3, plan)
    rows_are_at: list[bool] = []

    def alternating(rows: list[Row], *given: Any, **options: Any) -> FleetEstimate:
        found = estimate_fleet(rows, *given, **options)
        points = [Evidence.from_row(row).point for row in rows]
        rows_are_at.append(any(point is not None and point.any() for point in points))
        if not rows_are_at[-1]:
            return found
        model = FleetModel((), {})
        return replace(found, model=model, claims=())

    monkeypatch.setattr("adk_ros.fleet.inference.analysis.estimate_fleet", alternating)
    tags = {name: RecordingTags(c) for name, c in zip(fleet.names, fleet.cars, strict=True)}
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))

    def evidence_at(at: FleetEstimate | None, names: Any) -> tuple[list[Row], dict[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        return [row for name in chosen for row in rows_at(fleet, name, at, False)], {}

    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    # The last is an estimate of the rows before, without the drag.
    assert rows_are_at == [False, True, False, True, False, False]
    assert found.result.claims == ()
