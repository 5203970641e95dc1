# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When known effects are the answer, and when an expression is."""

from __future__ import annotations

import numpy as np

from adk_ros.mismatch.catalogue import EFFECTS
from adk_ros.mismatch.likelihood import Active, Hypothesis, neutral
from adk_ros.mismatch.pieces import Piece
from adk_ros.mismatch.search import Search
from adk_ros.mismatch.unknown import Remainder, plainest, pseudo
from adk_ros.mismatch.verdict import simpler


def fitted(feature: str, cost: float) -> Hypothesis:
    effect = pseudo("yaw_rate", feature, np.ones(1))
    return Hypothesis((Active(effect, (0.1,)),), np.zeros(0), cost)


def effects(cost: float, *names: str) -> Hypothesis:
    return Hypothesis(tuple(neutral(EFFECTS[n]) for n in names), np.zeros(0), cost)


def described(cost: float, *features: str) -> Remainder:
    pieces = tuple(Piece("yaw_rate", f, 1.0, 100.0) for f in features)
    return Remainder(1.0, pieces, fitted(features[-1] if features else "speed", cost))


def test_of_features_as_good_the_plainest_is_taken() -> None:
    power, torque, cubic = (
        fitted(*x) for x in (("torque_speed", 100.0), ("torque", 104.0), ("delta_cubed", 90.0))
    )
    assert plainest([power, torque], 20.0) is torque
    assert plainest([power, torque], 2.0) is power
    assert plainest([power, torque, cubic], 5.0) is cubic


def test_several_effects_are_a_disguise_of_what_one_term_says_better() -> None:
    found = Search(noise=1000.0, all=5000.0)
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    assert simpler(described(1050.0, "yaw_rate_per_speed"), pair, found)
    # Not where the effects do as well, nor by more terms than there are effects.
    assert not simpler(described(1290.0, "yaw_rate_per_speed"), pair, found)
    assert not simpler(described(1050.0, "yaw_rate", "delta", "speed"), pair, found)
    assert not simpler(described(1050.0), pair, found)


def test_a_poor_stand_in_asks_more_of_an_expression() -> None:
    pair = effects(1300.0, "rear_wheel_steer", "steering_ratio")
    plain = described(1050.0, "yaw_rate_per_speed")
    assert simpler(plain, pair, Search(noise=1000.0, all=5000.0))
    assert not simpler(plain, pair, Search(noise=1000.0, all=5000.0, own=3000.0))
