# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for features with a memory, a threshold or an oscillation.

The surrogate of a clean case is given a feature that the recording does not have: the search must
find it, with the opposite sign.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.feature_effect import (
    active_feature,
    feature_as_effect,
    feature_terms,
)
from adk_ros.mismatch.inference.fit_budget import FEATURE, NULL_HYPOTHESIS
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.inference.parametric_refinement import refined, with_siblings
from adk_ros.mismatch.inference.parametric_search import ParametricSearch
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.inference.term_elimination import without_superfluous
from adk_ros.mismatch.library.features import FEATURES, Signals, feature
from adk_ros.mismatch.library.parametric_features import kind_of, parsed
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import (
    EQUATION_PARAMETERS,
    FeatureTerm,
    feature_signals,
)
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import ResidualProblem, prepare_residual_problem
from adk_ros.numerics.arrays import FloatArray


@cache
def clean() -> tuple[SurrogateModel, ResidualProblem]:
    c = case()
    surrogate, _ = surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)
    return surrogate, prepare_residual_problem(c.recording)


def problem_with(*terms: tuple[str, str, float]) -> tuple[Likelihood, Hypothesis, FloatArray]:
    """A likelihood whose surrogate has terms (equation, feature, size) too many."""
    surrogate, problem = clean()
    extra = tuple(FeatureTerm(equation, name, size, 0.0) for equation, name, size in terms)
    likelihood = Likelihood.of(problem, replace(surrogate, feature_terms=extra))
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    return likelihood, null, likelihood.nuisance_jacobian(null)


def signals_of(likelihood: Likelihood, h: Hypothesis) -> Signals:
    p, terms = likelihood.simulation_inputs(h.nuisances, h.effects)
    return feature_signals(likelihood.problem, likelihood.problem.run(p, terms))


def in_equation(equation: str, name: str, signals: Signals, coefficient: float) -> ActiveEffect:
    return active_feature(equation, name, feature(name).function(signals), coefficient)


@pytest.mark.parametrize("equation", ["v_x", "v_y", "yaw_rate", "steering"])
@pytest.mark.parametrize(
    "frequency",
    [pytest.param(0.1, marks=pytest.mark.slow), 0.6, pytest.param(2.0, marks=pytest.mark.slow)],
)
def test_the_linear_response_equals_a_run(equation: str, frequency: float) -> None:
    likelihood, null, jacobian = problem_with()
    linearised = LinearisedProblem(likelihood, null, jacobian)
    response = LinearResponse.of(linearised)
    wave = np.sin(2.0 * np.pi * frequency * likelihood.problem.middle_s)
    size = 0.002 if equation == "steering" else 0.05
    effect = feature_as_effect(equation, "constant")
    exact = linearised.project_out(
        linearised.column(ActiveEffect(effect, (size,), Activation(weight=wave)))
    )
    found = size * response.column(equation, wave)
    assert np.corrcoef(found, exact)[0, 1] > 0.9
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(exact), rel=0.15)


def test_a_bin_is_the_mean_of_four_steps() -> None:
    problem = clean()[1]
    means = problem.binned(np.arange(float(problem.steps)))
    assert means.shape == (problem.bins,)
    np.testing.assert_allclose(means[:3], [1.5, 5.5, 9.5])
    assert means[-1] <= problem.steps - 1


@pytest.mark.parametrize(
    ("equation", "name", "size"),
    [
        ("v_y", "resonance:a_y:0.5:0.06", 0.08),
        ("v_x", "gate:drive_torque:lateral_size>2.5", 1e-3),
        ("v_x", "resonance:torque:1.2:0.1", 4e-4),
        pytest.param("steering", "resonance:delta:1.0:0.06", 0.1, marks=pytest.mark.slow),
        ("yaw_rate", "lag:torque:1.5", 2e-5),
        pytest.param("yaw_rate", "hysteresis:delta:0.004", 8.0, marks=pytest.mark.slow),
        pytest.param("steering", "gate:delta:speed>20", 0.1, marks=pytest.mark.slow),
        pytest.param("v_x", "excess:brake_torque:400", 1e-3, marks=pytest.mark.slow),
        pytest.param("v_x", "drift:brake_torque:brake_work:4e5", 1e-3, marks=pytest.mark.slow),
        pytest.param("v_x", "drift:drive_torque:time:30", 1e-3, marks=pytest.mark.slow),
        pytest.param("v_x", "decay:constant:time:30", 0.3, marks=pytest.mark.slow),
        pytest.param("v_x", "pulsation:2.5:0.3:torque", 2e-4, marks=pytest.mark.slow),
        pytest.param("yaw_rate", "excess:yaw_rate:0.15", 1.0, marks=pytest.mark.slow),
        pytest.param("yaw_rate", "ripple:260:0.7:constant", 0.05, marks=pytest.mark.slow),
        pytest.param("v_x", "heat:brake_torque:30", 1e-7, marks=pytest.mark.slow),
        pytest.param("v_x", "gate:drive_torque:time>40", 2e-4, marks=pytest.mark.slow),
        pytest.param("v_x", "gate:brake_torque:deceleration>2", 8e-4, marks=pytest.mark.slow),
        pytest.param("v_x", "ripple:2.042:0.7:speed_squared", 1e-3, marks=pytest.mark.slow),
    ],
)
def test_the_search_finds_kind_signal_and_parameters(
    equation: str, name: str, size: float
) -> None:
    likelihood, null, jacobian = problem_with((equation, name, size))
    signals = signals_of(likelihood, null)
    search = ParametricSearch(signals, list(EQUATION_PARAMETERS), list(FEATURES))
    response = LinearResponse.of(LinearisedProblem(likelihood, null, jacobian))
    best = search.best(response, 4)[0]
    assert (best.equation, kind_of(best.name)) == (equation, kind_of(name))
    expected, found = parsed(name)[1], parsed(best.name)[1]
    if kind_of(name) in {"ripple", "pulsation"}:
        assert float(found[0]) == pytest.approx(float(expected[0]), rel=0.01)
        assert found[2] == expected[2]
        return
    assert found[0] == expected[0]
    if kind_of(name) == "gate":
        condition, threshold = expected[1].split(">")
        assert found[1].startswith(f"{condition}>")
        assert float(found[1].split(">")[1]) == pytest.approx(float(threshold), rel=0.1)
    elif kind_of(name) == "resonance":
        assert float(found[1]) == pytest.approx(float(expected[1]), rel=0.3)
    else:
        assert float(found[-1]) == pytest.approx(float(expected[-1]), rel=0.5)


@pytest.mark.slow
def test_what_is_weak_next_to_one_with_many_thresholds_is_examined_later() -> None:
    """All thresholds of brakes that fade gain more than a memory of the yaw moment."""
    cut, memory = "gate:brake_torque:deceleration>2", "lag:torque:1.5"
    likelihood, null, jacobian = problem_with(("v_x", cut, 8e-4), ("yaw_rate", memory, 2e-5))
    search = ParametricSearch(
        signals_of(likelihood, null), list(EQUATION_PARAMETERS), list(FEATURES)
    )
    response = LinearResponse.of(LinearisedProblem(likelihood, null, jacobian))
    assert search.best(response, 8)[0].equation == "v_x"
    assert {equation for _, equation in search._pairs} >= {"v_x", "yaw_rate"}
    assert len({kind_of(name) for name, _ in search._pairs}) > 5


@pytest.mark.slow
def test_an_oscillation_in_time_is_found_with_its_condition() -> None:
    fast = float(np.quantile(clean()[1].smoothed_odometry[:, 0], 0.5))
    name = f"wave:0.3:0.7:speed>{fast:.4g}"
    likelihood, null, jacobian = problem_with(("yaw_rate", name, 0.2))
    search = ParametricSearch(signals_of(likelihood, null), ["yaw_rate"], list(FEATURES))
    response = LinearResponse.of(LinearisedProblem(likelihood, null, jacobian))
    best = max(search.best(response, 8), key=lambda x: x.gain)
    kind, arguments = kind_of(best.name), parsed(best.name)[1]
    assert kind == "wave"
    assert float(arguments[0]) == pytest.approx(0.3, abs=0.005)
    assert arguments[2].startswith("speed>")


def test_without_a_torque_no_feature_of_it_is_tried() -> None:
    likelihood, null, _ = problem_with()
    names = [name for name in FEATURES if "torque" not in name]
    search = ParametricSearch(signals_of(likelihood, null), ["v_y"], names)
    assert all("torque" not in name for name in search.grid.names)


@pytest.mark.slow
def test_refinement_finds_the_parameters_and_the_other_equation() -> None:
    true = "resonance:a_y:0.5:0.06"
    likelihood, null, jacobian = problem_with(("v_y", true, 0.08), ("yaw_rate", true, -0.03))
    signals = signals_of(likelihood, null)
    start = likelihood.fit(
        [in_equation("v_y", "resonance:a_y:0.57:0.12", signals, -0.05)],
        nuisances=null.nuisances,
        budget=FEATURE,
        jacobian=jacobian,
    )
    better = refined(likelihood, start, jacobian)
    assert better.loss < start.loss
    both = with_siblings(likelihood, better, jacobian, ["v_x", "v_y", "yaw_rate"], 100.0)
    assert both.loss < better.loss
    terms = {term.equation: term for term in feature_terms(both.effects)}
    assert set(terms) == {"v_y", "yaw_rate"}
    _, frequency, damping = parsed(terms["v_y"].feature)[1]
    assert float(frequency) == pytest.approx(0.5, rel=0.05)
    assert float(damping) == pytest.approx(0.06, rel=0.5)
    assert terms["v_y"].coefficient == pytest.approx(-0.08, rel=0.2)
    assert terms["yaw_rate"].coefficient == pytest.approx(0.03, rel=0.3)


def test_refinement_leaves_features_without_memory_alone() -> None:
    likelihood, null, jacobian = problem_with()
    signals = signals_of(likelihood, null)
    start = likelihood.fit(
        [in_equation("v_x", "speed", signals, 0.0)], nuisances=null.nuisances, jacobian=jacobian
    )
    assert refined(likelihood, start, jacobian) is start
    assert with_siblings(likelihood, start, jacobian, ["v_y"], 0.0) is start


@pytest.mark.slow
def test_a_plain_feature_is_dropped_once_a_searched_one_explains_more() -> None:
    true = "resonance:a_y:0.5:0.06"
    likelihood, null, jacobian = problem_with(("v_y", true, 0.08))
    signals = signals_of(likelihood, null)

    def fitted(*names: str) -> Hypothesis:
        return likelihood.fit(
            [in_equation("v_y", name, signals, 0.0) for name in names],
            nuisances=null.nuisances,
            budget=FEATURE,
            jacobian=jacobian,
        )

    both = fitted("yaw_rate_speed", true)
    kept, dropped = without_superfluous(likelihood, both, [0], jacobian, 100.0)
    assert dropped == [0]
    assert [term.feature.split(":")[0] for term in feature_terms(kept.effects)] == ["resonance"]
    # A term that still gains enough stays.
    swapped = fitted(true, "yaw_rate_speed")
    assert without_superfluous(likelihood, swapped, [0], jacobian, 100.0) == (swapped, [])
