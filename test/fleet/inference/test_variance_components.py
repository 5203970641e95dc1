# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Degrees of freedom of sizes whose variance is estimated."""

from __future__ import annotations

import numpy as np
import pytest

from adk_ros.fleet.inference.fleet_model import Candidate
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.mixed_model import Components, MixedModel
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, draw_fleet
from adk_ros.fleet.inference.variance_components import degrees_of_freedom

COMPONENTS = Components(np.array([2.0]), np.array([2.0]))
"""Between recordings and between cars: far more than noise."""


def freedom(cars: int, recordings: int, level: Level) -> float:
    plan = FleetPlan(cars=cars, recordings=recordings, effects=2, bias=0.0, deviation=0.1)
    fleet = draw_fleet(1, plan)
    term = Candidate(0, level, level.design(fleet)).term
    return degrees_of_freedom(MixedModel(fleet, (0,)), [term], COMPONENTS, 0)


@pytest.mark.parametrize("cars", [30, 28])
def test_without_repeated_recordings_all_of_them_count(cars: int) -> None:
    """Whatever part of their deviation the fit calls one of cars."""
    assert freedom(cars, 30, Level(SHARED)) == pytest.approx(29.0, rel=0.1)


def test_repeated_recordings_separate_cars_from_recordings() -> None:
    # Nearly all of the variance is between cars.
    assert freedom(6, 60, Level(SHARED)) == pytest.approx(5.0, rel=0.3)
    # A mean over the two recordings of a car depends on the part of each, which is not known.
    assert freedom(28, 30, Level(CAR, car="car01")) < 10.0
