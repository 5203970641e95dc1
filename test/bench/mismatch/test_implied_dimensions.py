# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vehicle files of generated cars agree with their simulations."""

from __future__ import annotations

import pytest

from adk_ros.bench.mismatch.case_matrix import case_plans
from adk_ros.mismatch.surrogate.identification import identify_surrogate
from adk_ros.mismatch.surrogate.implied_dimensions import ImpliedDimensions, implied_dimensions
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem

pytestmark = pytest.mark.slow(seconds=60)
LIST = 31


def implied(name: str) -> ImpliedDimensions:
    case = next(plan for plan in case_plans(LIST) if plan.name == name).make()
    problem = prepare_residual_problem(case.simulation)
    given = case.nominal.parameters()
    return implied_dimensions(problem, identify_surrogate(problem, given), given)


@pytest.mark.parametrize("name", ["clean_01", "clean_06", "clean_56"])
def test_a_car_implies_its_dimensions(name: str) -> None:
    """One of each of our simulators; clean_56 is the farthest off of twenty."""
    found = implied(name)
    assert found.yaw_inertia.ratio == pytest.approx(1.0, abs=0.04)
    assert found.wheelbase.ratio == pytest.approx(1.0, abs=0.01)
    found.check(name)


@pytest.mark.parametrize("name", ["multi_body_payload", "multi_body_yaw_inertia"])
def test_the_car_of_another_project(name: str) -> None:
    found = implied(name)
    assert 1.0 < found.yaw_inertia.ratio < 1.4
    assert found.wheelbase.ratio == pytest.approx(1.0, abs=0.015)
    found.check(name)
