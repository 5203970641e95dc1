# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The interval of a change point, on numerical fleets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel, likelihood
from adk_ros.fleet.inference.levels import RAMP, STEP, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.onset_interval import onset_interval

CAR, ONSET = "car03", 30.0
DAYS = np.linspace(0.0, 60.0, 48)[2::4]
"""Days of the recordings of the car."""


def claimed(kind: str, size: float, deviation: float, seed: int = 0) -> tuple[float, float, float]:
    """Return the likeliest change point of an injected trend, and the ends of its interval."""
    level = Level(kind, car=CAR, onset=ONSET)
    plan = FleetPlan(
        cars=4, effects=2, recordings=48, bias=0.0, deviation=deviation,
        injections=(Injection("aero_drag.cda", level, size),),
    )  # fmt: skip
    fleet = draw_fleet(seed, plan)

    def model(day: float) -> FleetModel:
        moved = replace(level, onset=day)
        return FleetModel((Candidate(0, moved, moved.design(fleet)),), {0: (0.1, 0.1)})

    best = max(np.linspace(3.0, 50.0, 40).tolist(), key=lambda day: likelihood(fleet, model(day)))
    return best, *onset_interval(fleet, model(best), 0)


def test_a_plain_step_begins_between_two_recordings() -> None:
    day, low, high = claimed(STEP, size=12.0, deviation=0.3)
    before, after = DAYS[DAYS < ONSET][-1], DAYS[DAYS > ONSET][0]
    assert (low, high) == pytest.approx((before, after), abs=0.02)
    assert low <= day <= high


def test_a_weak_step_has_a_wide_interval() -> None:
    day, low, high = claimed(STEP, size=3.0, deviation=1.0, seed=2)
    assert low < ONSET < high
    assert low <= day <= high
    # Of several recordings it is open whether they have the effect.
    first, last = np.searchsorted(DAYS, (low, high))
    assert last - first >= 2


def test_intervals_of_weak_steps_hold_the_onset() -> None:
    """They should in nine of ten fleets; with the quantile of chi-square fewer would."""
    found = [claimed(STEP, size=2.0, deviation=1.0, seed=seed)[1:] for seed in range(30)]
    assert sum(low <= ONSET <= high for low, high in found) >= 26


def test_intervals_of_ramps_hold_the_onset() -> None:
    """They should in nine of ten fleets."""
    found = [claimed(RAMP, size=9.0, deviation=0.5, seed=seed) for seed in range(10)]
    assert all(low < day < high for day, low, high in found)
    assert all(high - low < 10.0 for _, low, high in found)
    assert sum(low <= ONSET <= high for _, low, high in found) >= 8


def test_an_interval_ends_at_the_recordings_of_the_car() -> None:
    """Where nothing acts a ramp may begin at any time, except by chance in one fleet of ten."""
    level = Level(RAMP, car=CAR, onset=float(DAYS[0]))
    plan = FleetPlan(cars=4, effects=2, recordings=48, bias=0.0, deviation=0.3)
    found = []
    for seed in range(6):
        fleet = draw_fleet(seed, plan)
        model = FleetModel((Candidate(0, level, level.design(fleet)),), {0: (0.1, 0.1)})
        found.append(onset_interval(fleet, model, 0))
    assert all(DAYS[0] <= low < high <= DAYS[-1] for low, high in found)
    assert pytest.approx((DAYS[0], DAYS[-1])) in found
