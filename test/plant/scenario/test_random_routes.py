# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which drives count as spun, and which roads are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.plant.environment.road import ROAD_SPEED
from adk_ros.plant.scenario.random_routes import (
    ROAD_STYLES,
    AlwaysSpins,
    random_route,
    slower_routes,
    spins,
)


@pytest.mark.parametrize(
    ("lateral", "spun"),
    [([0.1, -0.4], False), ([0.1, -30.0], True), ([0.1, np.nan], True), ([0.1, np.inf], True)],
)
def test_a_drive_that_ends_in_no_number_has_spun(lateral: list[float], spun: bool) -> None:
    assert spins(np.array([0.2, 0.3]), np.array(lateral)) is spun


def test_a_bend_that_is_shorter_than_its_transition_is_drawn_again() -> None:
    """30 degrees of a radius of 25 m are 13 m."""
    roads = ROAD_STYLES["town"]._replace(
        radius=(14.0, 60.0), straight=(60.0, 350.0), transition=15.0, lap=(1000.0, 5000.0)
    )
    shortest = []
    for seed in range(30):
        segments, length = random_route(np.random.default_rng(seed), roads)
        assert roads.lap[0] < length < roads.lap[1]
        bends = [x.bend for x in segments if x.bend is not None]
        shortest.append(min(abs(np.radians(x.angle_deg)) * x.radius for x in bends))
    assert 15.0 <= min(shortest) < 17.0


def test_after_the_slowest_try_the_vehicle_always_spins() -> None:
    segments, _ = random_route(np.random.default_rng(0), ROAD_STYLES["track"])
    tries = slower_routes("drive", segments, [], ROAD_STYLES["track"], 4.0)
    speeds = [float(next(tries)[0].table[:, ROAD_SPEED].max()) for _ in range(9)]
    with pytest.raises(AlwaysSpins, match="drive: the car spins at every speed that is tried"):
        next(tries)
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] < 0.5 * speeds[0]
