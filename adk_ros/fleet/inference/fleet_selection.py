# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Forward selection of effects and levels over a fleet.

Each step examines every parameter of every effect at every level:

1. The gain of each candidate without variance components bounds its
   evidence from above; all levels of a parameter come from one linear problem.
2. In the order of these gains, each candidate is fitted with its variance components. Its evidence
   is t^2 with the variance of the model; its significance is Student's t with the total variance
   (`variance_components.total_variance`) and its degrees of freedom.
3. Of the significant candidates that of the largest evidence is added.

Afterwards all components are fitted again, and terms that are no longer significant are dropped.

Significant is what chance exceeds in `criteria.FAMILYWISE_ERROR_RATE` of fleets anywhere among the
examined parameters and levels (Bonferroni), places included. Scatter between recordings or cars
raises the variance of a size and lowers its degrees of freedom, so that it is no evidence for a
mean. A car's deviation must also exceed the materiality threshold: below, it is build tolerance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from adk_ros.fleet.inference.assessment import Assessment, assessment_of, extended
from adk_ros.fleet.inference.evidence import column_of
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel, remaining_excess
from adk_ros.fleet.inference.levels import BOUND_DEVIATIONS, Level, is_trend, levels_of
from adk_ros.fleet.inference.mixed_model import MixedModel, Term
from adk_ros.fleet.inference.variance_components import fitted_components
from adk_ros.mismatch.library.criteria import (
    FAMILYWISE_ERROR_RATE,
    MIN_GAIN_PER_EXCESS,
)
from adk_ros.numerics.arrays import FloatArray

_FITTED_ONSETS = 40
"""Change points among which that of a claimed trend is chosen, over its recordings. By choice."""
MAX_TERMS = 30
"""Most terms of a selection: far more than a fleet lacks; bounds the time. By choice."""
_LEVELS_PER_PARAMETER = 3
"""Levels of a parameter that are fitted in full in one step, those of the largest gains."""
_PER_STEP = 24
"""Candidates that are fitted in full in one step. By choice; they come in the order of gains."""
_MIN_GAIN_PER_NULL_EXCESS = 5e-4
"""
Least gain, as a share of the excess loss before any claim. Lower than that of one recording
(`criteria.MIN_GAIN_PER_NULL_EXCESS`): a fleet has weak effects of single cars next to strong ones
of all. On development fleets (doc/fleet-inference.md).
"""
_MOST_DROPS = 2
"""Times that a claim may be dropped until it is no candidate any more; ends the selection."""
_LARGE_DEVIATION, _REFITTED = 0.5, 2
"""Deviation between cars, in materiality thresholds, that is fitted again with a candidate, and
how many parameters at most. By choice."""

Progress = Callable[[float, str], None]


class Selection:
    """
    Selection over a fleet; `further_tests`: tests of others that share the error rate (places).

    `levels` are those that the recordings tell apart.
    """

    def __init__(
        self, fleet: FleetEvidence, further_tests: int = 0, progress: Progress | None = None
    ) -> None:
        self.fleet = fleet
        self.levels = levels_of(fleet)
        self.designs = np.array([level.design(fleet) for level in self.levels])
        informative = np.einsum("rii->i", fleet.informations)[fleet.columns.first_effect :]
        self.observable = [int(i) for i in np.flatnonzero(informative > 0.0)]
        self.tests = max(len(self.observable) * len(self.levels) + further_tests, 1)
        self.null_excess = np.maximum(remaining_excess(fleet, FleetModel((), {})), 0.0)
        """(r,) loss above that of a perfect model without any claim."""
        self._progress = progress or (lambda done, text: None)

    @property
    def significance(self) -> float:
        """Largest p-value of a significant candidate."""
        return FAMILYWISE_ERROR_RATE / self.tests

    def select(self, start: FleetModel | None = None) -> FleetModel:
        """Return the claimed terms of the fleet, fitted; `start`: those claimed already."""
        model = start or FleetModel((), {})
        drops: Counter[tuple[int, Level]] = Counter()
        while len(model.claimed) < MAX_TERMS:
            self._progress(len(model.claimed) / MAX_TERMS, "selecting effects and levels")
            best = self._best(model, {one for one, times in drops.items() if times >= _MOST_DROPS})
            if best is None:
                break
            best = self.with_fitted_onset(model, best)
            larger, dropped = self._without_insignificant(self.refitted(extended(model, best)))
            if any(candidate is best.candidate for candidate in dropped):
                # With all components fitted it is none: what went with it was right without it.
                drops[_identity(best.candidate)] = _MOST_DROPS
                continue
            model = larger
            # What was dropped before others were claimed may return, but not for ever.
            drops.update(_identity(candidate) for candidate in dropped)
        return model

    def refitted(self, model: FleetModel) -> FleetModel:
        """Return the model with the components of all its effects fitted again."""
        if not model.claimed:
            return FleetModel((), {})
        active = model.active()
        mixed = MixedModel(self.fleet, active)
        terms = [c.term for c in model.claimed]
        found = fitted_components(mixed, terms, model.components_of(active))
        return replace(
            model,
            components={
                effect: (float(found.tau[i]), float(found.kappa[i]))
                for i, effect in enumerate(active)
            },
        )

    def assessed(self, model: FleetModel) -> list[Assessment]:
        """Return the assessment of each claimed term."""
        active = model.active()
        if not active:
            return []
        mixed = MixedModel(self.fleet, active)
        terms = [c.term for c in model.claimed]
        components = model.components_of(active)
        estimate = mixed.estimate(terms, components, with_bias=True)
        return [
            assessment_of(candidate, m, estimate, mixed, terms, components)
            for m, candidate in enumerate(model.claimed)
        ]

    def assess(self, model: FleetModel, candidate: Candidate) -> Assessment:
        """
        Return the assessment of a further candidate, with its components fitted.

        Claimed parameters that differ much between cars may contain what all cars share of a
        similar effect, until that is claimed: their components are fitted again as well.
        """
        active = model.active([candidate.effect])
        mixed = MixedModel(self.fleet, active)
        terms = [*(c.term for c in model.claimed), candidate.term]
        start = model.components_of(active)
        which = [active.index(candidate.effect)]
        for i in np.argsort(-start.kappa)[:_REFITTED]:
            if start.kappa[i] > _LARGE_DEVIATION and i not in which:
                which.append(int(i))
        found = fitted_components(mixed, terms, start, which)
        estimate = mixed.estimate(terms, found, with_bias=True)
        return assessment_of(candidate, len(terms) - 1, estimate, mixed, terms, found)

    def gains(self, model: FleetModel, effect: int) -> FloatArray:
        """
        Return the evidence (levels,) of a parameter at each level without its variance components.

        Without them also where it is claimed already: deviations between cars contain what all
        cars share until that is claimed. Claimed levels have none left.
        """
        active = model.active([effect])
        mixed = MixedModel(self.fleet, active)
        components = model.components_of(active)
        components.tau[active.index(effect)] = 0.0
        components.kappa[active.index(effect)] = 0.0
        claimed = [c.term for c in model.claimed]
        terms = [*claimed, *(Term(effect, z) for z in self.designs)]
        estimate = mixed.estimate(terms, components)
        k = len(claimed)
        h, g = estimate.information, estimate.score
        solved = np.linalg.solve(h[:k, :k], np.column_stack([h[:k, k:], g[:k]]))
        left = np.diag(h)[k:] - (h[k:, :k] * solved[:, :-1].T).sum(axis=1)
        right = g[k:] - h[k:, :k] @ solved[:, -1]
        usable = left > 1e-6 * np.maximum(np.diag(h)[k:], 1e-12)
        return np.asarray(np.where(usable, right**2 / np.where(usable, left, 1.0), 0.0))

    def ranked(self, model: FleetModel) -> list[tuple[float, Candidate]]:
        """Return the candidates of the largest gains of each parameter, largest first."""
        out = []
        for effect in self.observable:
            gains = self.gains(model, effect)
            for i in np.argsort(-gains)[:_LEVELS_PER_PARAMETER]:
                candidate = Candidate(effect, self.levels[i], self.designs[i])
                out.append((float(gains[i]), candidate))
        return sorted(out, key=lambda pair: -pair[0])

    def _best(self, model: FleetModel, refused: set[tuple[int, Level]]) -> Assessment | None:
        best: Assessment | None = None
        least = float(ndtri(0.5 * self.significance)) ** 2
        excess = remaining_excess(self.fleet, model)
        for gain, candidate in self.ranked(model)[:_PER_STEP]:
            # No candidate has more evidence than its gain: the rest is no better.
            if gain < max(least, 0.0 if best is None else best.evidence):
                break
            if _identity(candidate) in refused:
                continue
            found = self.assess(model, candidate)
            if best is not None and found.evidence <= best.evidence:
                continue
            if self.is_claimable(found) and self.explains(model, found, excess):
                best = found
        return best

    def with_fitted_onset(self, model: FleetModel, found: Assessment) -> Assessment:
        """Return a trend with the change point of the largest likelihood; others as they are."""
        level = found.candidate.level
        if not is_trend(level):
            return found
        of_car = [not level.car or car == level.car for car in self.fleet.cars]
        days = np.unique(self.fleet.days[of_car])
        quantiles = np.arange(1, _FITTED_ONSETS) / _FITTED_ONSETS
        effect = found.candidate.effect
        active = model.active([effect])
        mixed = MixedModel(self.fleet, active)
        components = model.components_of(active)
        i = active.index(effect)
        components.tau[i], components.kappa[i] = found.components
        claimed = [c.term for c in model.claimed]

        def likelihood(candidate: Candidate) -> float:
            return mixed.estimate([*claimed, candidate.term], components).likelihood

        candidates = [found.candidate]
        for day in (days[0], *np.quantile(days, quantiles)):
            moved = replace(level, onset=float(day))
            candidates.append(Candidate(effect, moved, moved.design(self.fleet)))
        best = max(candidates, key=likelihood)
        return found if best is found.candidate else self.assess(model, best)

    def is_claimable(self, found: Assessment) -> bool:
        """Whether a candidate is significant, material, and possible."""
        return (
            found.p_value < self.significance and found.is_material() and self.is_possible(found)
        )

    def explains(self, model: FleetModel, found: Assessment, excess: FloatArray) -> bool:
        """
        Whether a candidate saves enough of the loss where it acts to be no accident.

        Enough is a share of what is unexplained, and one of what was unexplained before any
        claim, of which every equation leaves a part.

        `excess` (r,): the loss above that of a perfect model that the claims of `model` leave.
        """
        acts = found.candidate.design > 0.0
        left = remaining_excess(self.fleet, extended(model, found))
        # The median: a few recordings with much else to explain do not hide what all show.
        required = MIN_GAIN_PER_EXCESS * np.maximum(excess, 0.0)
        required += _MIN_GAIN_PER_NULL_EXCESS * self.null_excess
        return float(np.median((excess - left - required)[acts])) >= 0.0

    def is_possible(self, found: Assessment) -> bool:
        """Whether the parameter stays within its bounds in all recordings; a delay is positive."""
        column = column_of(self.fleet.columns.effects[found.candidate.effect])
        p = column.parameter
        low, high = ((b - p.theta_neutral) / column.materiality for b in p.bounds())
        slack = BOUND_DEVIATIONS * found.deviation
        return found.extremes[0] >= low - slack and found.extremes[1] <= high + slack

    def _without_insignificant(self, model: FleetModel) -> tuple[FleetModel, list[Candidate]]:
        dropped: list[Candidate] = []
        while model.claimed:
            found = self.assessed(model)
            bad = [one for one in found if not self.is_claimable(one)]
            if not bad:
                break
            worst = max(bad, key=lambda one: one.p_value)
            dropped.append(worst.candidate)
            model = self.refitted(
                replace(model, claimed=tuple(c for c in model.claimed if c is not worst.candidate))
            )
        return model, dropped


def _identity(candidate: Candidate) -> tuple[int, Level]:
    """Return what a candidate is about; change points, which are fitted, count as one."""
    return candidate.effect, replace(candidate.level, onset=0.0)
