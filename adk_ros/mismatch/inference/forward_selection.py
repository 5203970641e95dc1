# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which effects: singles by their own fit, pairs and triples by extension of the best few.

A hypothesis costs its Huber loss plus a penalty: `PER_VARIABLE` for each fitted variable and
`PER_PLACE` more for each edge or onset, whose places were searched for. One effect more is
accepted if it lowers that cost by `LEAST_GAIN` and by `LEAST_SHARE` of what was left above the
noise, since where much is left that nothing explains, chance resemblances gain hundreds; by
`LEAST_OF_ALL` of what there was to explain at all, since no form of an effect is exact; and by
`LEAST_OF_OWN` of the stand-in's own error, some of which any effect may happen to resemble: it is
the same on every lap, and whitening takes it for noise that is new each time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from adk_ros.mismatch.inference.change_points import locate_change_point
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.inference.segments import SpatialProfile, fit_segments, refine_segments
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME
from adk_ros.mismatch.surrogate.lap import Lap

PENALTY_PER_PARAMETER = 8.0
PENALTY_PER_LOCATION = 8.0
MIN_GAIN = 40.0
MIN_GAIN_PER_EXCESS = 0.25
MIN_GAIN_PER_NULL_EXCESS = 5e-4
MIN_GAIN_PER_SURROGATE_ERROR = 0.12
MAX_EFFECTS = 3
_MAX_SINGLES_FITTED = 16
_BEAM_WIDTH = 3
_MAX_REFITS = 6
_QUICK_ITERATIONS = 4
_PRUNING_SHARE = 0.4
_MIN_SCREENED_GAIN_SINGLE, _MIN_SCREENED_GAIN = 0.05, 0.3
"""Share of the best linear gain below which none is fitted."""
ONSET_MIN_GAIN_RATIO = 1.1
"""An onset must gain this many times what the effect gains throughout."""

Progress = Callable[[float, float, str], None]


@dataclass
class SelectionPath:
    """
    The way to an answer: the best hypothesis of each size, and all rivals that were fitted.

    `levels[k]` are hypotheses with k effects, best first; `maps` what the places said.
    """

    levels: list[list[Hypothesis]] = field(default_factory=list)
    profiles: list[SpatialProfile] = field(default_factory=list)
    expected_loss: float = 0.0
    null_excess_loss: float = 0.0
    """Loss above the noise before any effect."""
    surrogate_error_dof: float = 0.0
    """The stand-in's own error in the loss."""

    def best(self) -> Hypothesis:
        """Return the largest hypothesis each of whose effects was worth it."""
        chosen = self.levels[0][0]
        for level in self.levels[1:]:
            if not level or not is_improvement(level[0], chosen, self):
                break
            chosen = level[0]
        return chosen


def penalised(h: Hypothesis) -> float:
    """Return the loss with the penalty for what was fitted."""
    extra = 0.0
    for active in h.actives:
        extra += PENALTY_PER_PARAMETER * len(active.theta)
        extra += PENALTY_PER_LOCATION * len(active.activation.variables())
    return h.cost + extra


def is_improvement(h: Hypothesis, before: Hypothesis, found: SelectionPath) -> bool:
    """Whether `h` is enough better than `before`, which has fewer effects."""
    gain = penalised(before) - penalised(h)
    more = max(len(h.actives) - len(before.actives), 1)
    return gain > more * min_required_gain(before, found)


def min_required_gain(before: Hypothesis, found: SelectionPath) -> float:
    """Return the gain that one effect more than in `before` must bring."""
    left = max(before.cost - found.expected_loss, 0.0)
    least = max(MIN_GAIN, MIN_GAIN_PER_SURROGATE_ERROR * found.surrogate_error_dof)
    return max(
        least, MIN_GAIN_PER_EXCESS * left, MIN_GAIN_PER_NULL_EXCESS * found.null_excess_loss
    )


def select_effects(
    likelihood: Likelihood,
    lap: Lap | None,
    progress: Progress | None = None,
    most: int = MAX_EFFECTS,
) -> SelectionPath:
    """Look for the effects that a recording needs, `most` of them."""
    found = SelectionPath()
    nothing = likelihood.fit([], settled=1e-4)
    assert nothing.fit is not None
    found.expected_loss = likelihood.expected_loss(nothing.fit.residuals)
    found.null_excess_loss = max(nothing.cost - found.expected_loss, 0.0)
    found.surrogate_error_dof = likelihood.surrogate_error_dof()
    found.levels.append([nothing])
    beam = [nothing]
    for size in range(1, most + 1):
        level: list[Hypothesis] = []
        for i, start in enumerate(beam):
            if progress is not None:
                what = "one effect" if size == 1 else f"{size} effects"
                progress(size - 1 + i / len(beam), most, what)
            level += _extend(likelihood, start, lap, found, single=size == 1)
        quick = _distinct(level)[:_MAX_REFITS]
        level = [
            _refit_jointly(likelihood, h)
            if _is_competitive(h, quick[0], found.expected_loss)
            else h
            for h in quick
        ]
        level = [h for h in level if all(a.is_material() for a in h.actives)]
        level = _distinct(level)
        if not level:
            break
        found.levels.append(level)
        if not is_improvement(level[0], found.levels[size - 1][0], found):
            break
        near = penalised(level[0]) + 0.5 * max(level[0].cost - found.expected_loss, 0.0) + 1000.0
        beam = [h for h in level[:_BEAM_WIDTH] if penalised(h) < near]
    return found


def _extend(
    likelihood: Likelihood, start: Hypothesis, lap: Lap | None, found: SelectionPath, single: bool
) -> list[Hypothesis]:
    """Fit the best hypotheses with one effect more."""
    known = likelihood.nuisance_jacobian(start)
    screen = LinearisedProblem(likelihood, start, known)
    out_of_reach = {*start.names, *likelihood.unobservable}
    free = [effect for effect in EFFECTS.values() if effect.name not in out_of_reach]
    # A linear gain may be far off where much is missing; where little is, it is nearly exact.
    least = MIN_GAIN if single else min_required_gain(start, found)
    least *= _PRUNING_SHARE
    tried: list[tuple[float, ActiveEffect]] = []
    timed: list[tuple[float, ActiveEffect]] = []
    placed: list[tuple[float, ActiveEffect]] = []
    for effect in free:
        if ALWAYS in effect.activations:
            screened = screen.screen_effect(effect)
            tried += [(x.gain, x.active) for x in (screened if single else screened[:1])]
            onset = (
                locate_change_point(screen, screened[0].active)
                if TIME in effect.activations
                else None
            )
            if onset is not None and onset[0] > ONSET_MIN_GAIN_RATIO * screened[0].gain:
                timed.append(onset)
        if lap is not None and PLACE in effect.activations:
            place, place_map = fit_segments(screen, effect, lap)
            found.profiles.append(place_map)
            placed += [place] if place is not None else []
    top = max((x[0] for x in (*tried, *timed, *placed)), default=0.0)
    least = max(least, (_MIN_SCREENED_GAIN_SINGLE if single else _MIN_SCREENED_GAIN) * top)
    out = []
    for _, active in _top_candidates(tried, least, _MAX_SINGLES_FITTED if single else _MAX_REFITS):
        out.append(
            likelihood.fit(
                [*start.actives, active], start.tolerances, _QUICK_ITERATIONS, known, 1e-4
            )
        )
    for _, active in _top_candidates(timed, max(least, 0.5 * top), 2):
        out.append(
            likelihood.fit(
                [*start.actives, active],
                start.tolerances,
                _QUICK_ITERATIONS,
                known,
                1e-4,
                edges=True,
            )
        )
    for _, active in _top_candidates(placed, max(least, 0.2 * top), 3):
        begun = Hypothesis((*start.actives, active), start.tolerances, start.cost)
        out.append(refine_segments(likelihood, begun, known))
    return out


def _top_candidates(
    found: list[tuple[float, ActiveEffect]], least: float, count: int
) -> list[tuple[float, ActiveEffect]]:
    """Return those with the largest gains, of at least `least`."""
    enough = [x for x in found if x[0] > least]
    return sorted(enough, key=lambda x: -x[0])[:count]


def _distinct(level: list[Hypothesis]) -> list[Hypothesis]:
    """Return the best fit of each set of effects and scopes, best first."""
    seen: dict[frozenset[tuple[str, str]], Hypothesis] = {}
    for h in sorted(level, key=penalised):
        seen.setdefault(frozenset((a.effect.name, a.activation.kind) for a in h.actives), h)
    return list(seen.values())


def _is_competitive(h: Hypothesis, best: Hypothesis, noise: float) -> bool:
    """Whether a quick fit leaves little enough that a thorough one might turn the order."""
    return h.cost - noise < 2.0 * max(best.cost - noise, 0.0) + 2000.0


def _refit_jointly(likelihood: Likelihood, h: Hypothesis) -> Hypothesis:
    edges = any(not a.activation.always for a in h.actives)
    return likelihood.fit(h.actives, h.tolerances, 6, None, 3e-5, edges=edges)
