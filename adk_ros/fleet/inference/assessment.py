# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Size, interval and significance of a candidate next to the claims of a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit

from adk_ros.fleet.inference.fleet_model import Candidate, FleetModel
from adk_ros.fleet.inference.mixed_model import Components, Estimate, MixedModel, Term
from adk_ros.fleet.inference.variance_components import degrees_of_freedom, total_variance
from adk_ros.numerics.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Assessment:
    """
    A candidate, fitted with its components next to the claimed terms.

    `size` in materiality thresholds; `deviation` with all of its variance; `evidence`: t^2 with
    the variance of the model alone; `p_value` of a single test; `response` (d,): size per score of
    the simulation; `components`: tau and kappa of its parameter.
    """

    candidate: Candidate
    size: float
    deviation: float
    evidence: float
    p_value: float
    freedom: float
    response: FloatArray
    components: tuple[float, float]
    extremes: tuple[float, float]
    """Least and largest sum of the parameter's terms in any recording, from neutral."""

    @property
    def interval(self) -> tuple[float, float]:
        """The 90 % confidence interval of the size."""
        half = half_width(self.freedom, self.deviation)
        return self.size - half, self.size + half


def half_width(freedom: float, deviation: float) -> float:
    """Return half of the 90 % confidence interval of a size, by Student's t."""
    return float(-stdtrit(freedom, 0.05)) * deviation


def assessment_of(
    candidate: Candidate,
    m: int,
    estimate: Estimate,
    mixed: MixedModel,
    terms: Sequence[Term],
    components: Components,
    sample: BoolArray | None = None,
) -> Assessment:
    """
    Return the assessment of a candidate, term `m` of an estimate with the surrogate's error.

    `sample` (r,): recordings that the components were fitted to, by default all.
    """
    size, variance = float(estimate.sizes[m]), float(estimate.covariance[m, m])
    deviation = float(np.sqrt(total_variance(mixed, terms, estimate, m)))
    freedom = degrees_of_freedom(mixed, terms, components, m, sample)
    i = mixed.active.index(candidate.effect)
    sums = sum(
        (
            estimate.sizes[k] * t.design
            for k, t in enumerate(terms)
            if t.effect == candidate.effect
        ),
        np.zeros(1),
    )
    return Assessment(
        candidate,
        size,
        deviation,
        size**2 / variance,
        2.0 * float(stdtr(freedom, -abs(size) / deviation)),
        freedom,
        estimate.response[m],
        (float(components.tau[i]), float(components.kappa[i])),
        (float(sums.min()), float(sums.max())),
    )


def extended(model: FleetModel, found: Assessment) -> FleetModel:
    """Return the model with a further claim, with the components of its assessment."""
    return FleetModel(
        (*model.claimed, found.candidate),
        {**model.components, found.candidate.effect: found.components},
        model.strangers,
    )
