# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which part of what was fitted is exported as the corrected model.

The parts are tried on the held-out data from all that was fitted to the effects alone. The first
that raises no error at any horizon and lowers the errors on the whole is exported; failing that,
of the parts that lower an error above the expected one and raise none at the reported horizon, nor
beyond chance at another, that with the smallest rise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.deployment.held_out import rmse
from adk_ros.mismatch.deployment.raised_errors import (
    improves,
    largest_rise,
    lowers_on_the_whole,
    raised_beyond_chance,
    raised_states,
)
from adk_ros.mismatch.inference.feature_effect import catalogue_effects, feature_terms
from adk_ros.mismatch.inference.hypothesis import Hypothesis
from adk_ros.mismatch.inference.result import (
    FULL,
    HALF_TOLERANCES,
    NOT_EXPORTED,
    WITHOUT_FEATURES,
    WITHOUT_TOLERANCES,
)
from adk_ros.mismatch.library.parametric_features import is_transferable
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Correction:
    """
    A model on the held-out data: the `part` of the hypothesis in it, `text` of its file.

    `errors` (n, horizons, 3); `raised`: the states whose error the full correction raised;
    `refused`: the full correction, where no part is exported, and `contradicted`: the states whose
    error it raised beyond chance, unless it lowered the errors on the whole.
    """

    part: str
    text: str
    errors: FloatArray
    raised: tuple[str, ...] = ()
    refused: Correction | None = None
    contradicted: tuple[str, ...] = ()


def choose_correction(
    simulation: Correction,
    hypothesis: Hypothesis,
    evaluate: Callable[[str, Hypothesis], Correction],
    expected: FloatArray,
    not_judged: Sequence[str],
) -> Correction:
    """
    Return the part of a hypothesis to export, or `simulation` with what was raised.

    `evaluate(part, hypothesis)` runs a part on the held-out data. Tolerances alone are no
    correction: nothing is missing, and what they lower here they may raise on another recording.
    `expected` (horizons, 3): the errors of a correct model.
    """
    if not _is_correctable(hypothesis):
        return simulation
    before = rmse(simulation.errors)
    raised: tuple[str, ...] = ()
    trials = []
    for part, candidate in _parts(hypothesis):
        trial = evaluate(part, candidate)
        after = rmse(trial.errors)
        higher = raised_states(before, after, not_judged)
        if not higher and lowers_on_the_whole(before, after, not_judged):
            return trial
        raised = raised or tuple(higher)
        trials.append(trial)
    allowed = [x for x in trials if improves(simulation.errors, x.errors, expected, not_judged)]
    if allowed:
        return min(allowed, key=lambda x: largest_rise(before, rmse(x.errors), not_judged))
    refused = trials[0]
    # Each state is tested at each horizon, so chance alone raises one here and there.
    contradicted = (
        []
        if lowers_on_the_whole(before, rmse(refused.errors), not_judged)
        else raised_beyond_chance(simulation.errors, refused.errors, not_judged)
    )
    return replace(simulation, raised=raised, refused=refused, contradicted=tuple(contradicted))


def exported(hypothesis: Hypothesis, part: str) -> Hypothesis | None:
    """Return the part of a hypothesis that is exported, or None."""
    return None if part == NOT_EXPORTED else dict(_parts(hypothesis))[part]


def _parts(h: Hypothesis) -> list[tuple[str, Hypothesis]]:
    """Return the corrections to try, from all that was fitted to the effects alone."""
    plain = np.zeros_like(h.nuisances)
    parts = [
        (FULL, h),
        (HALF_TOLERANCES, replace(h, nuisances=0.5 * h.nuisances)),
        (WITHOUT_TOLERANCES, replace(h, nuisances=plain)),
    ]
    effects = catalogue_effects(h.effects)
    if effects and len(effects) < len(h.effects):
        parts.append((WITHOUT_FEATURES, replace(h, effects=effects, nuisances=plain)))
    return parts


def _is_correctable(h: Hypothesis) -> bool:
    """Whether a hypothesis has an effect or a term that a vehicle model can contain."""
    return any(not x.effect.sensor for x in catalogue_effects(h.effects)) or any(
        is_transferable(term.feature) for term in feature_terms(h.effects)
    )
