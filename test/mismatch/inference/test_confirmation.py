# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Of several effects, those that gain nothing on held-out data are dropped."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.mismatch import case

from adk_ros.mismatch.inference.confirmation import confirmed, is_formula_confirmed
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.fit_budget import FINAL, NULL_HYPOTHESIS
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import EXPLAINED, IdentifiedEffect
from adk_ros.mismatch.inference.selection_path import SelectionPath
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.simulator import surrogate_of
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.mismatch.surrogate.residuals import prepare_residual_problem

pytestmark = pytest.mark.slow(seconds=20)
SPLIT_S = 65.0
PATH = SelectionPath(levels=[[Hypothesis((), np.zeros(0), 1e4)]])


@cache
def likelihoods() -> tuple[Likelihood, Likelihood]:
    """
    Of the training part and of all of a recording with more drag.

    The gyro's scale is wrong in the training part only.
    """
    c = case("aero_drag", cda=1.0)
    surrogate, _ = surrogate_of(c.simulation, c.recording, c.nominal, lambda done, text: None)
    imu = c.recording.imu.copy()
    imu[c.recording.imu_s < SPLIT_S, 2] *= 1.03
    problem = prepare_residual_problem(replace(c.recording, imu=imu))
    return Likelihood.of(problem, surrogate, SPLIT_S), Likelihood.of(problem, surrogate)


def effect(name: str, theta: float, activation: Activation = ALWAYS_ACTIVE) -> ActiveEffect:
    return ActiveEffect(EFFECTS[name], (theta,), activation)


def decided(*effects: ActiveEffect) -> Decision:
    training, _ = likelihoods()
    start = np.zeros(training.n_nuisances)
    h = training.fit(effects, nuisances=start, budget=FINAL, fit_activation=True)
    identified = [
        IdentifiedEffect(a.effect, {}, 0.9, [], a.activation.kind, [], 100.0, ())
        for a in h.effects
    ]
    return Decision(EXPLAINED, identified, None, h, None)


def names(h: Hypothesis) -> list[str]:
    return [active.effect.name for active in h.effects]


def test_an_effect_that_gains_nothing_is_dropped() -> None:
    decision = decided(effect("aero_drag", 0.8), effect("gyro_scale", 1.02))
    assert decision.hypothesis.effects[1].theta[0] == pytest.approx(1.03, abs=0.005)
    done = confirmed(decision, *likelihoods(), PATH)
    assert names(done.hypothesis) == ["aero_drag"]
    assert [one.effect.name for one in done.effects] == ["aero_drag"]
    assert done.verdict == EXPLAINED
    assert done.hypothesis.effects[0].theta[0] == pytest.approx(1.0, rel=0.1)


def test_what_may_be_in_the_place_of_those_that_stay_is_judged_anew() -> None:
    """The absence of the drag is measured beside no other effect, once that is dropped."""
    training, _ = likelihoods()
    decision = decided(effect("aero_drag", 0.8), effect("gyro_scale", 1.02))
    done = confirmed(decision, *likelihoods(), PATH).effects[0]
    null = training.fit([], nuisances=np.zeros(training.n_nuisances), budget=FINAL)
    assert done.evidence is not None
    assert done.gain == pytest.approx(
        null.loss
        - training.fit([effect("aero_drag", 1.0)], nuisances=null.nuisances, budget=FINAL).loss,
        rel=0.05,
    )
    assert {c.of for c in done.competitors} == {"aero_drag"}


def test_a_single_effect_is_left_to_the_check_of_the_errors() -> None:
    decision = decided(effect("steering_lag", 0.02))
    assert confirmed(decision, *likelihoods(), PATH) is decision


def test_a_formula_must_gain_on_held_out_data_in_proportion() -> None:
    """The drag acts throughout, the scale of the gyro in the training part only."""
    training, whole = likelihoods()
    null = training.fit([], budget=NULL_HYPOTHESIS)
    drag, gyro = (
        training.fit([one], nuisances=null.nuisances, budget=FINAL)
        for one in (effect("aero_drag", 0.8), effect("gyro_scale", 1.02))
    )
    assert null.loss - gyro.loss > 60.0
    assert is_formula_confirmed(drag, null, training, whole)
    assert not is_formula_confirmed(gyro, null, training, whole)
    # With nothing held out, nothing confirms it.
    assert not is_formula_confirmed(drag, null, whole, whole)


def test_an_effect_that_does_not_act_later_cannot_be_refuted() -> None:
    late = Activation(onset_s=SPLIT_S + 24.0)
    training, whole = likelihoods()
    drag, lag = effect("aero_drag", 1.0), effect("steering_lag", 0.02, late)
    h = training.fit([drag, lag], nuisances=np.zeros(training.n_nuisances), budget=FINAL)
    decision = Decision(EXPLAINED, [], None, h, None)
    assert confirmed(decision, training, whole, PATH) is decision
