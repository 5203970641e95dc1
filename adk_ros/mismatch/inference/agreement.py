# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Agreement of several recordings: the size of each effect from each recording alone.

Places and onsets are those of the joint fit; sizes and nuisance parameters are fitted to one
recording at a time. A car that changed between two recordings shows as different sizes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.final_estimate import refitted
from adk_ros.mismatch.inference.heterogeneity import heterogeneity, odd_one_out
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.joint_likelihood import JointLikelihood
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.result import (
    UNKNOWN,
    IdentifiedEffect,
    Interval,
    ParameterAgreement,
)
from adk_ros.mismatch.inference.selection_path import SelectionPath, is_improvement
from adk_ros.mismatch.library.criteria import MIN_ACTIVE_S
from adk_ros.mismatch.library.effect import ALWAYS
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.numerics.constants import QUANTILE_90

DISAGREEMENT_LEVEL = 0.05
"""
Probability that any compared size differs by chance. Convention; Bonferroni's inequality divides
it by the number of sizes.
"""


def sizes_from(decision: Decision, joint: JointLikelihood, kept: Collection[int]) -> Decision:
    """
    Return a decision with sizes fitted to some of the recordings, by index.

    Effects that do not act in them are left out; so is a formula of unknown dynamics.
    """
    part = joint.restricted_to(kept)
    acting = [a for a in decision.hypothesis.effects if active_duration(a, part) >= MIN_ACTIVE_S]
    names = {a.effect.name for a in acting}
    frozen = Hypothesis(
        tuple(_with_fixed_activation(a, part) for a in acting),
        decision.hypothesis.nuisances,
        np.inf,
    )
    given = [replace(e, kind=ALWAYS) for e in decision.effects if e.effect.name in names]
    fitted = refitted(Decision(decision.verdict, given, None, frozen, None), part)
    effects = tuple(
        replace(a, activation=before.activation)
        for a, before in zip(fitted.hypothesis.effects, acting, strict=True)
    )
    return replace(fitted, hypothesis=replace(fitted.hypothesis, effects=effects))


def best_single(path: SelectionPath, decision: Decision) -> Decision | None:
    """Return the best single effect of a selection, if it gains enough and is not decided."""
    null, singles = path.levels[0][0], path.singles()
    if not singles:
        return None
    h = singles[0]
    (active,) = h.effects
    decided = {name for e in decision.effects for name in (e.effect.name, *e.alternatives)}
    if active.effect.name in decided or not is_improvement(h, null, path):
        return None
    kind = active.activation.kind
    given = IdentifiedEffect(active.effect, {}, 0.0, [], kind, [], null.loss - h.loss, ())
    return Decision(UNKNOWN, [given], None, h, None)


def active_duration(active: ActiveEffect, likelihood: Likelihood) -> float:
    """Return the time that an effect acts in the data that count, s."""
    weight = likelihood.problem.binned(np.abs(active.activation.series(likelihood.problem)))
    counted = (likelihood.weights > 0.0).any(axis=0)
    return float(BIN_S * np.minimum(weight, 1.0)[counted].sum())


def _with_fixed_activation(active: ActiveEffect, likelihood: Likelihood) -> ActiveEffect:
    """Return an effect whose place and onset a fit does not change."""
    if active.activation.always or active.activation.weight is not None:
        return active
    weight = active.activation.series(likelihood.problem)
    return replace(active, activation=Activation(weight=weight))


def agreements(joint: Decision, alone: list[Decision]) -> list[ParameterAgreement]:
    """Compare the sizes of a joint decision with those from each recording alone."""
    rows = []
    for identified in joint.effects:
        for name, interval in identified.parameters.items():
            each = tuple(_size_in(one, identified.effect.name, name) for one in alone)
            rows.append((identified.effect.name, name, interval, each))
    tests = sum(_known(each).size > 1 for *_, each in rows)
    return [compared(*row, tests) for row in rows]


def _size_in(decision: Decision, effect: str, parameter: str) -> Interval | None:
    found = next((e for e in decision.effects if e.effect.name == effect), None)
    size = None if found is None else found.parameters[parameter]
    if size is None or not np.isfinite([size.low, size.high]).all() or size.high <= size.low:
        return None
    return size


def _known(each: tuple[Interval | None, ...]) -> np.ndarray:
    return np.flatnonzero([x is not None for x in each])


def compared(
    effect: str, parameter: str, joint: Interval, each: tuple[Interval | None, ...], tests: int
) -> ParameterAgreement:
    """Return the comparison of the sizes in each recording, one of `tests` such comparisons."""
    known = _known(each)
    sizes = [x for x in each if x is not None]
    if known.size < 2:
        return ParameterAgreement(effect, parameter, joint, each)
    values = np.array([x.value for x in sizes])
    deviations = np.array([(x.high - x.low) / (2.0 * QUANTILE_90) for x in sizes])
    level = DISAGREEMENT_LEVEL / tests
    tested = heterogeneity(values, deviations)
    disagree = tested.p_value < level
    odd = odd_one_out(values, deviations, level) if disagree else None
    others = np.nan
    if odd is not None:
        keep = np.arange(values.size) != odd
        others = heterogeneity(values[keep], deviations[keep]).mean
    return ParameterAgreement(
        effect,
        parameter,
        joint,
        each,
        tested.q,
        tested.p_value,
        tested.i_squared,
        disagree,
        None if odd is None else int(known[odd]),
        float(others),
    )
