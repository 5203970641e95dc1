# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Refinement of a feature with parameters: their values, and signals that contain its own effect.

A feature is first computed from the motion of the surrogate without it. Where it changes that
motion, as a moving mass does, its frequency and damping come out shifted. Here the signals are
those of the corrected model, and the parameters take Gauss-Newton steps. The threshold of a gate,
on which the residuals depend by steps, and oscillations are left as the search returns them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.inference.feature_effect import (
    FeatureEffect,
    active_feature,
    feature_as_effect,
    feature_terms,
)
from adk_ros.mismatch.inference.fit_budget import FEATURE
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.features import Signals, feature
from adk_ros.mismatch.library.parametric_features import (
    HYSTERESIS,
    LAG,
    RESONANCE,
    kind_of,
    scaled,
    sizes_of,
)
from adk_ros.mismatch.surrogate.feature_terms import feature_signals
from adk_ros.numerics.arrays import FloatArray

_ROUNDS = 4
_DIFFERENCE = 0.02
"""Relative difference step of a parameter."""
_MAX_LOG_STEP = 0.3
"""Largest change of a parameter's logarithm in one round."""
_LATERAL = ("v_y", "yaw_rate")
_COUPLED = (LAG, RESONANCE, HYSTERESIS)
"""Kinds that may act in both lateral equations with the same parameters."""


def refined(likelihood: Likelihood, start: Hypothesis, jacobian: FloatArray) -> Hypothesis:
    """
    Return a hypothesis with the parameters of its last feature refined, if it has any.

    The same feature in other equations keeps the same parameters. `jacobian` (m, nuisances):
    derivatives with respect to the nuisance parameters.
    """
    best = current = start
    for _ in range(_ROUNDS):
        shared = _of_last_feature(current)
        if not shared:
            return best
        p, terms = likelihood.simulation_inputs(current.nuisances, current.effects)
        signals = feature_signals(likelihood.problem, likelihood.problem.run(p, terms))
        name = _improved_name(likelihood, current, shared, jacobian, signals)
        effects = [
            _renamed(active, name, signals) if i in shared else active
            for i, active in enumerate(current.effects)
        ]
        current = likelihood.fit(
            effects, nuisances=current.nuisances, budget=FEATURE, jacobian=jacobian
        )
        if current.loss < best.loss:
            best = current
        elif best is not start:
            break
    return best


def with_siblings(
    likelihood: Likelihood,
    start: Hypothesis,
    jacobian: FloatArray,
    equations: Sequence[str],
    least: float,
) -> Hypothesis:
    """
    Return a hypothesis with its last feature in both lateral equations.

    Only features with a memory, since a mass that moves sideways away from the centre of gravity
    also turns the car. The second term must gain `least`.
    """
    current = start
    name = _last_feature(start)
    entered = start.effects[-1].effect
    if (
        kind_of(name) not in _COUPLED
        or not isinstance(entered, FeatureEffect)
        or entered.enters not in _LATERAL
    ):
        return start
    for equation in (name for name in _LATERAL if name in equations):
        last = current.effects[-1]
        assert isinstance(last.effect, FeatureEffect)
        effect = feature_as_effect(equation, last.effect.feature, last.effect.scale)
        if effect.name in current.names:
            continue
        trial = likelihood.fit(
            [*current.effects, ActiveEffect(effect, (0.0,), last.activation)],
            nuisances=current.nuisances,
            budget=FEATURE,
            jacobian=jacobian,
        )
        trial = refined(likelihood, trial, jacobian)
        if current.loss - trial.loss > least:
            current = trial
    return current


def _last_feature(h: Hypothesis) -> str:
    """Return the feature that was added last, or an empty text."""
    last = h.effects[-1].effect if h.effects else None
    return last.feature if isinstance(last, FeatureEffect) else ""


def _of_last_feature(h: Hypothesis) -> list[int]:
    """Return the indices of the effects with the last feature, if that can be refined."""
    name = _last_feature(h)
    if not kind_of(name) or not sizes_of(name):
        return []
    return [
        i
        for i, active in enumerate(h.effects)
        if isinstance(active.effect, FeatureEffect) and active.effect.feature == name
    ]


def _improved_name(
    likelihood: Likelihood,
    h: Hypothesis,
    shared: Sequence[int],
    jacobian: FloatArray,
    signals: Signals,
) -> str:
    """Return the feature after one Gauss-Newton step of its parameters."""
    terms = feature_terms([h.effects[i] for i in shared])
    name = terms[0].feature
    response = LinearResponse.of(LinearisedProblem(likelihood, h, jacobian))
    base = feature(name).function(signals)
    columns = [response.column(term.equation, base) for term in terms]
    count = len(sizes_of(name))
    for j in range(count):
        change = np.zeros(count)
        change[j] = _DIFFERENCE
        moved = scaled(name, np.exp(change).tolist())
        slope = (feature(moved).function(signals) - base) / _DIFFERENCE
        parts = [response.column(term.equation, term.coefficient * slope) for term in terms]
        columns.append(np.sum(parts, axis=0))
    step, _ = response.gain(np.column_stack(columns))
    change = np.clip(step[len(terms) :], -_MAX_LOG_STEP, _MAX_LOG_STEP)
    return scaled(name, np.exp(change).tolist())


def _renamed(active: ActiveEffect, name: str, signals: Signals) -> ActiveEffect:
    """Return another feature in the same equation, of the same size."""
    assert isinstance(active.effect, FeatureEffect)
    coefficient = active.effect.term(active.theta[0]).coefficient
    values = feature(name).function(signals)
    return active_feature(active.effect.enters, name, values, coefficient)
