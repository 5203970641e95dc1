# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Candidates of a selection over a fleet: which there are, and how each is judged next to claims.

Significant is what chance exceeds in `criteria.FAMILYWISE_ERROR_RATE` of fleets anywhere among the
examined parameters, levels and places (`error_rates`). Scatter between recordings or cars
raises the variance of a size and lowers its degrees of freedom, so that it is no evidence for a
mean. A size must also exceed build tolerance: the materiality threshold, and for an effect of all
cars what tolerances leave in their mean, which is smaller by the square root of their number.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from adk_ros.fleet.inference.assessment import Assessment, assessment_of, extended
from adk_ros.fleet.inference.error_rates import ErrorRates, question_of
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import (
    MIN_SHARED_GAIN,
    Candidate,
    FleetModel,
    explained_by,
    fault_free,
    remaining_excess,
    share_equation,
    without_faults,
)
from adk_ros.fleet.inference.further_terms import evidence_of_designs
from adk_ros.fleet.inference.levels import (
    BOUND_DEVIATIONS,
    CAR,
    SHARED,
    Level,
    distinct,
    is_trend,
    usable_levels,
)
from adk_ros.fleet.inference.linearisation_point import MOVED
from adk_ros.fleet.inference.saved_loss import SavedLoss, best_half
from adk_ros.fleet.inference.variance_components import fitted_components
from adk_ros.mismatch.library.criteria import MIN_GAIN_PER_EXCESS
from adk_ros.numerics.arrays import FloatArray

_LEVELS_PER_PARAMETER = 3
"""Levels of a parameter that are fitted in full in one step, those of the largest gains; and the
likeliest of each question (`error_rates`), of which a fault of one car would take the place."""
_LEAST_SAVED = 0.5
"""Share of the required saving that the approximate one must reach. By choice."""
MIN_GAIN_PER_NULL_EXCESS = 5e-4
"""
Least gain, as a share of the excess loss before any claim. Lower than that of one recording
(`criteria.MIN_GAIN_PER_NULL_EXCESS`): a fleet has weak effects of single cars next to strong ones
of all. On development fleets (doc/fleet-inference.md).
"""
_LARGE_DEVIATION, _REFITTED = 0.5, 2
"""Deviation between cars, in materiality thresholds, that is fitted again with a candidate, and
how many parameters at most. By choice."""

Progress = Callable[[float, str], None]
Identity = tuple[int, Level]
"""What a candidate is about: effect and level, without a change point."""


class Candidates:
    """
    Candidates of a fleet; `further_tests`: tests at places, which share the rate of false alarms.

    `levels` are those that the recordings tell apart, of `every_level`. `refused`: candidates that
    are not examined. `beside`: candidate -> a better one of the same recordings, next to which
    alone it is examined (`effect_comparisons`).
    """

    def __init__(
        self,
        fleet: FleetEvidence,
        further_tests: int = 0,
        progress: Progress | None = None,
        refused: frozenset[Identity] = frozenset(),
        beside: Mapping[Identity, Identity] | None = None,
    ) -> None:
        self.fleet = fleet
        self.every_level = usable_levels(fleet)
        self.levels = distinct(self.every_level, fleet)
        self.designs = np.array([level.design(fleet) for level in self.levels])
        self._without_onset = [level.without_onset for level in self.levels]
        informative = np.einsum("rii->i", fleet.informations)[fleet.columns.first_effect :]
        self.observable = [int(i) for i in np.flatnonzero(informative > 0.0)]
        self.rates = ErrorRates.of(self.levels, len(self.observable), further_tests)
        self.null_excess = np.maximum(remaining_excess(fleet, FleetModel((), {})), 0.0)
        """(r,) loss above that of a perfect model without any claim."""
        self.refused = refused
        self.beside = dict(beside or {})
        self.progress = progress or (lambda done, text: None)

    def is_allowed(self, model: FleetModel, known: Identity) -> bool:
        """Whether a candidate may be claimed next to the claims of a model, refused ones not."""
        better = self.beside.get(known)
        is_beside = better is None or any(identity(claim) == better for claim in model.claimed)
        return is_beside and known not in self.refused

    @staticmethod
    def repeats(model: FleetModel, effect: int, level: Level) -> bool:
        """
        Whether a level is a change in time of what is claimed to change already.

        A second trend of an effect in the same cars is what the shape of the first leaves.
        """
        return any(is_repeated_by(claim, effect, level) for claim in model.claimed)

    def dependents(self, model: FleetModel, claim: Candidate) -> tuple[Candidate, ...]:
        """Return the claims of a model that are allowed only next to one of them."""
        better = identity(claim)
        return tuple(c for c in model.claimed if self.beside.get(identity(c)) == better)

    def assessed(self, model: FleetModel) -> list[Assessment]:
        """Return the assessment of each claimed term."""
        active = model.active()
        if not active:
            return []
        mixed = model.mixed(self.fleet)
        terms = model.terms()
        components = model.components_of(active)
        estimate = mixed.estimate(terms, components, with_bias=True)
        # The components are those of `Selection.refitted`.
        sample = fault_free(self.fleet, model)
        return [
            assessment_of(candidate, m, estimate, mixed, terms, components, sample)
            for m, candidate in enumerate(model.claimed)
        ]

    def assess(self, model: FleetModel, candidate: Candidate) -> Assessment:
        """
        Return the assessment of a further candidate, with its components fitted.

        Claimed parameters that differ much between cars may contain what all cars share of a
        similar effect, until that is claimed: their components are fitted again as well. Of what
        all cars share, those of which something else is claimed say nothing on how the others
        differ, as in a claim. At other levels, of fewer recordings, they do: what a fault leaves
        in some of them resembles a trend.
        """
        active = model.active([candidate.effect])
        mixed = model.mixed(self.fleet, [candidate])
        terms = model.terms([candidate])
        start = model.components_of(active)
        which = [active.index(candidate.effect)]
        for i in np.argsort(-start.kappa)[:_REFITTED]:
            if start.kappa[i] > _LARGE_DEVIATION and i not in which:
                which.append(int(i))
        counted = None
        if candidate.level.kind == SHARED:
            both = replace(model, claimed=(*model.claimed, candidate))
            counted = fault_free(self.fleet, both)
            sample, part = without_faults(self.fleet, both)
            acting = [claim.term for claim in part.claimed if claim.design.any()]
            found = fitted_components(part.mixed(sample), acting, start, which)
        else:
            found = fitted_components(mixed, terms, start, which)
        estimate = mixed.estimate(terms, found, with_bias=True)
        m = len(model.claimed)
        return assessment_of(candidate, m, estimate, mixed, terms, found, counted)

    def gains(self, model: FleetModel, effect: int) -> FloatArray:
        """
        Return the evidence (levels,) of a parameter at each level without its variance components.

        Without them also where it is claimed already: deviations between cars contain what all
        cars share until that is claimed. Claimed levels have none left.
        """
        active = model.active([effect])
        components = model.components_of(active)
        # A stranger's size of this effect is among the levels: it is not free there.
        levels = (Level(SHARED), *(Level(CAR, car=car) for car in model.strangers))
        examined = [Candidate(effect, level, level.design(self.fleet)) for level in levels]
        mixed = model.mixed(self.fleet, examined)
        profile = mixed.profile(model.terms(), components, active.index(effect), of_term=True)
        return evidence_of_designs(profile, self.examined_designs(model))

    def examined_designs(self, model: FleetModel) -> FloatArray:
        """
        Return the designs (levels, r) of the recordings that say something about each level.

        About levels of several cars strangers say nothing, as when these are assessed.
        """
        if not model.strangers:
            return self.designs
        strange = np.array([car in model.strangers for car in self.fleet.cars])
        of_several = np.array([not level.car for level in self.levels])
        return np.where(of_several[:, None] & strange, 0.0, self.designs)

    def ranked(
        self,
        model: FleetModel,
        excess: FloatArray | None = None,
        refused: Collection[Identity] = (),
        with_repeats: bool = False,
    ) -> list[tuple[float, Candidate]]:
        """
        Return the candidates of the largest gains of each parameter, largest first.

        `excess` (r,): of the model; then only those that save about enough of it. `refused`: what
        is left out. `with_repeats`: also second trends, see `repeats`.
        """
        out = []
        required = None if excess is None else self.required(excess)
        saved = None
        if required is not None:
            saved = SavedLoss.of(self.fleet, model, self.designs, required)
        for effect in self.observable:
            which = np.ones(len(self.levels), dtype=bool)
            if saved is not None and required is not None:
                which = saved.exceeds(effect, _LEAST_SAVED * required)
            if not which.any():
                continue
            gains = np.where(which, self.gains(model, effect), -1.0)
            out += [
                (float(gains[i]), Candidate(effect, self.levels[i], self.designs[i]))
                for i in self._largest(model, effect, gains, refused, with_repeats)
                if which[i]
            ]
        return sorted(out, key=lambda pair: -pair[0])

    def _largest(
        self,
        model: FleetModel,
        effect: int,
        gains: FloatArray,
        refused: Collection[Identity],
        with_repeats: bool,
    ) -> list[int]:
        """
        Return the allowed levels of the largest gains (levels,), and the largest of each question.

        Of each trend one change point.
        """
        found: dict[Level, int] = {}
        for i in np.argsort(-gains):
            level = self._without_onset[i]
            known = effect, level
            if level in found or known in refused or not self.is_allowed(model, known):
                continue
            if with_repeats or not self.repeats(model, effect, level):
                found[level] = int(i)
        questions = {question_of(level): i for level, i in reversed(found.items())}
        largest = list(found.values())[:_LEVELS_PER_PARAMETER]
        return list(dict.fromkeys([*largest, *questions.values()]))

    def is_claimable(self, found: Assessment) -> bool:
        """Whether a candidate is significant, material, and possible."""
        return self.is_significant(found) and self.is_material(found) and self.is_possible(found)

    def is_significant(self, found: Assessment) -> bool:
        """Whether chance exceeds a size in few fleets anywhere among the examined ones."""
        return found.p_value < self.rates.of_level(found.candidate.level)

    def is_material(self, found: Assessment) -> bool:
        """Whether a size is more than build tolerance, of one car or of the mean of all."""
        return abs(found.size) >= self.tolerance(found.candidate)

    def tolerance(self, candidate: Candidate) -> float:
        """
        Return the size that build tolerance may have, in materiality thresholds.

        No smaller than what an effect may move without a further linearisation.
        """
        if candidate.level.kind != SHARED:
            return 1.0
        return float(max(self.fleet.effective_cars(candidate.effect) ** -0.5, MOVED))

    def explains(
        self, model: FleetModel, found: Assessment, excess: FloatArray | None = None
    ) -> bool:
        """
        Whether a candidate saves enough of the loss where it acts to be no accident.

        Enough is a share of what is unexplained, and one of what was unexplained before any
        claim, of which every equation leaves a part; together in the half of the recordings of
        which that is least. What acts in all recordings must also save `MIN_SHARED_GAIN`, and so
        must what acts in a car of which a similar effect is claimed: an inexact equation leaves
        the same in all recordings in which it acts.

        `excess` (r,): of `remaining_excess` of the model, if it is known.
        """
        if excess is None:
            excess = remaining_excess(self.fleet, model)
        candidate = found.candidate
        left = remaining_excess(self.fleet, extended(model, found))
        if not self.saves_enough(excess, left, candidate.design):
            return False
        similar = [
            claim
            for claim in model.claimed
            if _are_of_same_cars(claim.level, candidate.level)
            and share_equation(self.fleet, claim, candidate)
        ]
        if not similar:
            return True
        counted = best_half(self.required(excess), candidate.design)
        explained = explained_by(self.fleet, model, similar)[counted].sum()
        return float((excess - left)[counted].sum()) >= MIN_SHARED_GAIN * float(explained)

    def saves_enough(self, excess: FloatArray, left: FloatArray, design: FloatArray) -> bool:
        """Whether the loss falls enough where a design acts, from `excess` to `left` (r,)."""
        required = self.required(excess)
        counted = best_half(required, design)
        return float((excess - left - required)[counted].sum()) >= 0.0

    def required(self, excess: FloatArray) -> FloatArray:
        """Return the loss (r,) that a candidate must save in each recording."""
        required = MIN_GAIN_PER_EXCESS * np.maximum(excess, 0.0)
        return np.asarray(required + MIN_GAIN_PER_NULL_EXCESS * self.null_excess)

    def is_possible(self, found: Assessment) -> bool:
        """Whether the parameter stays within its bounds in all recordings; a delay is positive."""
        columns = self.fleet.columns
        low, high = columns.column(columns.effects[found.candidate.effect]).bounds
        slack = BOUND_DEVIATIONS * found.deviation
        return found.extremes[0] >= low - slack and found.extremes[1] <= high + slack


def _are_of_same_cars(a: Level, b: Level) -> bool:
    """Whether two levels are those of all recordings, or of one car."""
    return a.car == b.car if a.car else a.kind == b.kind == SHARED


def of_effects(
    ranked: Iterable[tuple[float, Candidate]], most: int, is_wanted: Callable[[Candidate], bool]
) -> list[Candidate]:
    """
    Return the wanted candidates, in their order, of the first few effects of which one is wanted.

    Not the first few candidates: a fault of one car has three levels that are about it.
    """
    out: list[Candidate] = []
    effects: set[int] = set()
    for _, candidate in ranked:
        if is_wanted(candidate) and (candidate.effect in effects or len(effects) < most):
            effects.add(candidate.effect)
            out.append(candidate)
    return out


def is_repeated_by(claim: Candidate, effect: int, level: Level) -> bool:
    """Whether a level is a change in time of the effect and the cars of a claimed one."""
    both = is_trend(level) and is_trend(claim.level)
    return both and (claim.effect, claim.level.car) == (effect, level.car)


def identity(candidate: Candidate) -> Identity:
    """Return what a candidate is about; change points, which are fitted, count as one."""
    return candidate.effect, candidate.level.without_onset
