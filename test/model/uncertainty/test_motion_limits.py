# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of predicted motion: from training data, and in a single step."""

import numpy as np
import pytest
from helpers.train import made_record

from adk_ros.model.lifting.scaling import Scaling
from adk_ros.model.uncertainty.motion_limits import limit_step, motion_limits, step_bounds
from adk_ros.numerics.arrays import FloatArray

PLAIN = Scaling(np.zeros(3), np.ones(3), np.zeros(2), np.ones(2), np.ones(3))
LIMITS = np.array([10.0, 8.0, 4.0, 12.0])
DRY_ROAD = [12.0, 12.0, 9.0, 12.0]


def limited(before: list[float], after: list[float], limits: FloatArray = LIMITS) -> list[float]:
    """Return `after` as a step from `before` may reach it."""
    x = np.array(after)
    limit_step((before[0], before[1], before[2]), x, step_bounds(limits, PLAIN))
    return [float(value) for value in x]


def test_gentle_driving_allows_what_a_dry_road_does() -> None:
    assert motion_limits([]).tolist() == DRY_ROAD
    still = np.tile([10.0, 0.0, 0.1], (200, 1))
    assert motion_limits([made_record(still)]).tolist() == DRY_ROAD


def test_a_race_car_may_do_twice_what_it_did() -> None:
    time_s = np.arange(4000) * 0.025
    x = np.column_stack([60.0 + 25.0 * np.sin(time_s), np.zeros(4000), 0.4 * np.sin(0.5 * time_s)])
    brakes, _, turns, corners = motion_limits([made_record(x)])
    assert brakes == pytest.approx(50.0, rel=0.02)
    assert turns == 9.0
    assert corners == pytest.approx(2.0 * np.abs(x[:, 0] * x[:, 2]).max(), rel=0.02)


def test_a_step_within_the_limits_is_unchanged() -> None:
    after = [20.2, 0.1, 0.35]
    assert limited([20.0, 0.0, 0.3], after) == after


def test_changes_are_limited() -> None:
    assert limited([5.0, 0.0, 0.0], [9.0, -3.0, 1.0]) == pytest.approx([5.25, -0.2, 0.1])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_yaw_rate_does_not_exceed_the_lateral_acceleration(side: float) -> None:
    _, _, rate = limited([20.0, 0.0, 0.58 * side], [20.0, 0.0, 0.67 * side])
    assert rate == pytest.approx(0.6 * side)


def test_a_lateral_acceleration_above_the_limit_is_not_raised() -> None:
    assert limited([20.0, 0.0, 0.8], [20.0, 0.0, 0.85])[2] == pytest.approx(0.8)
    assert limited([20.0, 0.0, 0.8], [20.0, 0.0, 0.75])[2] == 0.75


def test_a_turn_on_the_spot_is_no_lateral_acceleration() -> None:
    assert limited([0.0, 0.0, 1.0], [0.0, 0.0, 1.05])[2] == 1.05


def test_without_limits_nothing_changes() -> None:
    after = [-60.0, 40.0, 19.0]
    assert limited([60.0, 0.0, 0.0], after, np.zeros(0)) == after


def test_nan_stays_nan() -> None:
    assert np.isnan(limited([20.0, 0.0, 0.1], [np.nan, np.nan, np.nan])).all()
