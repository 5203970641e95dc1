# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Backward elimination of feature terms that a later term makes superfluous.

Terms are added one by one. The first may be a plain feature that merely resembles the one that
acts, such as the lateral acceleration next to a load that it moves: once that is found, the first
has little left to explain.
"""

from __future__ import annotations

from collections.abc import Sequence

from adk_ros.mismatch.inference.fit_budget import FEATURE, FEATURE_REFIT
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.parametric_refinement import refined
from adk_ros.numerics.arrays import FloatArray


def without_superfluous(
    likelihood: Likelihood,
    start: Hypothesis,
    earlier: Sequence[int],
    jacobian: FloatArray,
    least: float,
) -> tuple[Hypothesis, list[int]]:
    """
    Return a hypothesis without the earlier terms that gain less than `least`, and their indices.

    `least` is what a term must gain to be added, so that a dropped term is not added again. The
    parameters of the last term are refined without those that are dropped. `jacobian` (m,
    nuisances): derivatives with respect to the nuisance parameters.
    """
    current, left = start, list(earlier)
    dropped: list[int] = []
    while left:
        trials = [(_without(likelihood, start, [*dropped, i], jacobian), i) for i in left]
        trial, index = min(trials, key=lambda x: x[0].loss)
        if trial.loss - start.loss > least * (len(dropped) + 1):
            trial = refined(likelihood, trial, jacobian)
        if trial.loss - start.loss > least * (len(dropped) + 1):
            break
        current = trial
        dropped.append(index)
        left.remove(index)
    if not dropped:
        return start, []
    return (
        likelihood.fit(current.effects, nuisances=current.nuisances, budget=FEATURE_REFIT),
        dropped,
    )


def _without(
    likelihood: Likelihood, h: Hypothesis, dropped: Sequence[int], jacobian: FloatArray
) -> Hypothesis:
    """Return a hypothesis fitted without some of its effects."""
    effects = [active for i, active in enumerate(h.effects) if i not in dropped]
    return likelihood.fit(effects, nuisances=h.nuisances, budget=FEATURE, jacobian=jacobian)
