# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What each effect at each level would save of the loss of every recording, approximately.

The claims of a fleet leave each recording a gradient and a curvature of its loss by each effect.
Build tolerances and sensor offsets follow the effect where they are free, and stay where they are
at a bound, so that the saving is at most underestimated at a given size. The sizes of the claims
stay as they are, or follow as well: next to a claim that stands for both, an effect saves nothing
until the claim becomes smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.fleet.inference.fleet_evidence import FleetEvidence
from adk_ros.fleet.inference.fleet_model import FleetModel, joint_vectors, nuisance_prior
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

_AT_BOUND = 0.999
"""Share of a bound from which a nuisance parameter counts as held by it."""
_DETERMINED = 1e-6
"""Share of its information that an effect keeps next to the claims, or it is one of them."""


@dataclass(frozen=True)
class SavedLoss:
    """
    Gradient (r, e) and curvature (r, e, e) of the log-likelihood of each recording by the effects.

    `designs` (levels, r) of the levels, and which recordings count at each (levels, r). `claimed`
    (c,): the effects of the claims, with their designs (c, r), and the covariance (levels, c, c)
    of their sizes in the recordings that count.
    """

    gradient: FloatArray
    curvature: FloatArray
    designs: FloatArray
    counted: FloatArray
    claimed: IntArray
    claimed_designs: FloatArray
    covariance: FloatArray

    @classmethod
    def of(
        cls, fleet: FleetEvidence, model: FleetModel, designs: FloatArray, required: FloatArray
    ) -> SavedLoss:
        """
        Return what the claims of `model` leave, as `remaining_excess` counts it.

        `designs` (levels, r) of the levels, `required` (r,): the loss that must be saved, of which
        `best_half` says which recordings count.
        """
        k = fleet.columns.first_effect
        x = joint_vectors(fleet, model, with_deviations=False, bounded=True)
        gradient = fleet.scores - np.einsum("rij,rj->ri", fleet.informations, x)
        free = np.abs(x[:, :k]) < _AT_BOUND * fleet.columns.nuisance_bounds
        across = fleet.informations[:, :k, k:] * free[:, :, None]
        inner = fleet.informations[:, :k, :k] + np.diag(nuisance_prior(fleet.columns))
        both = free[:, :, None] & free[:, None, :]
        inner = np.where(both, inner, np.eye(k))
        followed = np.swapaxes(across, 1, 2) @ np.linalg.solve(inner, across)
        curvature = fleet.informations[:, k:, k:] - followed
        counted = np.array([best_half(required, design) for design in designs]).astype(float)
        claimed = np.array([c.effect for c in model.claimed], dtype=np.int64)
        z = np.array([c.design for c in model.claimed]).reshape(len(claimed), len(x))
        among = curvature[:, claimed][:, :, claimed] * z.T[:, :, None] * z.T[:, None]
        # Two claims may not act in the recordings that count.
        covariance = np.linalg.pinv(np.einsum("lr,rab->lab", counted, among), hermitian=True)
        return cls(gradient[:, k:], curvature, designs, counted, claimed, z, covariance)

    def exceeds(self, effect: int, required: FloatArray) -> BoolArray:
        """Whether an effect at each level (levels,) may save what is required (r,)."""
        return np.asarray(self.most(effect) >= self.counted @ required)

    def most(self, effect: int) -> FloatArray:
        """
        Return the most (levels,) that an effect saves of the loss of the recordings that count.

        That is where the claims stay as they are, or where they follow, whichever is more.
        """
        designs = self.designs * self.counted
        g = designs @ self.gradient[:, effect]
        h = (designs * self.designs) @ np.maximum(self.curvature[:, effect, effect], 0.0)
        most = _quotient(g, h)
        if not len(self.claimed):
            return most
        across = designs @ (self.curvature[:, self.claimed, effect] * self.claimed_designs.T)
        claims = self.counted @ (self.gradient[:, self.claimed] * self.claimed_designs.T)
        follow = (self.covariance @ across[:, :, None])[:, :, 0]
        left = h - (across * follow).sum(axis=1)
        left = np.where(left > _DETERMINED * h, left, 0.0)
        return np.maximum(most, _quotient(g - (follow * claims).sum(axis=1), left))


def _quotient(g: FloatArray, h: FloatArray) -> FloatArray:
    """Return what a step to the maximum saves; zero without information."""
    return np.asarray(np.where(h > 0.0, g**2 / np.where(h > 0.0, h, 1.0), 0.0))


def best_half(required: FloatArray, design: FloatArray) -> BoolArray:
    """
    Return which recordings (r,) say whether an effect saves enough of their loss.

    Of those in which it acts, the half in which least is `required` (r,): where much else acts, or
    is unexplained, nothing can be said.
    """
    acts = design > 0.0
    return np.asarray(acts & (required <= np.median(required[acts])))
