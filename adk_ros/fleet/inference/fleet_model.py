# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The claims of a fleet, and what they imply for each recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.levels import Level
from adk_ros.fleet.inference.mixed_model import Components, MixedModel, Term
from adk_ros.fleet.inference.variance_components import start_components
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.bounded_quadratic import bounded_maxima

_OFFSET_VARIANCE = 2.0
"""Prior variance of a recording's sensor offsets: the car's and its own."""


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
    """The claimed candidates with the components of their parameters, by index of the effect."""

    claimed: tuple[Candidate, ...]
    components: dict[int, tuple[float, float]]

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
        mixed = MixedModel(fleet, active)
        estimate = mixed.estimate([x.term for x in model.claimed], model.components_of(active))
        for size, candidate in zip(estimate.sizes, model.claimed, strict=True):
            out[:, c.first_effect + candidate.effect] += size * candidate.design
        of_car = np.array([fleet.car_names.index(car) for car in fleet.cars])
        for i, effect in enumerate(active if with_deviations else ()):
            out[:, c.first_effect + effect] += estimate.car_deviations[of_car, i]
    k = c.first_effect
    prior = np.ones(k)
    prior[c.offsets] = 1.0 / _OFFSET_VARIANCE
    right = fleet.scores[:, :k] - np.einsum(
        "rij,rj->ri", fleet.informations[:, :k, k:], out[:, k:]
    )
    left = fleet.informations[:, :k, :k] + np.diag(prior)
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
