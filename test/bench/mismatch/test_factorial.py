# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every combination of strength, simulator and noise, and results by factor."""

import itertools
from typing import Any

import pytest

from adk_ros.bench.mismatch.case_matrix import NOISES, case_plans
from adk_ros.bench.mismatch.case_score import CaseResult
from adk_ros.bench.mismatch.factorial import factorial_plans, results_by_factor
from adk_ros.errors import UsageError
from adk_ros.plant.injection.injected_drive import PLANTS


def test_all_combinations_have_one_vehicle() -> None:
    plans = factorial_plans("payload, aero_drag", 3)
    combinations = set(itertools.product((1.0, 0.3, 0.1), PLANTS, sorted(set(NOISES))))
    for name in ("payload", "aero_drag"):
        of_effect = [x for x in plans if list(x.injected.effects) == [name]]
        assert {(x.strength, x.plant, x.noise) for x in of_effect} == combinations
        assert len(of_effect) == len(combinations)
        assert len({x.seed for x in of_effect}) == 1
    assert len({x.name for x in plans}) == len(plans) == 54
    weak = next(x for x in plans if x.name == "payload_0.3_seven_dof_2")
    assert weak.injected.effects == {"payload": {"mass": pytest.approx(90.0)}}


def test_vehicles_are_those_of_no_other_case() -> None:
    seeds = {x.seed for x in factorial_plans("*", 3)}
    listed = {x.seed for number in (3, 4) for x in case_plans(number)}
    assert not seeds & listed
    assert max(seeds) < min(x.seed for x in case_plans(4))


def test_an_effect_of_one_simulator_is_combined_with_that() -> None:
    assert {x.plant for x in factorial_plans("aero_downforce")} == {"spring_car"}


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(UsageError, match="no effect is called 'payloads': names are aero_drag"):
        factorial_plans("payloads")


def test_credit_is_averaged_by_kind_and_factor() -> None:
    def case(right: float, **given: Any) -> CaseResult:
        return CaseResult("c", given.pop("kind", "single"), right, 1.0, "", "", **given)

    header, rows = results_by_factor(
        [
            case(1.0, plant="a", noise=1.0),
            case(0.5, plant="a", noise=2.0),
            case(0.0, plant="b", noise=2.0),
            case(1.0, plant="a", noise=1.0, strength=0.3),
            case(1.0, kind="none", plant="b"),
        ]
    )
    assert header == ["cases", "strength", "a", "b", "noise x 1", "noise x 2"]
    assert rows == [
        ["none", "1", "", "1.00 of 1", "", ""],
        ["single", "1", "0.75 of 2", "0.00 of 1", "1.00 of 1", "0.25 of 2"],
        ["single", "0.3", "1.00 of 1", "", "1.00 of 1", ""],
    ]
