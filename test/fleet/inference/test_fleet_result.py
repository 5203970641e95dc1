# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of a result in the units of the parameters."""

from __future__ import annotations

from dataclasses import replace

import pytest

from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_result import fleet_result
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

DRAG = "aero_drag.cda"


def estimate_of(fleet: FleetEvidence) -> FleetEstimate:
    selection = Selection(fleet)
    model = selection.select()
    ratios = dict.fromkeys(fleet.names, 1.0)
    return FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), ratios, {})


def test_sizes_of_scale_models_are_in_thresholds_of_their_size() -> None:
    """Drag area scales by the square of the length: what is 5 thresholds is 0.0015 m^2."""
    drag = Injection(DRAG, Level(SHARED), 5.0)
    fleet = draw_fleet(3, FleetPlan(effects=4, bias=0.0, deviation=0.3, injections=(drag,)))
    estimate = estimate_of(replace(fleet, columns=replace(fleet.columns, length_scale=0.1)))
    (claim,) = fleet_result(estimate).claims
    assert claim.size == pytest.approx(5.0 * 0.03 * 0.01, rel=0.15)
    (value,) = estimate.values_of(fleet.names[0]).values()
    assert value == pytest.approx(claim.size)
    assert value < 0.1 * column_of(DRAG).materiality
