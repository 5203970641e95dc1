# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forward beam selection of effects with a penalised Huber loss.

Single effects are screened and fitted; pairs and triples extend the best few, as long as the
further effect is accepted (`inference.selection_path`). Effects of one cause
(`library.catalogue.COMMON_CAUSES`) are also fitted together, whatever each gains alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adk_ros.mismatch.inference.block_scores import BLOCK_S
from adk_ros.mismatch.inference.effect_screening import screened_effects
from adk_ros.mismatch.inference.fit_budget import JOINT, NULL_HYPOTHESIS, SCREENING
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.inference.segmentation import BINS
from adk_ros.mismatch.inference.segments import (
    refine_segments,
)
from adk_ros.mismatch.inference.selection_path import (
    SelectionPath,
    free_directions,
    is_improvement,
    least_required_gain,
    penalised_loss,
)
from adk_ros.mismatch.inference.significance import significant_effects
from adk_ros.mismatch.library.catalogue import COMMON_CAUSES
from adk_ros.mismatch.library.criteria import (
    MIN_FIRST_GAIN,
)
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME
from adk_ros.mismatch.library.search_limits import (
    BEAM_EXCESS_SHARE,
    BEAM_NOISE_SHARE,
    BEAM_WIDTH,
    MAX_EFFECTS,
    MAX_ONSETS_FITTED,
    MAX_REFITS,
    MAX_SEGMENTED_FITTED,
    MAX_SINGLES_FITTED,
    MIN_SCREENED_GAIN,
    MIN_SCREENED_GAIN_ONSET,
    MIN_SCREENED_GAIN_SEGMENT,
    MIN_SCREENED_GAIN_SINGLE,
    PRUNING_SHARE,
    PRUNING_SHARE_SINGLE,
    REFIT_EXCESS_RATIO,
    REFIT_NOISE_SHARE,
    REFIT_NULL_SHARE,
)
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import FloatArray

Progress = Callable[[float, float, str], None]


def select_effects(
    likelihood: Likelihood,
    lap: Lap | None,
    progress: Progress | None = None,
    max_effects: int = MAX_EFFECTS,
) -> SelectionPath:
    """Select at most `max_effects` effects of the catalogue that a recording requires."""
    path = SelectionPath()
    null = likelihood.fit([], budget=NULL_HYPOTHESIS)
    assert null.fit is not None
    path.expected_loss = likelihood.expected_loss(null.fit.residuals)
    path.noise_loss_variance = likelihood.noise_loss_variance()
    path.null_excess_loss = max(null.loss - path.expected_loss, 0.0)
    by_direction = likelihood.losses_by_direction(null.fit.residuals)
    path.expected_by_direction = likelihood.expected_by_direction(null.fit.residuals)
    path.null_excess_by_direction = np.maximum(by_direction - path.expected_by_direction, 0.0)
    path.surrogate_error_dof = likelihood.surrogate_error_dof()
    path.levels.append([null])
    path.examined = examined_count(likelihood, lap)
    beam, chosen = [null], null
    for size in range(1, max_effects + 1):
        level: list[Hypothesis] = []
        for i, start in enumerate(beam):
            if progress is not None:
                text = "one effect" if size == 1 else f"{size} effects"
                progress(size - 1 + i / len(beam), max_effects, text)
            level += _extend(likelihood, start, lap, path)
        level += [h for h in path.of_one_cause if len(h.effects) == size]
        level = refit_competitive(likelihood, level, path)
        path.levels += [level] if level else []
        accepted = path.first_accepted(level, chosen)
        if accepted is None:
            break
        chosen = accepted
        best = level[0]
        excess = max(best.loss - path.expected_loss, 0.0)
        margin = BEAM_EXCESS_SHARE * excess + BEAM_NOISE_SHARE * path.expected_loss
        limit = penalised_loss(best) + margin
        beam = [h for h in level[:BEAM_WIDTH] if penalised_loss(h) < limit]
        # What is accepted, for its gain in one direction, need not be among those.
        beam += [accepted] if all(h is not accepted for h in beam) else []
    if max_effects > 1 and path.best() is null:
        together = refit_competitive(likelihood, path.of_one_cause, path)
        path.levels += [together] if together else []
    return path


def _extend(
    likelihood: Likelihood, start: Hypothesis, lap: Lap | None, path: SelectionPath
) -> list[Hypothesis]:
    """Fit the best hypotheses with one more effect than `start`."""
    single = not start.effects
    jacobian = likelihood.nuisance_jacobian(start)
    linearised = LinearisedProblem(likelihood, start, jacobian)
    screening = screened_effects(linearised, lap, path)
    if single:
        path.of_one_cause = _of_one_cause(linearised, jacobian)
    free = free_directions(start, path)
    # A linearised gain may be far off where much is unexplained; otherwise it is nearly exact.
    least = (
        PRUNING_SHARE_SINGLE * MIN_FIRST_GAIN
        if single
        else PRUNING_SHARE * least_required_gain(start, path)
    )

    def leading(candidates: list[Candidate], share: float, count: int) -> list[ActiveEffect]:
        return screening.leading(candidates, free, least, share, count)

    def fit(active: ActiveEffect, fit_activation: bool) -> Hypothesis:
        return likelihood.fit(
            [*start.effects, active],
            nuisances=start.nuisances,
            budget=SCREENING,
            jacobian=jacobian,
            fit_activation=fit_activation,
        )

    share = MIN_SCREENED_GAIN_SINGLE if single else MIN_SCREENED_GAIN
    always = leading(screening.always, share, MAX_SINGLES_FITTED if single else MAX_REFITS)
    out = [fit(active, fit_activation=False) for active in always]
    onset_share = max(share, MIN_SCREENED_GAIN_ONSET)
    for active in leading(screening.onset, onset_share, MAX_ONSETS_FITTED):
        out.append(fit(active, fit_activation=True))
    segment_share = max(share, MIN_SCREENED_GAIN_SEGMENT)
    for active in leading(screening.segments, segment_share, MAX_SEGMENTED_FITTED):
        extended = Hypothesis((*start.effects, active), start.nuisances, start.loss)
        out.append(refine_segments(likelihood, extended, jacobian))
    return out


def _of_one_cause(linearised: LinearisedProblem, jacobian: FloatArray) -> list[Hypothesis]:
    """Fit the sets of effects that one change of the car has together, if they may gain enough."""
    likelihood, null = linearised.likelihood, linearised.hypothesis
    out = []
    for names in COMMON_CAUSES:
        effects = [likelihood.effects[name] for name in names if name in likelihood.effects]
        if len(effects) < len(names) or likelihood.unobservable & set(names):
            continue
        starts = [tuple(p.theta_neutral + p.step for p in effect.parameters) for effect in effects]
        active = [ActiveEffect(effect, x) for effect, x in zip(effects, starts, strict=True)]
        gain = linearised.solve(np.column_stack([linearised.column(one) for one in active]))[1]
        if gain > len(names) * PRUNING_SHARE_SINGLE * MIN_FIRST_GAIN:
            out.append(
                likelihood.fit(
                    active, nuisances=null.nuisances, budget=SCREENING, jacobian=jacobian
                )
            )
    return out


def examined_count(likelihood: Likelihood, lap: Lap | None) -> int:
    """
    Return the number of effects, onsets and places that one extension examines.

    Onsets within a block are not independent, nor are segments within a bin of the lap.
    """
    effects = [x for x in likelihood.effects.values() if x.name not in likelihood.unobservable]
    problem = likelihood.problem
    onsets = int((min(problem.bin_s[-1], likelihood.until_s) - problem.start_s) / BLOCK_S)
    always = sum(len(x.parameters) for x in effects if ALWAYS in x.activations)
    timed = sum(TIME in x.activations for x in effects)
    placed = sum(PLACE in x.activations for x in effects)
    bins = 0 if lap is None else BINS * len(lap.routes)
    return always + timed * onsets + placed * bins


def refit_competitive(
    likelihood: Likelihood, level: list[Hypothesis], path: SelectionPath
) -> list[Hypothesis]:
    """
    Fit the competitive hypotheses jointly; return the distinct ones with material effects.

    A single effect comes first if it gains enough and is significant, so that chance did not make
    it.
    """
    distinct = _distinct(level)
    expected_loss = path.expected_loss
    best_excess = max(distinct[0].loss - expected_loss, 0.0) if distinct else 0.0
    # A joint fit may change the order of those that a screening fit leaves close together, but
    # hardly makes an immaterial effect material: a delay of a millisecond may gain the most.
    screened = sorted(distinct, key=lambda h: not _is_material(h))
    chosen, screened, others = path.best(), screened[:MAX_REFITS], screened[MAX_REFITS:]
    if free_directions(chosen, path):
        # One that is accepted for its gain in such a direction may be behind those of the others.
        further = path.first_accepted(others, chosen)
        screened += [further] if further is not None else []
    limit = REFIT_EXCESS_RATIO * best_excess + REFIT_NOISE_SHARE * expected_loss
    limit += REFIT_NULL_SHARE * path.null_excess_loss
    fitted = [
        likelihood.fit(h.effects, nuisances=h.nuisances, budget=JOINT, fit_activation=True)
        if h.loss - expected_loss < limit
        else h
        for h in screened
    ]
    null = path.levels[0][0]

    def is_claimable(h: Hypothesis) -> bool:
        return is_improvement(h, null, path) and bool(
            significant_effects(likelihood, h, path.examined)
        )

    path.immaterial += [h for h in fitted if len(h.effects) == 1 and not _is_material(h)]
    out = _distinct([h for h in fitted if _is_material(h)])
    return sorted(out, key=lambda h: len(h.effects) == 1 and not is_claimable(h))


def _is_material(h: Hypothesis) -> bool:
    return all(active.is_material() for active in h.effects)


def _distinct(level: list[Hypothesis]) -> list[Hypothesis]:
    """Return the best fit of each set of effects and kinds of activation, best first."""
    seen: dict[frozenset[tuple[str, str]], Hypothesis] = {}
    for h in sorted(level, key=penalised_loss):
        seen.setdefault(frozenset((a.effect.name, a.activation.kind) for a in h.effects), h)
    return list(seen.values())
