# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A car without effects is also judged by the build tolerances that its training part shows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.mismatch import car, case

import adk_ros.mismatch.fitted_tolerances as fitted_tolerances
from adk_ros.mismatch.deployment.corrected_model import corrected_yaml
from adk_ros.mismatch.deployment.held_out import HORIZONS_S, Evidence, HeldOutErrors
from adk_ros.mismatch.deployment.surrogate_writer import simulation_yaml
from adk_ros.mismatch.fitted_tolerances import is_within_prior, with_fitted_tolerances
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.nuisances import N_FIXED_NUISANCES, TOLERANCE_PARAMETERS
from adk_ros.mismatch.inference.result import EXPLAINED, NONE, NOT_EXPORTED, UNKNOWN
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import TOLERANCE_SIGMA
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.sensor_log import CHANNELS
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.validation import Validation, coherent, model_errors

DEVIATIONS: Any = np.full(N_FIXED_NUISANCES, TOLERANCE_SIGMA)
SHAPE = (len(HORIZONS_S), 3)


def validation(error: float) -> Validation:
    table = np.full(SHAPE, error)
    table[:, 1] = np.nan
    errors = HeldOutErrors(table, table, np.ones(SHAPE), np.full(SHAPE, 0.02), table, 50)
    return Validation(errors, NOT_EXPORTED, "")


def decision(*effects: ActiveEffect, tolerance: float = 0.004, verdict: str = NONE) -> Decision:
    nuisances = np.zeros(N_FIXED_NUISANCES)
    nuisances[0] = tolerance
    return Decision(verdict, [], None, Hypothesis(effects, nuisances, 0.0), None)


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The error that fitted tolerances leave; noise alone would cause 0.018."""
    error = [0.02]

    def model_errors(*arguments: Any) -> tuple[Any, Any]:
        return np.full(SHAPE, error[0]), np.full(SHAPE, 0.018)

    monkeypatch.setattr(fitted_tolerances, "model_errors", model_errors)
    monkeypatch.setattr(fitted_tolerances, "corrected_yaml", lambda *arguments: "")
    return error


def judged(given: Validation, of: Decision) -> Validation:
    training: Any = SimpleNamespace(nuisance_deviations=lambda: DEVIATIONS)
    nothing: Any = None
    return with_fitted_tolerances(given, of, nothing, training, None, [])


def test_an_unusual_car_is_no_mismatch(fitted: list[float]) -> None:
    before = validation(0.03)
    assert coherent(decision(), before).verdict == UNKNOWN
    after = judged(before, decision())
    assert after.errors.tolerances_fitted
    assert np.isnan(after.errors.corrected[:, 1]).all()
    assert coherent(decision(), after).verdict == NONE
    np.testing.assert_array_equal(after.errors.before, before.errors.before)
    fitted[0] = 0.022
    assert judged(before, decision()) is before


def test_tolerances_that_no_usual_car_has_explain_nothing(fitted: list[float]) -> None:
    before = validation(0.03)
    assert judged(before, decision(tolerance=0.012)).errors.tolerances_fitted
    everywhere = replace(
        decision(), hypothesis=Hypothesis((), np.full(N_FIXED_NUISANCES, 0.008), 0.0)
    )
    assert judged(before, everywhere) is before
    assert is_within_prior(np.ones(20), np.ones(20))
    assert not is_within_prior(np.full(20, 1.4), np.ones(20))


def test_only_a_result_without_a_finding_is_judged_so(fitted: list[float]) -> None:
    before = validation(0.03)
    drag = ActiveEffect(EFFECTS["aero_drag"], (1.0,), Activation())
    assert judged(before, decision(drag, verdict=EXPLAINED)) is before
    assert judged(before, decision(verdict=UNKNOWN)) is before
    explained = validation(0.02)
    assert judged(explained, decision()) is explained


def test_the_tolerances_are_those_of_the_hypothesis() -> None:
    """A simulation of a lighter car, with the tolerance that it lacks, predicts like the car."""

    def surrogate(mass: float) -> SurrogateModel:
        n, p = len(CHANNELS), car(mass=mass)
        return SurrogateModel(p, np.zeros(n), np.zeros((n, 100)), np.empty((0, p.shape[0])))

    whole, evidence = car()[INDEX["mass"]], [Evidence(case().held_out)]
    light, nuisances = surrogate(whole / 1.01), np.zeros(N_FIXED_NUISANCES)
    nuisances[TOLERANCE_PARAMETERS.index("mass")] = 0.01
    text = corrected_yaml(light, Hypothesis((), nuisances, 0.0), None)
    error, expected = model_errors(light, text, evidence)
    wanted, _ = model_errors(surrogate(whole), simulation_yaml(surrogate(whole)), evidence)
    wrong, _ = model_errors(light, simulation_yaml(light), evidence)
    np.testing.assert_allclose(error, wanted, rtol=1e-4)
    assert wrong[2, 0] > 1.03 * wanted[2, 0]
    assert (expected > 0.0).all()
