# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects whose derivative at nothing misleads, found by the loss of recordings at their size."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pytest
from helpers.numerical_fleets import row_at, row_of

from adk_ros.fleet.inference.competing_effects import parameter_of
from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.nonlinear_candidates import NonlinearCandidates
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

FRICTION, DRAG = "low_friction.mu_scale", "aero_drag.cda"


def fleet_with(key: str) -> FleetEvidence:
    fault = Injection(key, Level(SHARED), -8.0)
    return draw_fleet(5, FleetPlan(effects=6, bias=0.0, deviation=0.3, injections=(fault,)))


class Recordings:
    """Recordings linearised where asked; `excess`: loss that friction leaves of each."""

    def __init__(self, fleet: FleetEvidence, excess: float) -> None:
        self.fleet, self.excess = fleet, excess
        self.asked = 0

    def __call__(
        self, at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        assert at is not None
        assert names is not None
        self.asked += 1
        if not at.claims:
            return [row_of(self.fleet, self.fleet.names.index(name)) for name in names], {}
        return [row_at(at, name, FRICTION, -6.0, self.excess) for name in names], {}


def nothing_claimed(fleet: FleetEvidence) -> FleetEstimate:
    return FleetEstimate(fleet, Selection(fleet), FleetModel((), {}), (), (), {}, {})


@pytest.fixture
def nothing_explains(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the derivatives without any effect, no candidate saves enough of the loss."""
    monkeypatch.setattr(Selection, "explains", lambda *_: False)


@pytest.mark.usefixtures("nothing_explains")
@pytest.mark.parametrize(("saves", "claims"), [(True, [FRICTION]), (False, [])])
def test_what_saves_loss_at_its_size_is_linearised_there(saves: bool, claims: list[str]) -> None:
    fleet = fleet_with(FRICTION)
    before = float(fleet.excess.max())
    recordings = Recordings(fleet, 0.0 if saves else before)
    rows = {name: [row_of(fleet, i)] for i, name in enumerate(fleet.names)}
    tried = NonlinearCandidates()
    found = tried.added(nothing_claimed(fleet), rows, recordings)
    assert [parameter_of(found, claim) for claim in found.claims] == claims
    # The selection has not claimed it yet.
    assert found.identities == frozenset()
    if saves:
        assert found.claims[0].size == pytest.approx(-6.0, abs=0.5)
    asked = recordings.asked
    assert asked > 0
    # Each is tried once.
    assert tried.added(nothing_claimed(fleet), rows, recordings).claims == ()
    assert recordings.asked == asked


@pytest.mark.usefixtures("nothing_explains")
def test_linear_effects_are_not_tried() -> None:
    fleet = fleet_with(DRAG)
    recordings = Recordings(fleet, 0.0)
    rows = {name: [row_of(fleet, i)] for i, name in enumerate(fleet.names)}
    assert NonlinearCandidates().added(nothing_claimed(fleet), rows, recordings).claims == ()
    assert recordings.asked == 0
