# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What else explains a fleet as well as a claim."""

from __future__ import annotations

import pytest
from helpers.numerical_fleets import with_same_derivatives

from adk_ros.fleet.inference import ties
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.ties import ties_of

DRAG, TYRE = "aero_drag.cda", "front_tyre_stiffness.scale"


def test_an_effect_of_other_recordings_is_no_tie(monkeypatch: pytest.MonkeyPatch) -> None:
    """How much it differs between cars may leave nothing to the claim: it explains other data."""
    monkeypatch.setattr(ties, "_excludes", lambda *_: True)
    one, other = (Level(CAR, car=car) for car in ("car02", "car05"))
    faults = tuple(Injection(TYRE, level, 9.0) for level in (one, other))
    plan = FleetPlan(cars=8, recordings=48, effects=7, bias=0.0, deviation=0.3, injections=faults)
    fleet = draw_fleet(7, plan)
    first = fleet.columns.first_effect
    drag, tyre = (fleet.columns.effects.index(key) for key in (DRAG, TYRE))
    selection = Selection(with_same_derivatives(fleet, first + drag, first + tyre))
    model = selection.refitted(FleetModel((Candidate(tyre, one, one.design(fleet)),), {}))
    (claim,) = selection.assessed(model)
    found = ties_of(selection, model, claim)
    assert (drag, one) in {(tie.effect, tie.level) for tie in found}
    assert all(tie.level.car in {"", "car02"} for tie in found)
