# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When known effects are the answer, and when an expression is."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.inference.decision import prefers_feature_model
from adk_ros.mismatch.inference.forward_selection import SelectionPath
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, inactive_effect
from adk_ros.mismatch.inference.unmodelled import (
    UnmodelledDynamics,
    feature_as_effect,
    most_parsimonious,
)
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm


def fitted(feature: str, cost: float) -> Hypothesis:
    effect = feature_as_effect("yaw_rate", feature, np.ones(1))
    return Hypothesis((ActiveEffect(effect, (0.1,)),), np.zeros(0), cost)


def effects(cost: float, *names: str) -> Hypothesis:
    return Hypothesis(tuple(inactive_effect(EFFECTS[n]) for n in names), np.zeros(0), cost)


def described(cost: float, *features: str) -> UnmodelledDynamics:
    pieces = tuple(FeatureTerm("yaw_rate", f, 1.0, 100.0) for f in features)
    return UnmodelledDynamics(1.0, pieces, fitted(features[-1] if features else "speed", cost))


def test_of_features_as_good_the_plainest_is_taken() -> None:
    power, torque, cubic = (
        fitted(*x) for x in (("torque_speed", 100.0), ("torque", 104.0), ("delta_cubed", 90.0))
    )
    assert most_parsimonious([power, torque], 20.0) is torque
    assert most_parsimonious([power, torque], 2.0) is power
    assert most_parsimonious([power, torque, cubic], 5.0) is cubic


def test_several_effects_are_a_disguise_of_what_one_term_says_better() -> None:
    found = SelectionPath(expected_loss=1000.0, null_excess_loss=5000.0)
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    assert prefers_feature_model(described(1050.0, "yaw_rate_per_speed"), pair, found)
    # Not where the effects do as well, nor by more terms than there are effects.
    assert not prefers_feature_model(described(1290.0, "yaw_rate_per_speed"), pair, found)
    assert not prefers_feature_model(described(1050.0, "yaw_rate", "delta", "speed"), pair, found)
    assert not prefers_feature_model(described(1050.0), pair, found)


def test_a_poor_stand_in_asks_more_of_an_expression() -> None:
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    plain = described(1050.0, "yaw_rate_per_speed")
    assert prefers_feature_model(
        plain, pair, SelectionPath(expected_loss=1000.0, null_excess_loss=5000.0)
    )
    assert not prefers_feature_model(
        plain,
        pair,
        SelectionPath(expected_loss=1000.0, null_excess_loss=5000.0, surrogate_error_dof=3000.0),
    )
