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

from adk_ros.mismatch.catalogue import EFFECTS
from adk_ros.mismatch.effect import ALWAYS, PLACE, TIME
from adk_ros.mismatch.lap import Lap
from adk_ros.mismatch.likelihood import Active, Hypothesis, Likelihood
from adk_ros.mismatch.onsets import best_onset
from adk_ros.mismatch.places import PlaceMap, candidate, refine
from adk_ros.mismatch.screen import Screen

PER_VARIABLE = 8.0
PER_PLACE = 8.0
LEAST_GAIN = 40.0
LEAST_SHARE = 0.25
LEAST_OF_ALL = 5e-4
LEAST_OF_OWN = 0.12
MOST_EFFECTS = 3
_FITTED_SINGLES = 16
_BEAM = 3
_REFIT = 6
_QUICK = 4
_PRUNED = 0.4
_PROMISING_SINGLE, _PROMISING = 0.05, 0.3
"""Share of the best linear gain below which none is fitted."""
_SOONER = 1.1
"""An onset must gain this many times what the effect gains throughout."""

Progress = Callable[[float, float, str], None]


@dataclass
class Search:
    """
    The way to an answer: the best hypothesis of each size, and all rivals that were fitted.

    `levels[k]` are hypotheses with k effects, best first; `maps` what the places said.
    """

    levels: list[list[Hypothesis]] = field(default_factory=list)
    maps: list[PlaceMap] = field(default_factory=list)
    noise: float = 0.0
    all: float = 0.0
    """Loss above the noise before any effect."""
    own: float = 0.0
    """The stand-in's own error in the loss."""

    def best(self) -> Hypothesis:
        """Return the largest hypothesis each of whose effects was worth it."""
        chosen = self.levels[0][0]
        for level in self.levels[1:]:
            if not level or not worth(level[0], chosen, self):
                break
            chosen = level[0]
        return chosen


def penalised(h: Hypothesis) -> float:
    """Return the loss with the penalty for what was fitted."""
    extra = 0.0
    for active in h.actives:
        extra += PER_VARIABLE * len(active.inner)
        extra += PER_PLACE * len(active.gate.variables())
    return h.cost + extra


def worth(h: Hypothesis, before: Hypothesis, found: Search) -> bool:
    """Whether `h` is enough better than `before`, which has fewer effects."""
    gain = penalised(before) - penalised(h)
    more = max(len(h.actives) - len(before.actives), 1)
    return gain > more * required(before, found)


def required(before: Hypothesis, found: Search) -> float:
    """Return the gain that one effect more than in `before` must bring."""
    left = max(before.cost - found.noise, 0.0)
    least = max(LEAST_GAIN, LEAST_OF_OWN * found.own)
    return max(least, LEAST_SHARE * left, LEAST_OF_ALL * found.all)


def search(
    likelihood: Likelihood, lap: Lap | None, progress: Progress | None = None,
    most: int = MOST_EFFECTS,
) -> Search:
    """Look for the effects that a recording needs, `most` of them."""
    found = Search()
    nothing = likelihood.fit([], settled=1e-4)
    assert nothing.fit is not None
    found.noise = likelihood.level(nothing.fit.residuals)
    found.all = max(nothing.cost - found.noise, 0.0)
    found.own = likelihood.own_error()
    found.levels.append([nothing])
    beam = [nothing]
    for size in range(1, most + 1):
        level: list[Hypothesis] = []
        for i, start in enumerate(beam):
            if progress is not None:
                what = "one effect" if size == 1 else f"{size} effects"
                progress(size - 1 + i / len(beam), most, what)
            level += _extend(likelihood, start, lap, found, single=size == 1)
        quick = _distinct(level)[:_REFIT]
        level = [
            _finished(likelihood, h) if _near(h, quick[0], found.noise) else h for h in quick
        ]
        level = [h for h in level if all(a.material() for a in h.actives)]
        level = _distinct(level)
        if not level:
            break
        found.levels.append(level)
        if not worth(level[0], found.levels[size - 1][0], found):
            break
        near = penalised(level[0]) + 0.5 * max(level[0].cost - found.noise, 0.0) + 1000.0
        beam = [h for h in level[:_BEAM] if penalised(h) < near]
    return found


def _extend(
    likelihood: Likelihood, start: Hypothesis, lap: Lap | None, found: Search, single: bool
) -> list[Hypothesis]:
    """Fit the best hypotheses with one effect more."""
    known = likelihood.tolerance_columns(start)
    screen = Screen(likelihood, start, known)
    out_of_reach = {*start.names, *likelihood.beyond}
    free = [effect for effect in EFFECTS.values() if effect.name not in out_of_reach]
    # A linear gain may be far off where much is missing; where little is, it is nearly exact.
    least = LEAST_GAIN if single else required(start, found)
    least *= _PRUNED
    tried: list[tuple[float, Active]] = []
    timed: list[tuple[float, Active]] = []
    placed: list[tuple[float, Active]] = []
    for effect in free:
        if ALWAYS in effect.scopes:
            screened = screen.effect(effect)
            tried += [(x.gain, x.active) for x in (screened if single else screened[:1])]
            onset = best_onset(screen, screened[0].active) if TIME in effect.scopes else None
            if onset is not None and onset[0] > _SOONER * screened[0].gain:
                timed.append(onset)
        if lap is not None and PLACE in effect.scopes:
            place, place_map = candidate(screen, effect, lap)
            found.maps.append(place_map)
            placed += [place] if place is not None else []
    top = max((x[0] for x in (*tried, *timed, *placed)), default=0.0)
    least = max(least, (_PROMISING_SINGLE if single else _PROMISING) * top)
    out = []
    for _, active in _most(tried, least, _FITTED_SINGLES if single else _REFIT):
        out.append(
            likelihood.fit([*start.actives, active], start.tolerances, _QUICK, known, 1e-4)
        )
    for _, active in _most(timed, max(least, 0.5 * top), 2):
        out.append(
            likelihood.fit(
                [*start.actives, active], start.tolerances, _QUICK, known, 1e-4, edges=True
            )
        )
    for _, active in _most(placed, max(least, 0.2 * top), 3):
        begun = Hypothesis((*start.actives, active), start.tolerances, start.cost)
        out.append(refine(likelihood, begun, known))
    return out


def _most(
    found: list[tuple[float, Active]], least: float, count: int
) -> list[tuple[float, Active]]:
    """Return those with the largest gains, of at least `least`."""
    enough = [x for x in found if x[0] > least]
    return sorted(enough, key=lambda x: -x[0])[:count]


def _distinct(level: list[Hypothesis]) -> list[Hypothesis]:
    """Return the best fit of each set of effects and scopes, best first."""
    seen: dict[frozenset[tuple[str, str]], Hypothesis] = {}
    for h in sorted(level, key=penalised):
        seen.setdefault(frozenset((a.effect.name, a.gate.kind) for a in h.actives), h)
    return list(seen.values())


def _near(h: Hypothesis, best: Hypothesis, noise: float) -> bool:
    """Whether a quick fit leaves little enough that a thorough one might turn the order."""
    return h.cost - noise < 2.0 * max(best.cost - noise, 0.0) + 2000.0


def _finished(likelihood: Likelihood, h: Hypothesis) -> Hypothesis:
    edges = any(not a.gate.always for a in h.actives)
    return likelihood.fit(h.actives, h.tolerances, 6, None, 3e-5, edges=edges)
