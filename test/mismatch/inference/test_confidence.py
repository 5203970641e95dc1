# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The posterior probability of an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adk_ros.mismatch.inference.confidence import (
    ABSENT,
    UNLISTED,
    ConfidenceModel,
    Evidence,
    formula_log_prior,
)
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.final_estimate import (
    formula_instead,
    with_confidence,
    without_improbable,
)
from adk_ros.mismatch.inference.hypothesis import Hypothesis, inactive_effect
from adk_ros.mismatch.inference.identifiability import CompetingEffect
from adk_ros.mismatch.inference.result import EXPLAINED, UNKNOWN, IdentifiedEffect
from adk_ros.mismatch.inference.term_meaning import Body
from adk_ros.mismatch.inference.unmodelled import UnmodelledDynamics
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm

BLOCKS = 16


def evidence(*per_block: float, spread: float = 0.0, error: float = 0.0) -> Evidence:
    """Return alternatives that are worse by so much in each block, alternately more and less."""
    signs = np.where(np.arange(BLOCKS) % 2 == 0, 1.0, -1.0)
    names = (ABSENT, "yaw_inertia", UNLISTED)[: len(per_block)]
    differences = np.array([x + spread * signs for x in per_block])
    return Evidence(names, differences, np.zeros(len(per_block)), error)


def test_probabilities_are_those_of_a_likelihood_ratio() -> None:
    model = ConfidenceModel(0.0, 1.0)
    posterior = model.posterior(evidence(4.0 / BLOCKS), 1.0)
    assert posterior[ABSENT] == pytest.approx(1.0 / (1.0 + np.exp(2.0)), abs=0.002)
    assert posterior[UNLISTED] == 0.0


def test_blocks_that_disagree_lower_the_confidence() -> None:
    model = ConfidenceModel(0.0, 1.0)
    agreed = model.posterior(evidence(2.0), 1.0)
    disagreed = model.posterior(evidence(2.0, spread=20.0), 1.0)
    assert agreed[ABSENT] < 1e-4
    assert disagreed[ABSENT] > 0.05


def test_an_alternative_that_needs_unusual_tolerances_is_less_probable() -> None:
    model = ConfidenceModel(0.0, 1.0)
    tie = evidence(0.0)
    assert model.posterior(tie, 1.0)[ABSENT] == pytest.approx(0.5)
    strained = replace(tie, prior_costs=np.array([8.0]))
    assert model.posterior(strained, 1.0)[ABSENT] == pytest.approx(1.0 / (1.0 + np.exp(4.0)))
    assert strained.margins() == {ABSENT: pytest.approx(8.0)}


def test_the_error_of_the_surrogate_tempers_the_evidence() -> None:
    model = ConfidenceModel(0.0, 1.0, 0.002)
    exact = model.posterior(evidence(3.0), 1.0)
    inexact = model.posterior(evidence(3.0, error=50_000.0), 1.0)
    assert exact[ABSENT] < 1e-6
    assert inexact[ABSENT] > 0.3


def test_held_out_errors_speak_for_unlisted_physics() -> None:
    model = ConfidenceModel(0.1, 2.0)
    small, large = (model.posterior(evidence(50.0), r)[UNLISTED] for r in (0.3, 3.0))
    assert small == pytest.approx(0.009 / 1.009, rel=1e-6)
    assert large == pytest.approx(0.9 / 1.9, rel=1e-6)


def test_a_formula_that_fits_as_well_as_an_effect_does_not_refute_it() -> None:
    tie = Evidence((UNLISTED,), np.zeros((1, BLOCKS)), np.array([formula_log_prior(1)]))
    assert ConfidenceModel(0.0, 1.0).posterior(tie, 1.0)[UNLISTED] < 0.02


def test_probabilities_sum_to_at_most_one() -> None:
    posterior = ConfidenceModel().posterior(evidence(-3.0, -5.0, -2.0), 10.0)
    assert 0.95 < sum(posterior.values()) <= 1.0
    assert set(posterior) == {ABSENT, "yaw_inertia", UNLISTED}


def competitor(name: str, alternative: bool = False) -> CompetingEffect:
    return CompetingEffect("aero_drag", name, 5.0, inactive_effect(EFFECTS[name]), alternative)


def decision(per_block: float) -> Decision:
    differences = np.array([[50.0] * BLOCKS, [per_block] * BLOCKS])
    found = Evidence((ABSENT, "headwind"), differences, np.zeros(2))
    drag = IdentifiedEffect(
        EFFECTS["aero_drag"], {}, np.nan, [], "always", [], 800.0,
        (competitor("headwind"), competitor("rolling_resistance")), evidence=found,
    )  # fmt: skip
    return Decision(EXPLAINED, [drag], None, Hypothesis((), np.zeros(0), 0.0), None)


def test_the_most_probable_competitor_joins_an_uncertain_effect() -> None:
    (certain,) = with_confidence(decision(10.0), 0.1).effects
    assert (certain.alternatives, certain.confidence > 0.95) == ([], True)
    (tied,) = with_confidence(decision(2.0 / BLOCKS), 0.1).effects
    assert tied.alternatives == ["headwind"]
    assert tied.confidence > 0.9 > 1.0 - tied.posterior["headwind"]
    assert [c.alternative for c in tied.competitors] == [True, False]


def test_an_effect_next_to_larger_unexplained_errors_is_set_aside() -> None:
    explained = decision(10.0)
    unknown = replace(explained, verdict=UNKNOWN)
    assert without_improbable(explained, 6.0) is explained
    kept = without_improbable(unknown, 0.5)
    assert (len(kept.effects), kept.set_aside) == (1, ())
    left = without_improbable(unknown, 6.0)
    assert (left.effects, left.set_aside) == ([], ("aero_drag",))
    assert left.hypothesis is unknown.hypothesis


def test_a_formula_that_describes_more_leaves_nothing_explained() -> None:
    """Next to it the effect is improbable, though it explains the errors."""
    term = FeatureTerm("v_y", "yaw_rate", -3.75, 900.0)
    explained = decision(10.0)
    formula = UnmodelledDynamics(1.0, (term,), explained.hypothesis, Body(1800.0, 3000.0, 0.3))

    def next_to(loss: float) -> Decision:
        """The effect where the formula is better by this loss in all."""
        (effect,) = explained.effects
        against = Evidence(
            (UNLISTED,), np.full((1, BLOCKS), -loss / BLOCKS), np.array([formula_log_prior(1)])
        )
        return replace(explained, effects=[replace(effect, evidence=against)], formula=formula)

    worse, doubtful, better = next_to(-20.0), next_to(12.0), next_to(60.0)
    assert formula_instead(worse) is worse
    # Less probable than not: claimed, with a word of doubt.
    assert 0.05 < with_confidence(doubtful, 0.5).effects[0].confidence < 0.5
    assert formula_instead(doubtful) is doubtful
    left = formula_instead(better)
    assert (left.verdict, left.effects, left.set_aside) == (UNKNOWN, [], ())
    assert left.unexplained is not None
    assert left.unexplained.terms == (term,)
    assert (left.unmodelled, left.hypothesis) == (formula, formula.hypothesis)
    without_terms = replace(better, formula=replace(formula, terms=()))
    assert formula_instead(without_terms) is without_terms
    unknown = replace(better, verdict=UNKNOWN)
    assert formula_instead(unknown) is unknown
