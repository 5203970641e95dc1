# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which competing effects are alternatives to an identified one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from adk_ros.mismatch.inference import identifiability
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.identifiability import (
    Identifiability,
    LeftOutScores,
    assess_identifiability,
)
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import Candidate
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.numerics.arrays import FloatArray

SHIFT = ActiveEffect(EFFECTS["cg_shift"], (-0.04,))
MILLISECOND = ActiveEffect(EFFECTS["clock_offset"], (0.0008,))


class Table(Likelihood):
    """Losses by the names of the effects."""

    def __init__(self, losses: Mapping[tuple[str, ...], float]) -> None:
        """Nothing is measured."""
        self.losses = losses

    unobservable: frozenset[str] = frozenset()

    def surrogate_error_dof(self) -> float:
        return 0.0

    def nuisance_jacobian(self, h: Hypothesis) -> FloatArray:
        return np.zeros((0, 0))

    def fit(self, effects: Sequence[ActiveEffect], **_: object) -> Hypothesis:
        names = tuple(active.effect.name for active in effects)
        return Hypothesis(tuple(effects), np.zeros(0), self.losses[names])


def assessed(
    monkeypatch: pytest.MonkeyPatch,
    competitor: ActiveEffect,
    losses: Mapping[tuple[str, ...], float],
) -> Identifiability:
    """The identifiability of a shifted centre of gravity, which leaves a loss of 1000 of 1050."""
    name = competitor.effect.name
    table = Table({("cg_shift",): 1000.0, (): 1050.0} | dict(losses))
    scores = LeftOutScores(np.zeros(3), 0.0)
    monkeypatch.setattr(identifiability, "LinearisedProblem", lambda *_: None)
    monkeypatch.setattr(
        identifiability, "_similar_effects", lambda *_: [Candidate(competitor, 100.0)]
    )
    monkeypatch.setattr(identifiability.LeftOutScores, "of", lambda *_: scores)
    assert (name,) in losses
    return assess_identifiability(table, Hypothesis((SHIFT,), np.zeros(0), 1000.0), 0)


@pytest.mark.parametrize("loss", [930.0, 999.0, 1003.0])
def test_a_delay_of_a_millisecond_is_no_alternative_to_what_it_does_not_explain(
    monkeypatch: pytest.MonkeyPatch, loss: float
) -> None:
    """Next to it, the shift gains 48 of its 50."""
    found = assessed(
        monkeypatch,
        MILLISECOND,
        {("clock_offset",): loss, ("clock_offset", "cg_shift"): loss - 48.0},
    )
    assert found.competitors == ()
    assert [name for name, _ in found.alternatives_to] == ["none"]


def test_one_that_explains_the_same_is_what_may_be_in_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = assessed(
        monkeypatch, MILLISECOND, {("clock_offset",): 999.0, ("clock_offset", "cg_shift"): 996.0}
    )
    assert [c.name for c in found.competitors] == ["clock_offset"]
    assert found.alternatives == []
    assert [name for name, _ in found.alternatives_to] == ["none", "clock_offset"]


def test_a_material_effect_that_fits_as_well_is_an_alternative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    softer = ActiveEffect(EFFECTS["rear_tyre_stiffness"], (0.9,))
    found = assessed(monkeypatch, softer, {("rear_tyre_stiffness",): 1003.0})
    assert found.alternatives == ["rear_tyre_stiffness"]
    assert [name for name, _ in found.alternatives_to] == ["none"]
    # One that is no alternative by itself is what may be in its place all the same.
    refused = found.without_alternatives({("cg_shift", "rear_tyre_stiffness")})
    assert refused.alternatives == []
    assert [name for name, _ in refused.alternatives_to] == ["none", "rear_tyre_stiffness"]
    assert found.without_alternatives({("yaw_inertia", "rear_tyre_stiffness")}) == found
