# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Claims and similar effects, compared by the loss of recordings linearised at each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
import pytest
from helpers.numerical_fleets import evidence_of, row_at, row_of

from adk_ros.fleet.inference.competing_effects import (
    Sample,
    competing_keys,
    exchanged_for_competing,
    local_fit,
    parameter_of,
)
from adk_ros.fleet.inference.evidence import Row, effect_columns
from adk_ros.fleet.inference.fleet_candidates import Identity, identity
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_selection import Selection
from adk_ros.fleet.inference.levels import CAR, SHARED, Level
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet

DELAY, LAG = "drive_torque_delay.delay", "drive_torque_lag.tau"


@pytest.mark.parametrize(
    ("key", "competing"),
    [
        ("steering_delay.delay", {"steering_lag.tau", "clock_offset.offset"}),
        (LAG, {DELAY}),
        # Other units, so that the size of a claim says nothing on it.
        ("tyre_relaxation.length", set()),
        # Linear: the linear problem compares them.
        ("rolling_resistance.crr", set()),
    ],
)
def test_similar_effects_of_one_unit(key: str, competing: set[str]) -> None:
    assert set(competing_keys(key)) == competing


def test_a_local_fit_stays_within_bounds() -> None:
    """A delay is positive: what a negative one would gain is not gained."""
    fleet = delayed_fleet(Level(SHARED))
    for sign, size in ((1.0, 6.0), (-1.0, 0.0)):
        one = evidence_of(fleet, 0)
        fit = local_fit(replace(one, score=sign * one.score), {DELAY: 0.01})
        assert fit.sizes[DELAY] == pytest.approx(size, abs=1.5)
        assert fit.sizes[DELAY] >= 0.0


def test_a_lag_that_was_claimed_as_a_delay() -> None:
    """Only the loss of recordings that are linearised at the lag shows that it is one."""
    truth = 7.0
    estimate, rows = claimed_delay(Level(CAR, car="car02"))
    asked: list[tuple[str, ...]] = []

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        assert at is not None
        assert names is not None
        asked.append(tuple(names))
        return [row_at(at, name, LAG, truth) for name in names], {}

    found, worse = exchanged_for_competing(estimate, rows, evidence_at)
    assert claimed(found) == [(LAG, "car02")]
    level = Level(CAR, car="car02")
    assert worse == {about(estimate, DELAY, level): about(estimate, LAG, level)}
    assert found.claims[0].size == pytest.approx(truth, abs=0.5)
    # Only recordings of the car are linearised again.
    assert all(estimate.fleet.cars[estimate.fleet.names.index(n)] == "car02" for n in asked[0])
    delay = {about(estimate, DELAY, level)}
    assert exchanged_for_competing(estimate, rows, evidence_at, delay) == (estimate, {})


@pytest.mark.parametrize("reason", ["worse", "as good", "no evidence"])
def test_a_claim_stays(reason: str) -> None:
    """Where nothing explains the data better by more than chance, or nothing can be computed."""
    level = Level(CAR, car="car02")
    estimate, rows = claimed_delay(level)

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        assert at is not None
        assert names is not None
        if reason == "no evidence":
            return [], dict.fromkeys(names, "timed out")
        if reason == "as good":
            return [row_at(at, name, LAG, 7.0, excess_of(estimate, name)) for name in names], {}
        return [rows[name][0] for name in names], {}

    found, worse = exchanged_for_competing(estimate, rows, evidence_at)
    assert found is estimate
    # What is as good is none of both, and nothing is said of what cannot be computed.
    lag, delay = (about(estimate, key, level) for key in (LAG, DELAY))
    assert worse == ({lag: delay} if reason == "worse" else {})


def test_only_recordings_that_are_linearised_at_the_claim_are_compared() -> None:
    estimate, rows = claimed_delay(Level(CAR, car="car02"))
    of_car = [
        n for n, c in zip(estimate.fleet.names, estimate.fleet.cars, strict=True) if c == "car02"
    ]
    asked: set[str] = set()

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        assert at is not None
        assert names is not None
        asked.update(names)
        return [row_at(at, name, LAG, 7.0) for name in names], {}

    some = {name: rows[name] for name in rows if name != of_car[0]}
    found, _ = exchanged_for_competing(estimate, some, evidence_at)
    assert claimed(found) == [(LAG, "car02")]
    assert asked == set(of_car[1:])
    none = {name: rows[name] for name in rows if name not in of_car}
    assert exchanged_for_competing(estimate, none, evidence_at) == (estimate, {})


def test_recordings_with_little_else_are_compared() -> None:
    """What a large other effect leaves is in the margin: it decides nothing."""
    estimate, rows = claimed_delay(Level(SHARED))
    fleet = estimate.fleet
    other = np.arange(len(fleet.names)) % 2 == 0
    estimate.selection.null_excess = np.where(other, 1e6, 100.0)
    sample = Sample.of(estimate, estimate.claims[0], rows)
    assert not any(other[fleet.names.index(name)] for name in sample.names)
    assert sample.margin < 10.0
    given = Sample.of(estimate, estimate.claims[0], rows, weights=other.astype(np.float64))
    assert all(other[fleet.names.index(name)] for name in given.names)


def delayed_fleet(level: Level) -> FleetEvidence:
    keys = [column.key for column in effect_columns()]
    plan = FleetPlan(
        effects=keys.index(LAG) + 1,
        bias=0.0,
        deviation=0.3,
        injections=(Injection(DELAY, level, 6.0),),
    )
    return draw_fleet(11, plan)


def claimed_delay(level: Level) -> tuple[FleetEstimate, dict[str, list[Row]]]:
    """Return an estimate whose only claim is a delay, and the evidence at it."""
    fleet = delayed_fleet(level)
    selection = Selection(fleet)
    model = selection.select()
    estimate = FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), {}, {})
    assert claimed(estimate) == [(DELAY, level.text)]
    return estimate, {name: [row_of(fleet, i)] for i, name in enumerate(fleet.names)}


def claimed(estimate: FleetEstimate) -> list[tuple[str, str]]:
    return [(parameter_of(estimate, c), identity(c.candidate)[1].text) for c in estimate.claims]


def about(estimate: FleetEstimate, key: str, level: Level) -> Identity:
    return estimate.fleet.columns.effects.index(key), level


def excess_of(estimate: FleetEstimate, name: str) -> float:
    """Return the loss that the claims of an estimate leave of a recording."""
    one = evidence_of(estimate.fleet, estimate.fleet.names.index(name))
    return local_fit(one, estimate.values_of(name)).excess
