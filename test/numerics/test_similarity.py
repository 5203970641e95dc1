# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Full-size vehicles keep every threshold; scale models have the similar one."""

from __future__ import annotations

import pytest

from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.similarity import length_scale, scaled_by_unit, time_scale


@pytest.mark.parametrize("wheelbase", [1.525, 1.69, 2.4, 2.7, 3.2, 6.0])
def test_full_size_vehicles_are_not_scaled(wheelbase: float) -> None:
    assert length_scale(wheelbase) == 1.0
    assert 3.0 * time_scale(length_scale(wheelbase)) == 3.0
    assert scaled_by_unit(30.0, "kg", length_scale(wheelbase)) == 30.0


@pytest.mark.parametrize("wheelbase", [0.26, 0.57, 1.05])
def test_scale_models_have_the_same_froude_number(wheelbase: float) -> None:
    size = length_scale(wheelbase)
    slowest = 3.0 * time_scale(size)
    assert slowest**2 / (GRAVITY * wheelbase) == pytest.approx(3.0**2 / (GRAVITY * 2.7))
    # An acceleration is a speed over a time.
    assert scaled_by_unit(1.0, "m/s", size) / time_scale(size) == pytest.approx(1.0)
    assert scaled_by_unit(1.0, "m/s^2", size) == 1.0
    power = scaled_by_unit(1.0, "N m", size) / time_scale(size)
    assert scaled_by_unit(1.0, "W", size) == pytest.approx(power)
