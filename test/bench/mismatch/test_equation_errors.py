# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Terms of a surrogate file act in the equation errors where and as gradually as the file says."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mismatch import car, steady

from adk_ros.bench.mismatch import equation_errors
from adk_ros.mismatch.deployment.surrogate_file import (
    ActivationEntry,
    EffectTermEntry,
    FeatureTermEntry,
    SurrogateFile,
    load_surrogate,
)
from adk_ros.mismatch.deployment.surrogate_writer import surrogate_yaml
from adk_ros.mismatch.surrogate.activation import inside_segments
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem


@pytest.fixture
def surrogate(tmp_path_factory: pytest.TempPathFactory) -> SurrogateFile:
    path = tmp_path_factory.mktemp("surrogate") / "simulation.yaml"
    path.write_text(surrogate_yaml(car()))
    return load_surrogate(path).content


@pytest.mark.parametrize("transition_length", [3.0, 24.0])
def test_a_term_at_a_place_keeps_its_transition_length(
    surrogate: SurrogateFile, transition_length: float
) -> None:
    problem = prepare_residual_problem(steady(20.0))
    distance = (problem.middle_s * 20.0) % 220.0
    lap = Lap(220.0, problem.pose[:1], np.zeros(1), distance)
    where = ActivationEntry(
        kind="place",
        lap=220.0,
        stretches=[[50.0, 120.0]],
        edge=transition_length,
        line=[[0.0, 0.0, 0.0, 0.0]],
    )
    term = EffectTermEntry(effect="road_grade", parameters={"grade": 0.05}, where=where)
    model = surrogate.model_copy(update={"terms": [term]})
    _, terms = equation_errors._setting(problem, lap, model)
    expected = inside_segments(distance, ((50.0, 120.0),), 220.0, transition_length)
    np.testing.assert_allclose(terms.activations[terms.rows[-1]], expected)


def test_a_feature_term_acts_in_its_equation_alone(surrogate: SurrogateFile) -> None:
    term = FeatureTermEntry(equation="v_x", feature="speed_squared", coefficient=-1e-4)
    log = steady(20.0)
    before = equation_errors.equation_errors(log, surrogate).residuals
    model = surrogate.model_copy(update={"feature_terms": [term]})
    change = equation_errors.equation_errors(log, model).residuals - before
    assert change[:, 0] == pytest.approx(1e-4 * 20.0**2, rel=0.05)
    assert np.abs(change[:, 1:]).max() < 0.002
