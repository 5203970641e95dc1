# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What each effect at each level would save of the loss of every recording, approximately.

The claims of a fleet leave each recording a gradient and a curvature of its loss by each effect.
Build tolerances and sensor offsets follow the effect where they are free, and stay where they are
at a bound, so that the saving is at most underestimated at a given size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import FleetModel, joint_vectors, nuisance_prior
from adk_ros.numerics.arrays import BoolArray, FloatArray

_AT_BOUND = 0.999
"""Share of a bound from which a nuisance parameter counts as held by it."""


@dataclass(frozen=True)
class SavedLoss:
    """Gradient and curvature (r, e) of the log-likelihood of each recording by each effect."""

    gradient: FloatArray
    curvature: FloatArray

    @classmethod
    def of(cls, fleet: FleetEvidence, model: FleetModel) -> SavedLoss:
        """Return those that the claims of `model` leave, as `remaining_excess` counts them."""
        k = fleet.columns.first_effect
        x = joint_vectors(fleet, model, with_deviations=False, bounded=True)
        gradient = fleet.scores - np.einsum("rij,rj->ri", fleet.informations, x)
        free = np.abs(x[:, :k]) < _AT_BOUND * fleet.columns.nuisance_bounds
        across = fleet.informations[:, :k, k:] * free[:, :, None]
        inner = fleet.informations[:, :k, :k] + np.diag(nuisance_prior(fleet.columns))
        both = free[:, :, None] & free[:, None, :]
        inner = np.where(both, inner, np.eye(k))
        followed = np.einsum("rie,rie->re", across, np.linalg.solve(inner, across))
        own = np.einsum("rii->ri", fleet.informations)[:, k:]
        return cls(gradient[:, k:], np.maximum(own - followed, 0.0))

    def exceeds(
        self, effect: int, designs: FloatArray, required: FloatArray, excess: FloatArray
    ) -> BoolArray:
        """
        Whether an effect at each level (levels, r) saves what is required (r,), by `best_half`.

        At the size that saves most in all recordings. `excess` (r,): the loss that is left.
        """
        g, h = self.gradient[:, effect], self.curvature[:, effect]
        curvature = (designs**2) @ h
        size = (designs @ g) / np.where(curvature > 0.0, curvature, np.inf)
        moved = size[:, None] * designs
        left = 2.0 * moved * g - moved**2 * h - required
        counted = np.array([best_half(excess, design) for design in designs])
        return np.asarray((left * counted).sum(axis=1) >= 0.0)


def best_half(excess: FloatArray, design: FloatArray) -> BoolArray:
    """
    Return which recordings (r,) say whether an effect saves enough of their loss.

    Of those in which it acts, the half with the least excess loss (r,): where much else is
    unexplained, nothing can be said.
    """
    acts = design > 0.0
    return np.asarray(acts & (excess <= np.median(excess[acts])))
