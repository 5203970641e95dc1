# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""On generated recordings the feature of the right kind wins, with the injected parameters."""

from __future__ import annotations

from functools import cache

import pytest

from adk_ros.bench.mismatch.case_generator import GeneratedCase, InjectedMismatch, make_case
from adk_ros.mismatch.inference.fit_budget import NULL_HYPOTHESIS
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.unmodelled import fit_feature_expansion
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem
from adk_ros.plant.injection.injectors import UNLISTED


def case_with(name: str) -> GeneratedCase:
    injected = InjectedMismatch({}, {}, {name: UNLISTED[name]})
    return make_case(name, injected, 7, seconds=(150.0, 220.0, 20.0))


@cache
def surrogate() -> SurrogateModel:
    # The simulation depends on the seed alone.
    c = case_with("wheel_imbalance")
    return surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)[0]


@pytest.mark.slow(seconds=25)
@pytest.mark.parametrize(
    ("name", "equation", "feature"),
    [
        ("wheel_imbalance", "v_x", "ripple:2.04"),
        ("brake_fade", "v_x", "drift:brake_torque:brake_work:"),
        ("battery_sag", "v_x", "drift:drive_torque:time:"),
        ("torque_ripple", "v_x", "pulsation:2.5:"),
        ("torque_hysteresis", "v_x", "hysteresis:torque:"),
        ("yaw_limiter", "yaw_rate", "excess:yaw_rate:"),
        ("torque_locking_differential", "yaw_rate", "torque_size_curvature"),
        ("variable_steering_ratio", "steering", "delta_speed"),
        ("shimmy", "yaw_rate", "speed_wave:4"),
    ],
)
def test_one_feature_of_the_right_kind_is_found(name: str, equation: str, feature: str) -> None:
    problem = prepare_residual_problem(case_with(name).recording)
    likelihood = Likelihood.of(problem, surrogate(), 165.0)
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    assert null.fit is not None
    expected = likelihood.expected_loss(null.fit.residuals)
    found = fit_feature_expansion(likelihood, null, expected, null.loss - expected)
    assert [term.equation for term in found.terms] == [equation]
    assert found.terms[0].feature.startswith(feature)
    if name == "yaw_limiter":
        assert float(found.terms[0].feature.split(":")[2]) == pytest.approx(0.2, rel=0.02)
