# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Questions for single effects: why an effect is claimed or not, and what would decide.

The effect is fitted to the training part twice: next to no other effect, and next to the
identified ones. Its gain is compared with the gain that the selection requires; `required_size`
says which size, or how much driving, would suffice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.asked_effect import FORMULA, AskedEffect, AskedFit
from adk_ros.mismatch.inference.change_points import locate_change_point
from adk_ros.mismatch.inference.decision import Decision
from adk_ros.mismatch.inference.effect_intervals import confidence_intervals
from adk_ros.mismatch.inference.experiment_design import (
    Discriminability,
    most_discriminating_manoeuvre,
)
from adk_ros.mismatch.inference.feature_effect import catalogue_effects
from adk_ros.mismatch.inference.fit_budget import ABLATION, FINAL, SCREENING
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, inactive_effect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.required_size import Reach, more_driving, sufficient_loss
from adk_ros.mismatch.inference.result import NONE, NOT_SUPPORTED
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.inference.segments import fit_segments, refine_segments
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    gain_and_required,
    penalised_loss,
    required_gain_of,
)
from adk_ros.mismatch.inference.significance import significant_effects
from adk_ros.mismatch.library.criteria import ONSET_MIN_FURTHER_GAIN
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME, Effect
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Questioned:
    """What questions are about: likelihood of the training part, selection, decision, lap."""

    likelihood: Likelihood
    path: SelectionPath
    decision: Decision
    lap: Lap | None
    base: FloatArray
    """The surrogate's parameters, with which manoeuvres are simulated."""


def answer(name: str, about: Questioned) -> AskedEffect:
    """Return why the effect `name` of the catalogue is claimed or not, and what would decide."""
    effect, decision = about.likelihood.effects[name], about.decision
    claimed = any(identified.effect.name == name for identified in decision.effects)
    if name in about.likelihood.unobservable:
        return AskedEffect(name, False, "the channels of this recording do not show it")
    if about.lap is None and effect.activations == (PLACE,):
        return AskedEffect(
            name, False, "it acts at places only, and no part of the route is driven twice"
        )
    alone_h = _fitted(effect, about, about.path.levels[0][0])
    alone = None if alone_h is None else _fit(alone_h, about.path.levels[0][0], about)
    added = added_h = None
    next_to = _others(name, decision)
    if next_to:
        before, added_h = _with_and_without(effect, about)
        added = None if added_h is None else _fit(added_h, before, about)
    tied = next((e.effect.name for e in decision.effects if name in e.alternatives), "")
    answered = AskedEffect(name, claimed, "", next_to, alone, added, tied)
    fitted = added_h or alone_h
    if (tied or mimics(answered)) and alone_h is not None:
        # In place of an identified effect it has the size that it has alone.
        fitted = replace(alone_h, effects=(*decision.hypothesis.effects, *alone_h.effects))
    return replace(
        answered,
        reason=_reason(answered, decision),
        distinguishing=(
            None
            if fitted is None or fitted.effects[-1].activation.kind == PLACE
            else _distinguishing(answered, fitted, about)
        ),
    )


def _others(name: str, decision: Decision) -> tuple[str, ...]:
    """Return the names of the other decided effects, and `FORMULA` if there are feature terms."""
    every = decision.hypothesis.effects
    listed = catalogue_effects(every)
    names = [a.effect.name for a in listed if a.effect.name != name]
    return (*names, FORMULA) if len(listed) < len(every) else tuple(names)


def _with_and_without(effect: Effect, about: Questioned) -> tuple[Hypothesis, Hypothesis | None]:
    """Return the decided hypothesis without the effect and with it, both fitted."""
    h = about.decision.hypothesis
    if effect.name not in h.names:
        return h, _fitted(effect, about, h)
    # Last, as in a hypothesis to which it is added.
    others = [a for a in h.effects if a.effect.name != effect.name]
    asked = [a for a in h.effects if a.effect.name == effect.name][:1]
    without = about.likelihood.fit(others, nuisances=h.nuisances, budget=ABLATION)
    return without, about.likelihood.fit(
        [*others, *asked], nuisances=h.nuisances, budget=FINAL, fit_activation=True
    )


def _fitted(effect: Effect, about: Questioned, before: Hypothesis) -> Hypothesis | None:
    """Return `before` with the effect added last: always, in segments or from a time on."""
    likelihood = about.likelihood
    jacobian = likelihood.nuisance_jacobian(before)
    linearised = LinearisedProblem(likelihood, before, jacobian)
    ways: list[Hypothesis] = []
    if ALWAYS in effect.activations:
        (first, *_) = linearised.screen_effect(effect)
        onset = locate_change_point(linearised, first.active)
        actives = [first.active]
        actives += [onset.active] if onset is not None and TIME in effect.activations else []
        ways += [
            likelihood.fit(
                [*before.effects, active],
                nuisances=before.nuisances,
                budget=SCREENING,
                jacobian=jacobian,
                fit_activation=True,
            )
            for active in actives
        ]
    if about.lap is not None and PLACE in effect.activations:
        candidate, _ = fit_segments(linearised, effect, about.lap)
        if candidate is not None:
            start = Hypothesis((*before.effects, candidate.active), before.nuisances, before.loss)
            ways.append(refine_segments(likelihood, start, jacobian))
    if not ways:
        return None
    best = _simplest_sufficient(ways, before, about.path)
    return likelihood.fit(
        best.effects, nuisances=best.nuisances, budget=FINAL, fit_activation=True
    )


def _simplest_sufficient(
    ways: list[Hypothesis], before: Hypothesis, path: SelectionPath
) -> Hypothesis:
    """Return the first way of acting, unless a later one would be claimed and gains far more."""
    best = ways[0]
    required = required_gain_of(best.effects[-1].effect, before, path)
    for way in ways[1:]:
        gain, least = (penalised_loss(before) - penalised_loss(h) for h in (way, best))
        if gain > max(required, (1.0 + ONSET_MIN_FURTHER_GAIN) * least):
            best = way
    return best


def _fit(h: Hypothesis, before: Hypothesis, about: Questioned) -> AskedFit:
    """Return the fit of the last effect of `h`, compared with `before`, which lacks it."""
    active, path = h.effects[-1], about.path
    penalty = (penalised_loss(h) - h.loss) - (penalised_loss(before) - before.loss)
    removed = before.loss - h.loss
    reach = Reach.of(about.likelihood, h, path.examined)
    share = about.likelihood.surrogate_variance_share()
    intervals = confidence_intervals(active, reach.deviation, share)
    parameters = zip(active.effect.parameters, active.theta, strict=True)
    moved = [p for p, theta in parameters if theta != p.theta_neutral]
    significant = significant_effects(about.likelihood, h, path.examined)
    return AskedFit(
        intervals,
        active.activation.kind,
        active.activation.segments,
        active.activation.onset_s,
        *gain_and_required(h, before, path),
        min(max(removed / max(path.null_excess_loss, removed, 1e-9), 0.0), 1.0),
        active.is_material(),
        any(not intervals[p.name].low <= p.neutral <= intervals[p.name].high for p in moved),
        any(x is active for x in significant),
        reach.detectable(active, sufficient_loss(h, path, penalty)),
        more_driving(active.effect, before, path, removed, penalty, reach.significance(active)),
    )


def _reason(answered: AskedEffect, decision: Decision) -> str:
    """Return why the effect is claimed or not; effects by their names."""
    fit = answered.decisive
    if answered.claimed:
        return "it is one of the identified effects"
    if answered.tied_with:
        return f"{answered.tied_with} fits as well: this recording does not distinguish them"
    names = " and ".join(answered.next_to)
    if fit is None:
        context = f"next to {names}, " if names else ""
        return f"{context}no part of the route shows it"
    if mimics(answered):
        verb = "explain" if len(answered.next_to) > 1 else "explains"
        return f"{names} {verb} the same data better, and too little is left for it"
    if not fit.is_nonzero:
        return "the interval of its size contains zero effect"
    if not fit.is_material:
        return "its size is within build tolerance"
    if fit.gain <= fit.required:
        return "its gain in loss is below the required one"
    if not fit.is_significant:
        return "chance reaches this size somewhere among all effects, places and onsets examined"
    if decision.verdict == NONE:
        return NOT_SUPPORTED
    if not decision.effects:
        return "it does not explain the errors on held-out data"
    return (
        "its gain would suffice, but a hypothesis with it is not the best one found, or held-out "
        "data do not confirm it"
    )


def mimics(answered: AskedEffect) -> bool:
    """Whether an effect alone would be claimed, but not next to the identified ones."""
    alone, added = answered.alone, answered.added
    return bool(alone and added and alone.suffices and not added.suffices)


def _distinguishing(
    answered: AskedEffect, fitted: Hypothesis, about: Questioned
) -> Discriminability:
    """
    Return the best manoeuvre for an effect at its fitted size, at least a material one.

    It separates an effect that is tied with an identified one, or mimics it, from that one; any
    other effect from no effect.
    """
    noise = about.likelihood.problem.bin_noise
    asked = _at_least_material(fitted.effects[-1])
    kept = [a for a in catalogue_effects(fitted.effects) if a.effect.name != answered.name]
    if kept and (answered.tied_with or mimics(answered)):
        gains = {e.effect.name: e.gain for e in about.decision.effects}
        gains[answered.tied_with] = np.inf
        which = max(range(len(kept)), key=lambda i: gains.get(kept[i].effect.name, 0.0))
        return most_discriminating_manoeuvre(about.base, kept, which, asked, noise)
    absent = inactive_effect(asked.effect)
    return most_discriminating_manoeuvre(about.base, [*kept, asked], len(kept), absent, noise)


def _at_least_material(active: ActiveEffect) -> ActiveEffect:
    """Return an effect, its first parameter at the materiality threshold if it is below it."""
    if active.is_material():
        return active
    first = active.effect.parameters[0]
    sign = -1.0 if active.theta[0] < first.theta_neutral else 1.0
    least = first.materiality_threshold
    reach = first.theta(least) if first.inverse else sign * least
    return replace(active, theta=(first.theta_neutral + reach, *active.theta[1:]))
