# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forward selection of effects and levels over a fleet.

Each step examines every parameter of every effect at every level:

1. Candidates that save too little of the loss where they act are left out (`saved_loss`). The gain
   of each other one without variance components bounds its evidence from above; all levels of a
   parameter come from one linear problem.
2. In the order of these gains, each candidate is fitted with its variance components. Its evidence
   is t^2 with the variance of the model; its significance is Student's t with the total variance
   (`variance_components.total_variance`) and its degrees of freedom.
3. Of the significant candidates that of the largest evidence is added.

Afterwards all components are fitted again, and terms that are no longer significant are dropped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import ndtri

from adk_ros.fleet.inference.assessment import Assessment, extended
from adk_ros.fleet.inference.fleet_candidates import (
    Candidates,
    Identity,
    identity,
    is_repeated_by,
)
from adk_ros.fleet.inference.fleet_model import (
    Candidate,
    FleetModel,
    remaining_excess,
    rise,
    strangers_of,
    without_faults,
)
from adk_ros.fleet.inference.levels import RAMP, Level, is_trend, is_usable
from adk_ros.fleet.inference.variance_components import fitted_components
from adk_ros.mismatch.library.criteria import PENALTY_PER_PARAMETER

_FITTED_ONSETS = 40
"""Change points among which that of a claimed trend is chosen, over its recordings. By choice."""
MAX_TERMS = 30
"""Most terms of a selection: far more than a fleet lacks; bounds the time. By choice."""
_FIRST_OF_PAIR, _EXAMINED = 2, 6
"""
Candidates that are tried as the first of two, the likeliest ones, among as many of the largest
gains. By choice.
"""
_MOST_DROPS = 2
"""Times that a claim may be dropped until it is no candidate any more; ends the selection."""


class Selection(Candidates):
    """Forward selection among the candidates of a fleet."""

    def with_all_candidates(self) -> Selection:
        """Return the selection with those that are not examined: they may explain as much."""
        every = copy(self)
        every.refused = frozenset()
        return every

    def select(
        self, start: FleetModel | None = None, replaced: Collection[Identity] = ()
    ) -> FleetModel:
        """
        Return the claimed terms of the fleet, fitted.

        `start`: those claimed already. `replaced`: candidates that these stand for.
        """
        model = self._without_claims() if start is None else self.without_insignificant(start)[0]
        drops: Counter[Identity] = Counter()
        while len(model.claimed) < MAX_TERMS:
            self.progress(len(model.claimed) / MAX_TERMS, "selecting effects and levels")
            refused = {*replaced, *(one for one, times in drops.items() if times >= _MOST_DROPS)}
            best = self.best(model, refused, with_repeats=True)
            moved = self._with_onset_again(model, best)
            if moved is not None:
                model = moved
                continue
            if best is not None and self.repeats(model, *identity(best.candidate)):
                best = self.best(model, refused)
            if best is None:
                both = self._pair_that_saves(model, refused)
                if both is None:
                    break
                model = both
                continue
            larger, dropped = self.with_claim(model, best)
            if any(identity(one) == identity(best.candidate) for one in dropped):
                # With all components fitted it is none: what went with it was right without it.
                drops[identity(best.candidate)] = _MOST_DROPS
                continue
            model = larger
            # What was dropped before others were claimed may return, but not for ever.
            drops.update(identity(candidate) for candidate in dropped)
        return model

    def _without_claims(self) -> FleetModel:
        return FleetModel((), {}, strangers_of(self.fleet, self.null_excess))

    def refitted(self, model: FleetModel) -> FleetModel:
        """Return the model with its strangers and the components of all its effects anew."""
        if not model.claimed:
            return self._without_claims()
        excess = remaining_excess(self.fleet, model)
        model = replace(model, strangers=strangers_of(self.fleet, excess))
        active = model.active()
        sample, part = without_faults(self.fleet, model)
        acting = [claim.term for claim in part.claimed if claim.design.any()]
        found = fitted_components(part.mixed(sample), acting, model.components_of(active))
        return replace(
            model,
            components={
                effect: (float(found.tau[i]), float(found.kappa[i]))
                for i, effect in enumerate(active)
            },
        )

    def best(
        self,
        model: FleetModel,
        refused: set[Identity],
        floor: float = 0.0,
        with_repeats: bool = False,
    ) -> Assessment | None:
        """
        Return the claimable candidate of the most evidence, none of those `refused`.

        `floor`: candidates with less evidence are of no use. `with_repeats`: as in `ranked`.
        """
        best: Assessment | None = None
        least = max(float(ndtri(0.5 * self.rates.largest)) ** 2, floor)
        excess = remaining_excess(self.fleet, model)
        for gain, candidate in self.ranked(model, excess, refused, with_repeats):
            # No candidate has more evidence than its gain: the rest is no better.
            if gain < max(least, 0.0 if best is None else best.evidence):
                break
            found = self.assess(model, candidate)
            if best is not None and found.evidence <= best.evidence:
                continue
            if self.is_claimable(found) and self.explains(model, found, excess):
                best = found
        return best

    def _pair_that_saves(self, model: FleetModel, refused: set[Identity]) -> FleetModel | None:
        """
        Return the model with two further claims that save enough only together.

        More drag and weaker brakes cancel: each of them alone leaves more of the loss than both.
        Not of one car, which seldom has two such faults; two effects imitate one more often.
        """
        excess = remaining_excess(self.fleet, model)
        for both in self.pairs(model, refused, lambda level: not level.car):
            design = np.max([c.design for c in both.claimed[-2:]], axis=0)
            if self.saves_enough(excess, remaining_excess(self.fleet, both), design):
                return both
        return None

    def pairs(
        self,
        model: FleetModel,
        refused: set[Identity],
        is_wanted: Callable[[Level], bool],
        floor: float = 0.0,
        least: tuple[FleetModel, float] | None = None,
    ) -> Iterator[FleetModel]:
        """
        Yield models with two further claims, each of which explains enough next to the other.

        `is_wanted`: of the level of the first. `floor`: least gain of the first. `least`: over
        which model the logarithm of the likelihood of both is to rise, and by how much. The claims
        of `model` stay, so that a selection which adds pairs ends.
        """
        for first in self.strongest(model, refused, is_wanted, floor):
            # Alone, and far from the truth, the first may make claims needless that both leave.
            one = self._with(model, first)
            # Next to the first, which resembles it, the second has little evidence, but much gain:
            # about twice what it raises the likelihood by.
            missing = 0.0 if least is None else least[1] - rise(self.fleet, least[0], one)
            second = self.best(one, refused, missing)
            if second is None:
                continue
            both, dropped = self.with_claim(one, second)
            alone = self._with(model, second)
            if not dropped and self.explains(alone, self.assess(alone, first.candidate)):
                yield both

    def strongest(
        self,
        model: FleetModel,
        refused: set[Identity],
        is_wanted: Callable[[Level], bool],
        floor: float,
    ) -> list[Assessment]:
        """
        Return significant candidates, likeliest first, whether they save enough or not.

        `is_wanted`: of a level. `floor`: least gain. Not by their evidence, which concerns a size
        alone: larger wheels in place of a headwind have more than a rolling resistance, and leave
        a hundred times the loss.
        """
        found: list[Assessment] = []
        for gain, candidate in self.ranked(model, refused=refused):
            if gain < floor or len(found) == _EXAMINED:
                break
            if is_wanted(candidate.level):
                found.append(self.assess(model, candidate))
        usable = [one for one in found if self.is_claimable(one)]
        usable.sort(key=lambda one: -rise(self.fleet, model, extended(model, one)))
        return usable[:_FIRST_OF_PAIR]

    def with_claim(
        self, model: FleetModel, found: Assessment
    ) -> tuple[FleetModel, list[Candidate]]:
        """Return the model with a further claim, all fitted, and claims that it makes needless."""
        return self.without_insignificant(self._with(model, found))

    def _with(self, model: FleetModel, found: Assessment) -> FleetModel:
        return self.refitted(extended(model, self.with_fitted_onset(model, found)))

    def without(self, model: FleetModel, *claims: Candidate) -> FleetModel:
        """Return the model without some of its claims and those allowed beside them, fitted."""
        gone = [*claims, *(one for claim in claims for one in self.dependents(model, claim))]
        left = tuple(c for c in model.claimed if not any(c is one for one in gone))
        return self.refitted(replace(model, claimed=left))

    def with_fitted_onset(self, model: FleetModel, found: Assessment) -> Assessment:
        """
        Return a trend with the change point of the largest likelihood; others as they are.

        Of change points that leave enough recordings with the trend (`levels.is_usable`).
        """
        level = found.candidate.level
        if not is_trend(level):
            return found
        of_car = [not level.car or car == level.car for car in self.fleet.cars]
        days = np.unique(self.fleet.days[of_car])
        quantiles = np.arange(1, _FITTED_ONSETS) / _FITTED_ONSETS
        effect = found.candidate.effect
        # As it will be judged: where the onset is wrong, recordings seem to differ by the trend.
        fitted = self.refitted(extended(model, found))
        mixed, components = fitted.mixed(self.fleet), fitted.components_of(fitted.active())

        def likelihood(candidate: Candidate) -> float:
            return mixed.estimate(model.terms([candidate]), components).likelihood

        def at(day: float) -> Candidate:
            moved = replace(level, onset=float(day))
            return Candidate(effect, moved, moved.design(self.fleet))

        tried = [at(day) for day in (days[0], *np.quantile(days, quantiles))]
        usable = [found.candidate, *(one for one in tried if is_usable(one.level, self.fleet))]
        best = max(usable, key=likelihood)
        if level.kind == RAMP:
            # A large ramp is known to a part of a day: what a wrong one leaves is a second ramp.
            onsets = np.unique([one.level.onset for one in usable])
            i = int(np.searchsorted(onsets, best.level.onset))
            near = float(onsets[max(i - 1, 0)]), float(onsets[min(i + 1, onsets.size - 1)])
            day = minimize_scalar(lambda x: -likelihood(at(x)), bounds=near, method="bounded").x
            best = max((best, at(day)), key=likelihood)
        return found if best is found.candidate else self.assess(model, best)

    def _with_onset_again(self, model: FleetModel, best: Assessment | None) -> FleetModel | None:
        """
        Return the model with the change point of a claimed trend fitted again, if it is better.

        Next to the claims that have come since, by a parameter's penalty; of the trend that would
        be claimed a second time, or of any before the selection ends (`best`: None).
        """
        for claim in model.claimed:
            is_due = best is None or is_repeated_by(claim, *identity(best.candidate))
            if not (is_due and is_trend(claim.level)):
                continue
            rest = self.without(model, claim)
            found = self.with_fitted_onset(rest, self.assess(rest, claim))
            again = self.refitted(extended(rest, found))
            if rise(self.fleet, model, again) > 0.5 * PENALTY_PER_PARAMETER:
                return again
        return None

    def without_insignificant(self, model: FleetModel) -> tuple[FleetModel, list[Candidate]]:
        """Return the model without claims that are not claimable in it, and what was dropped."""
        dropped: list[Candidate] = []
        while model.claimed:
            found = self.assessed(model)
            bad = [one for one in found if not self.is_claimable(one)]
            if not bad:
                break
            worst = max(bad, key=lambda one: one.p_value).candidate
            # What is allowed only beside a claim goes first: it may be why the claim looks bad.
            gone = self.dependents(model, worst) or (worst,)
            dropped += gone
            model = self.without(model, *gone)
        return model, dropped
