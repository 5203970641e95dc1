# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a recording is linearised again, what becomes of one that fails, how rows are grouped."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.analysed_fleets import PLACE, evidence_of, rows_at

from adk_ros.fleet.inference.analysis import MAX_PASSES, _linearised_at, analyse_fleet
from adk_ros.fleet.inference.competing_effects import SAMPLE
from adk_ros.fleet.inference.evidence import RECORDING, SIMULATION, Row
from adk_ros.fleet.inference.fleet_estimate import FleetEstimate
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.linearisation_point import has_moved, rounded_size, rounded_value
from adk_ros.fleet.inference.numerical_fleet import FleetPlan, Injection, draw_fleet
from adk_ros.fleet.inference.place_data import Place
from adk_ros.fleet.inference.place_evidence import Cell


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


@pytest.mark.parametrize("size", [0.0, 0.04, 0.31, -2.0, 7.3, -55.0, 1300.0])
def test_rounding_is_much_finer_than_what_matters(size: float) -> None:
    rounded = rounded_size(size)
    assert abs(rounded - size) <= max(0.3, 0.05 * abs(size)) / 3.0 + 1e-12
    assert rounded_size(rounded) == rounded
    # A small move usually changes nothing.
    moved = [rounded_size(size + 0.002 * i) == rounded for i in range(-5, 6)]
    assert sum(moved) >= 6


def test_a_rounded_value_stays_within_the_bounds_of_its_parameter() -> None:
    from adk_ros.fleet.inference.evidence import column_of

    delay, drag = column_of("steering_delay.delay"), column_of("aero_drag.cda")
    p = delay.parameter
    high = p.bounds()[1] - p.theta_neutral
    assert rounded_value(delay, high) == high
    unit = drag.materiality
    assert rounded_value(drag, 3.04 * unit) == pytest.approx(3.0 * unit)


def test_places_that_have_not_moved_keep_the_size_of_their_recordings() -> None:
    other, new = Cell(9, 9, 0), Cell(1, 1, 0)
    before = (a_place(3.0, other), a_place(2.0, PLACE))
    after = (a_place(3.28, other), a_place(5.03, PLACE), a_place(1.07, new))
    sizes = [place.size for place in _linearised_at(before, after)]
    assert sizes == pytest.approx([3.0, 5.0, 1.0])


def a_place(size: float, cell: Cell) -> Place:
    return Place("road_grade.grade", (cell,), size, 0.1, 20.0, 1e-6, ("drive000", "drive001"))


def test_the_first_step_is_limited() -> None:
    from adk_ros.fleet.inference.evidence import column_of
    from adk_ros.fleet.inference.fleet_selection import Selection

    wind = Injection("headwind.wind_x", Level(SHARED), 40.0)
    fleet = draw_fleet(3, FleetPlan(effects=4, injections=(wind,)))
    selection = Selection(fleet)
    model = selection.select()
    estimate = FleetEstimate(fleet, selection, model, tuple(selection.assessed(model)), (), {}, {})
    ((key, whole),) = estimate.values_of(fleet.names[0]).items()
    ((_, limited),) = replace(estimate, farthest=10.0).values_of(fleet.names[0]).items()
    assert limited == pytest.approx(10.0 * column_of(key).materiality)
    assert whole > 1.2 * limited


SLOW, REASON = "drive003", "TimeoutError: longer than 60 s"


@pytest.mark.parametrize("with_place", [False, True])
def test_a_recording_that_fails_in_a_later_pass_takes_part_as_it_is(with_place: bool) -> None:
    drag = Injection("aero_drag.cda", Level(SHARED), 6.0)
    plan = FleetPlan(cars=5, recordings=15, effects=2, bias=0.0, deviation=0.2, injections=(drag,))
    fleet = draw_fleet(3, plan)
    asked: list[str] = []
    passes: list[tuple[int, int]] = []

    def begin_pass(number: int, most: int) -> None:
        passes.append((number, most))

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        asked.extend(chosen)
        fails = at is not None and SLOW in chosen
        return (
            [
                row
                for name in chosen
                if name != SLOW or not fails
                for row in rows_at(fleet, name, at, with_place)
            ],
            {SLOW: REASON} if fails else {},
        )

    tags = {name: RecordingTags(c) for name, c in zip(fleet.names, fleet.cars, strict=True)}
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags, None, begin_pass)
    # Of few recordings all take part in all passes, which is known after the first.
    assert passes == [(1, MAX_PASSES + 1), *((n, MAX_PASSES) for n in range(2, len(passes) + 1))]
    assert 3 <= len(passes) <= MAX_PASSES
    (claim,) = found.result.claims
    assert claim.effect == "aero_drag"
    assert len(found.result.places) == with_place
    assert found.failed == {}
    assert found.outdated == {SLOW: REASON}
    notes = {r.name: r.note for r in found.result.recordings if r.note}
    assert notes == {SLOW: REASON}
    assert SLOW not in {r.name for r in found.result.worst(len(fleet.names))}
    # It does not count as moved: no pass waits for it.
    assert asked.count(SLOW) == 2
    assert len(asked) < MAX_PASSES * len(fleet.names) / 2
    if with_place:
        # Its rows do not know of the place at which the others are linearised.
        assert found.result.places[0].recordings == len(fleet.names)
        (place,) = found.estimate.places
        assert place.size == pytest.approx(6.0, rel=0.1)


def test_a_candidate_at_which_recordings_are_already_is_no_claim(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is only tried does not end among the claims when nothing is linearised for it."""
    drag = Injection("aero_drag.cda", Level(SHARED), 6.0)
    plan = FleetPlan(cars=5, recordings=15, effects=2, bias=0.0, deviation=0.2, injections=(drag,))
    fleet = draw_fleet(3, plan)

    def tried(_: object, estimate: FleetEstimate, *__: object) -> FleetEstimate:
        candidate = replace(estimate.claims[0].candidate, effect=1)
        further = replace(estimate.claims[0], candidate=candidate, size=0.1)
        return replace(estimate, claims=(*estimate.claims, further))

    monkeypatch.setattr("adk_ros.fleet.inference.analysis.NonlinearCandidates.added", tried)
    tags = {name: RecordingTags(c) for name, c in zip(fleet.names, fleet.cars, strict=True)}
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(
        lambda at, names: (
            [
                row
                for name in (fleet.names if names is None else sorted(names))
                for row in rows_at(fleet, name, at, False)
            ],
            {},
        ),
        simulation,
        lambda rows: tags,
    )
    assert [claim.effect for claim in found.result.claims] == ["aero_drag"]


def test_a_place_moves_only_the_recordings_that_pass_it() -> None:
    """Two of three routes do not, and their effects stay."""
    plan = FleetPlan(cars=5, recordings=15, effects=2, bias=0.0, deviation=0.2)
    fleet = draw_fleet(3, plan)
    passing = set(fleet.names[::3])
    asked: list[list[str]] = []

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = fleet.names if names is None else sorted(names)
        asked.append(list(chosen))
        rows = [
            row
            for name in chosen
            for row in rows_at(fleet, name, at, True)
            if row["kind"] == RECORDING or name in passing or row["cell"] != PLACE.text
        ]
        return rows, {}

    tags = {name: RecordingTags(c) for name, c in zip(fleet.names, fleet.cars, strict=True)}
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    (place,) = found.estimate.places
    assert place.cells == (PLACE,)
    assert len(place.recordings) == len(passing)
    assert set(asked[0]) == set(fleet.names)
    assert len(asked) > 1
    assert all(set(names) <= passing for names in asked[1:])
    assert passing <= {name for names in asked[1:] for name in names}


def test_evidence_is_grouped_in_one_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    class CountedRow(dict[str, Any]):
        def __getitem__(self, key: str) -> Any:
            asked.append(key)
            return super().__getitem__(key)

    class Finished(Exception):
        pass

    def estimate(rows: list[dict[str, Any]], *_: object, **__: object) -> None:
        assert [row["value"] for row in rows[1:]] == [*range(0, 600, 2), *range(1, 600, 2)]
        raise Finished

    found: list[Row] = [
        CountedRow(recording="ab"[i % 2] + f"{i:03d}", value=i, kind=RECORDING, loss_ratio=1.0)
        for i in range(600)
    ]
    simulation: Any = SimpleNamespace(evidence=SimpleNamespace(to_row=dict))
    monkeypatch.setattr("adk_ros.fleet.inference.analysis.estimate_fleet", estimate)
    # Two of each car: all of them stand for the fleet.
    tags = {f"{'ab'[i % 2]}{i:03d}": RecordingTags(f"car{i // 2}") for i in range(600)}
    with pytest.raises(Finished):
        analyse_fleet(lambda *_: (found, {}), simulation, lambda rows: tags)
    assert asked.count("recording") == len(found)


@pytest.mark.parametrize("fails", [False, True])
def test_what_decides_between_similar_effects_is_linearised_first(fails: bool) -> None:
    """A claim that is exchanged moves all recordings: most are linearised afterwards, once."""
    lag = Injection("steering_lag.tau", Level(SHARED), 6.0)
    plan = FleetPlan(cars=6, recordings=30, effects=18, bias=0.0, deviation=0.2, injections=(lag,))
    fleet = draw_fleet(3, plan)
    asked: list[list[str]] = []

    def evidence_at(
        at: FleetEstimate | None, names: Collection[str] | None
    ) -> tuple[list[Row], Mapping[str, str]]:
        chosen = list(fleet.names) if names is None else sorted(names)
        asked.append(chosen)
        # The first of the sample takes too long.
        failed = {chosen[0]: REASON} if fails and len(asked) == 2 else {}
        usable = [name for name in chosen if name not in failed]
        return [row for name in usable for row in rows_at(fleet, name, at, False)], failed

    tags = {name: RecordingTags(c) for name, c in zip(fleet.names, fleet.cars, strict=True)}
    simulation: Any = SimpleNamespace(evidence=evidence_of(fleet, 0, SIMULATION))
    found = analyse_fleet(evidence_at, simulation, lambda rows: tags)
    assert [claim.effect for claim in found.result.claims] == ["steering_lag"]
    sample = set(asked[1])
    assert len(sample) == SAMPLE
    if fails:
        assert len(asked[2]) == 1
        assert sample.isdisjoint(asked[2])
        assert found.outdated == {asked[1][0]: REASON}
        sample |= set(asked[2])
    others = [set(names) - sample for names in asked[2:] if set(names) - sample]
    assert others[0] == set(fleet.names) - sample
