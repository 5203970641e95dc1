# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rate of false alarms is divided among the questions, then among the tests of each."""

from __future__ import annotations

import pytest

from adk_ros.fleet.inference.error_rates import ErrorRates
from adk_ros.fleet.inference.levels import CAR, CONDITION, RAMP, SHARED, STEP, Level
from adk_ros.mismatch.library.criteria import FAMILYWISE_ERROR_RATE

CARS = [Level(CAR, car=f"car{i}") for i in range(4)]
TRENDS = [Level(RAMP, onset=3.0), Level(STEP, onset=5.0), Level(STEP, car="car1", onset=5.0)]
CONDITIONS = [Level(CONDITION, tag="rain", value=value) for value in ("no", "yes")]
LEVELS = [Level(SHARED), *CARS, *CONDITIONS, *TRENDS]


def test_all_tests_together_have_the_rate() -> None:
    rates = ErrorRates.of(LEVELS, 10, 200)
    together = 10 * sum(map(rates.of_level, LEVELS)) + 200 * rates.of_place
    assert together == pytest.approx(FAMILYWISE_ERROR_RATE)
    assert rates.tests == 10 * len(LEVELS) + 200


def test_a_question_is_not_harder_because_of_others() -> None:
    rates = ErrorRates.of(LEVELS, 10, 200)
    more_cars = ErrorRates.of([*LEVELS, *(Level(CAR, car=f"new{i}") for i in range(40))], 10, 900)
    assert more_cars.of_level(Level(SHARED)) == rates.of_level(Level(SHARED)) == rates.largest
    assert more_cars.of_level(CARS[0]) == pytest.approx(rates.of_level(CARS[0]) * 4 / 44)
    assert more_cars.of_place == pytest.approx(rates.of_place * 200 / 900)
    assert rates.of_level(TRENDS[0]) == rates.of_level(TRENDS[2])
    assert rates.tests_of(CARS[0]) == 40


def test_what_is_not_asked_has_no_share() -> None:
    rates = ErrorRates.of([Level(SHARED)], 10, 0)
    assert rates.of_level(Level(SHARED)) == pytest.approx(FAMILYWISE_ERROR_RATE / 10)
    assert ErrorRates.of([], 0, 0).tests == 1
