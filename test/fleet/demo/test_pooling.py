# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""scripts/fleet_pooling.py: what counts as found by one long recording, and the totals."""

from __future__ import annotations

import pytest
from fleet_pooling import Fleet, LongRecording, claims_of, totals, with_unmodelled

from adk_ros.fleet.demo import fleet_drives
from adk_ros.fleet.demo.fleet_plan import FleetSize, plan_fleet
from adk_ros.fleet.demo.truth_comparison import TruthComparison, compare_with_truth
from adk_ros.fleet.inference.fleet_result import FleetResult
from adk_ros.mismatch.inference.interval import Interval
from adk_ros.mismatch.inference.result import IdentifiedEffect
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME

FLEET = Fleet("yaw_inertia", 3, FleetSize(6, 30, (60.0, 60.0), 300.0, 3, 0, 0), 0.1)


def identified(
    name: str, value: float, half: float = 0.01, kind: str = ALWAYS, ties: tuple[str, ...] = ()
) -> IdentifiedEffect:
    """Return an effect of one parameter, as an analysis identifies it."""
    parameter = EFFECTS[name].parameters[0]
    interval = Interval(value, value - half, value + half, parameter.unit)
    return IdentifiedEffect(
        EFFECTS[name], {parameter.name: interval}, 0.9, list(ties), kind, [], 30.0, ()
    )


def compared(*effects: IdentifiedEffect) -> TruthComparison:
    """Compare effects with a yaw inertia of 1.03 that is injected."""
    level = {"kind": "shared", "car": "", "tag": "", "value": "", "onset": 0.0}
    known = {"effect": "yaw_inertia", "parameters": {"scale": 1.03}, "level": level}
    result = FleetResult((), (), claims_of(effects), (), (), (), (), (), 0)
    return compare_with_truth(result, {"effects": [known], "place": None})


@pytest.mark.parametrize(
    ("effects", "named", "tied", "false", "inside", "sized"),
    [
        ([], 0, 0, 0, 0, 0),
        ([identified("yaw_inertia", 1.035)], 1, 0, 0, 1, 1),
        ([identified("yaw_inertia", 1.05)], 1, 0, 0, 0, 1),
        ([identified("payload", 90.0)], 0, 0, 1, 0, 0),
        ([identified("payload", 90.0, ties=("yaw_inertia",))], 1, 1, 0, 0, 0),
        ([identified("yaw_inertia", 1.03), identified("payload", 90.0)], 1, 0, 1, 1, 1),
        # The injected effect acts always.
        ([identified("yaw_inertia", 1.03, kind=TIME)], 0, 0, 1, 0, 0),
        ([identified("road_grade", 0.02, kind=PLACE, ties=("yaw_inertia",))], 0, 0, 1, 0, 0),
    ],
)
def test_effects_of_one_recording_count_as_those_of_a_fleet(
    effects: list[IdentifiedEffect], named: int, tied: int, false: int, inside: int, sized: int
) -> None:
    one = compared(*effects)
    counts = (one.named, one.tied, one.false, one.inside, one.sized)
    assert counts == (named, tied, false, inside, sized)


def test_sizes_are_differences_from_neutral() -> None:
    (claim,) = claims_of([identified("yaw_inertia", 1.03, 0.02)])
    assert (claim.size, claim.low, claim.high) == pytest.approx((0.03, 0.01, 0.05))
    # Of a parameter that enters by its reciprocal, it is the value.
    (claim,) = claims_of([identified("power_limit", 7e4, 1e3)])
    assert (claim.size, claim.low, claim.high) == pytest.approx((7e4, 6.9e4, 7.1e4))


def test_an_unknown_cause_is_false_where_nothing_else_is_missing() -> None:
    assert with_unmodelled(compared()).false == 0
    found = with_unmodelled(compared(identified("yaw_inertia", 1.03)))
    assert (found.named, found.false) == (1, 1)
    assert found.lines[-1] == "FALSE  something of unknown cause"


def test_the_totals() -> None:
    found, tied = (TruthComparison((), 1, 1, ties, 0, 1, 1 - ties) for ties in (0, 1))
    wrong, missed = (TruthComparison((), 1, 0, 0, false, 0, 0) for false in (2, 0))
    assert totals([found, tied, wrong, missed], [1.0 - 1e-9, 1.5, 0.5, 0.5]) == {
        "effects named": "2 of 4 (50 %), 1 in a tie",
        "those of a threshold and more": "2 of 2 (100 %), 1 in a tie",
        "with a false claim": "1 of 4 (25 %)",
        "sizes in their 90 % interval": "1 of 2 (50 %)",
    }
    nothing = TruthComparison((), 0, 0, 0, 0, 0, 0)
    assert totals([nothing], [0.0])["effects named"] == "-"


def test_one_recording_has_the_duration_of_the_fleet() -> None:
    long = LongRecording.of(FLEET)
    assert (FLEET.label, long.label) == ("30 recordings of 60 s", "1 recording of 1800 s")
    assert long.thresholds == FLEET.thresholds
    further_s = FLEET.size.routes * fleet_drives._FURTHER_S
    assert long.size.simulation_s == FLEET.size.simulation_s + further_s
    (planned,) = plan_fleet(long.seed, long.size).drives
    assert planned.duration_s == sum(
        drive.duration_s for drive in plan_fleet(FLEET.seed, FLEET.size).drives
    )


def test_one_recording_is_of_a_car_and_on_a_route_of_the_fleet() -> None:
    drives, of_fleet = LongRecording.of(FLEET).drives, FLEET.drives
    assert drives.cars["car01"].vehicle == of_fleet.cars["car01"].vehicle
    (planned,) = drives.plan.drives
    assert drives.plan.effects_of(planned) == {"yaw_inertia": {"scale": pytest.approx(1.03)}}
    tables = [each.route(planned.route).table for each in (drives, of_fleet)]
    assert (tables[0] == tables[1]).all()
