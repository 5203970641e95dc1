# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a recording is linearised again."""

from __future__ import annotations

import pytest

from adk_ros.fleet.inference.analysis import has_moved


@pytest.mark.parametrize(
    ("before", "after", "moved"),
    [
        ({}, {}, False),
        ({}, {"aero_drag.cda": 0.2}, False),
        ({}, {"aero_drag.cda": 0.5}, True),
        ({"aero_drag.cda": 0.5}, {}, True),
        ({"payload.mass": 3.0}, {"payload.mass": 3.2}, False),
        # A large effect may move by a share of its size.
        ({"payload.mass": 20.0}, {"payload.mass": 20.8}, False),
        ({"payload.mass": 20.0}, {"payload.mass": -20.0}, True),
        # Other effects stay where they are.
        ({"payload.mass": 3.0, "aero_drag.cda": 1.0}, {"payload.mass": 3.0}, True),
    ],
)
def test_a_recording_has_moved(
    before: dict[str, float], after: dict[str, float], moved: bool
) -> None:
    assert has_moved(before, after) is moved


def test_the_first_step_is_limited() -> None:
    from dataclasses import replace

    from adk_ros.fleet.inference.evidence import column_of
    from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
    from adk_ros.fleet.inference.fleet_selection import Selection
    from adk_ros.fleet.inference.levels import SHARED, Level
    from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

    wind = Injection("headwind.wind_x", Level(SHARED), 40.0)
    fleet = draw_fleet(3, FleetPlan(effects=4, injections=(wind,)))
    selection = Selection(fleet)
    model = selection.select()
    estimate = FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), {}, {})
    ((key, whole),) = estimate.values_of(fleet.names[0]).items()
    ((_, limited),) = replace(estimate, farthest=10.0).values_of(fleet.names[0]).items()
    assert limited == pytest.approx(10.0 * column_of(key).materiality)
    assert whole > 1.2 * limited
