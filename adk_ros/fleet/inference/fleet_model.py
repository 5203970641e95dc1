# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The claims of a fleet, and what they imply for each recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.fleet.inference.evidence import Columns
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.levels import SHARED, Level
from adk_ros.fleet.inference.mixed_model import Components, MixedModel, Term
from adk_ros.fleet.inference.variance_components import start_components
from adk_ros.mismatch.library.criteria import MAX_NORMALISED_LOSS, MIN_GAIN_PER_NULL_EXCESS
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.bounded_quadratic import bounded_maxima

_OFFSET_VARIANCE = 2.0
"""Prior variance of a recording's sensor offsets: the car's and its own."""

MIN_SHARED_GAIN = 2.6e-3
"""
Least gain of what acts in all recordings, as a share of what other claims of all recordings
explain in its equations: what an inexact equation of all cars leaves is the same in all of them,
and no chance. Likewise of what acts in one car, next to other claims of it. On development fleets:
second effects that are there save 0.0068 to 0.038 (seeds 41 and 82), absent ones next to a payload
at most 0.001; the geometric mean (doc/fleet-inference.md).
"""
WINDS = frozenset({"headwind", "crosswind"})
"""
Effects that all recordings have by chance only, relative to the car: where something else is
likelier, that is claimed, by whatever little.
"""
_LEAST_CARS = 3
"""Cars without a fault that say how effects differ between cars, least: as `MIN_RECORDINGS`, two
determine no scatter among them and a size."""
_FAR = 3.0
"""Multiple of the middle car's loss from which a car has a fault that others lack. By choice."""


@dataclass(frozen=True)
class Candidate:
    """A parameter of an effect (index of the columns' effects) at a level."""

    effect: int
    level: Level
    design: FloatArray

    @property
    def term(self) -> Term:
        """The candidate as a term of the model."""
        return Term(self.effect, self.design)


@dataclass(frozen=True)
class FleetModel:
    """
    The claimed candidates with the components of their parameters, by index of the effect.

    `strangers`: cars that the claims leave far more of unexplained than the others. They have a
    fault that is not claimed yet, which moves their estimates of other parameters as well, in each
    recording differently. So every active effect is free in each of their recordings: how cars and
    recordings differ is what the others say.
    """

    claimed: tuple[Candidate, ...]
    components: dict[int, tuple[float, float]]
    strangers: tuple[str, ...] = ()

    def terms(self, further: Sequence[Candidate] = ()) -> list[Term]:
        """Return the terms of the claims and of `further` candidates."""
        return [c.term for c in (*self.claimed, *further)]

    def mixed(self, fleet: FleetEvidence, further: Sequence[Candidate] = ()) -> MixedModel:
        """Return the model of deviations in the effects of claims and further candidates."""
        active = self.active([c.effect for c in further])
        taken = {(c.effect, c.level.car) for c in (*self.claimed, *further)}
        free = [
            [car in self.strangers and (effect, car) not in taken for effect in active]
            for car in fleet.cars
        ]
        return MixedModel(fleet, active, np.array(free).reshape(len(fleet.cars), len(active)))

    def active(self, further: Sequence[int] = ()) -> list[int]:
        """Return the columns of all effects with a term, and further ones."""
        return sorted({c.effect for c in self.claimed} | set(further))

    def components_of(self, active: Sequence[int]) -> Components:
        """Return the components of active effects; those that were not fitted at their start."""
        start = start_components(len(active))
        for i, effect in enumerate(active):
            if effect in self.components:
                start.tau[i], start.kappa[i] = self.components[effect]
        return start


def nuisance_prior(columns: Columns) -> FloatArray:
    """Return the prior information (k,) on the nuisance parameters of a recording."""
    prior = np.ones(columns.first_effect)
    prior[columns.offsets] = 1.0 / _OFFSET_VARIANCE
    return prior


def joint_vectors(
    fleet: FleetEvidence, model: FleetModel, with_deviations: bool = True, bounded: bool = False
) -> FloatArray:
    """
    Return the estimated joint vector (r, d) of each recording.

    `with_deviations`: with what the cars deviate in the claimed parameters, beyond the claims.
    `bounded`: with build tolerances and sensor offsets within their bounds. Where they are not,
    tolerances of ten standard deviations may stand for an effect that is not claimed.
    """
    c = fleet.columns
    out = np.zeros((len(fleet.names), c.size))
    active = model.active()
    if active:
        mixed = model.mixed(fleet)
        estimate = mixed.estimate(model.terms(), model.components_of(active))
        for size, candidate in zip(estimate.sizes, model.claimed, strict=True):
            out[:, c.first_effect + candidate.effect] += size * candidate.design
        of_car = np.array([fleet.car_names.index(car) for car in fleet.cars])
        acting = mixed.acting(model.terms())
        for i, effect in enumerate(active if with_deviations else ()):
            deviations = estimate.car_deviations[of_car, i] * acting[:, i]
            out[:, c.first_effect + effect] += deviations
    k = c.first_effect
    right = fleet.scores[:, :k] - np.einsum(
        "rij,rj->ri", fleet.informations[:, :k, k:], out[:, k:]
    )
    left = fleet.informations[:, :k, :k] + np.diag(nuisance_prior(c))
    if bounded:
        out[:, :k] = bounded_maxima(left, right, c.nuisance_bounds)
    else:
        out[:, :k] = np.linalg.solve(left, right[:, :, None])[:, :, 0]
    return out


def remaining_excess(fleet: FleetEvidence, model: FleetModel) -> FloatArray:
    """
    Return the loss (r,) above that of a perfect model that the claims leave; noise may lower it.

    Deviations of the cars count as unexplained: until it is claimed, what all cars share is one.
    So do tolerances beyond their bounds, for the same reason.
    """
    x = joint_vectors(fleet, model, with_deviations=False, bounded=True)
    quadratic = np.einsum("ri,rij,rj->r", x, fleet.informations, x)
    gain = 2.0 * (fleet.scores * x).sum(axis=1) - quadratic
    return np.asarray(fleet.excess - gain)


def share_equation(fleet: FleetEvidence, a: Candidate, b: Candidate) -> bool:
    """Whether two effects act in one equation: drag leaves nothing to a yaw inertia."""
    equations = [
        set(fleet.columns.column(fleet.columns.effects[c.effect]).effect.equations) for c in (a, b)
    ]
    return bool(equations[0] & equations[1])


def is_steady_wind(fleet: FleetEvidence, claim: Candidate) -> bool:
    """Whether a claim is a wind that all recordings have from one side of the car."""
    effect = fleet.columns.column(fleet.columns.effects[claim.effect]).effect.name
    return claim.level.kind == SHARED and effect in WINDS


def without_faults(fleet: FleetEvidence, model: FleetModel) -> tuple[FleetEvidence, FleetModel]:
    """
    Return the cars of which nothing is claimed, and the model of these, where there are some.

    A fault leaves little of itself, but the more the larger it is, and other effects would seem to
    differ between the recordings of its car by that.
    """
    kept = fault_free(fleet, model)
    if kept.all():
        return fleet, model
    rows = [int(i) for i in np.flatnonzero(kept)]
    claimed = tuple(replace(c, design=c.design[rows]) for c in model.claimed)
    return fleet.kept(rows), replace(model, claimed=claimed)


def fault_free(fleet: FleetEvidence, model: FleetModel) -> BoolArray:
    """Return the recordings (r,) of cars of which nothing is claimed; all, if these are few."""
    faulty = {claim.level.car for claim in model.claimed} | set(model.strangers)
    kept = np.array([car not in faulty for car in fleet.cars])
    cars = {car for car, is_kept in zip(fleet.cars, kept, strict=True) if is_kept}
    return kept if len(cars) >= _LEAST_CARS else np.ones_like(kept)


def explained_by(
    fleet: FleetEvidence, model: FleetModel, claims: Sequence[Candidate]
) -> FloatArray:
    """Return the loss (r,) that some claims of a model explain next to the others."""
    left = tuple(c for c in model.claimed if not any(c is one for one in claims))
    without = remaining_excess(fleet, replace(model, claimed=left))
    return np.maximum(without - remaining_excess(fleet, model), 0.0)


def inexactness(
    fleet: FleetEvidence, model: FleetModel, claim: Candidate, others: Sequence[Candidate] = ()
) -> float:
    """
    Return the loss that may remain because the equation of a claim of all cars is not exact.

    A share of what the claim explains in `model`: `criteria.MIN_GAIN_PER_NULL_EXCESS`, or, if it
    is one of `others`, `MIN_SHARED_GAIN`, as when the other of them was selected. Zero for a claim
    at another level, for a steady wind, and if any of `others` acts in other equations. What
    remains is the same in all recordings, so that more of them do not make it chance.
    """
    is_exact = claim.level.kind != SHARED or is_steady_wind(fleet, claim)
    if is_exact or not all(share_equation(fleet, claim, c) for c in others):
        return 0.0
    is_one_of_them = any(claim.effect == c.effect for c in others)
    share = MIN_SHARED_GAIN if is_one_of_them else MIN_GAIN_PER_NULL_EXCESS
    return share * float(explained_by(fleet, model, [claim]).sum())


def likelihood(fleet: FleetEvidence, model: FleetModel) -> float:
    """Return the logarithm of the likelihood of a model with its components."""
    components = model.components_of(model.active())
    return model.mixed(fleet).estimate(model.terms(), components).likelihood


def rise(fleet: FleetEvidence, model: FleetModel, other: FleetModel) -> float:
    """
    Return by how much the logarithm of the likelihood of `other` exceeds that of `model`.

    In the recordings of strangers, of those of both models, the effects of both are free for both:
    else the one would be likelier whose effects happen to fit a fault that is not claimed.
    """
    if not (model.strangers or other.strangers):
        return likelihood(fleet, other) - likelihood(fleet, model)
    claims = (*model.claimed, *other.claimed)
    active = sorted({c.effect for c in claims})
    taken = {(c.effect, c.level.car) for c in claims}
    strangers = set(model.strangers) & set(other.strangers)
    free = [
        [car in strangers and (effect, car) not in taken for effect in active]
        for car in fleet.cars
    ]
    mixed = MixedModel(fleet, active, np.array(free).reshape(len(fleet.cars), len(active)))

    def reached(one: FleetModel) -> float:
        components = one.components_of(active)
        # What is not claimed is not there, but in strangers.
        absent = [effect not in one.active() for effect in active]
        components.tau[absent] = components.kappa[absent] = 0.0
        return mixed.estimate(one.terms(), components).likelihood

    return reached(other) - reached(model)


def strangers_of(fleet: FleetEvidence, excess: FloatArray) -> tuple[str, ...]:
    """
    Return the cars whose recordings the claims explain far worse than those of the others.

    `excess` (r,): of `remaining_excess`. "Far worse" is a loss that allows no claim in one
    recording, and three times that of the car in the middle: where all are explained badly, it is
    no fault of theirs. More than half of the cars remain.
    """
    ratio = 1.0 + excess / np.maximum(fleet.expected_loss, 1.0)
    cars = np.array(fleet.cars)
    left = {car: float(np.median(ratio[cars == car])) for car in fleet.car_names}
    least = max(MAX_NORMALISED_LOSS, _FAR * float(np.median(list(left.values()))))
    worst = sorted(left, key=lambda car: -left[car])[: (len(left) - 1) // 2]
    return tuple(sorted(car for car in worst if left[car] > least))
