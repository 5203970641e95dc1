# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fit of a road profile to the residuals of a surrogate model.

Gauss-Newton on the residuals of all channels. A knot influences the residuals for a few seconds
after the vehicle passes it. Knots whose influence never overlaps in time share one run of the
finite differences (A. R. Curtis, M. J. D. Powell, J. K. Reid, IMA J. Appl. Math. 13 (1974) 117).
A prior on size and curvature keeps the spline smooth where the recording holds no information.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.surrogate.residuals import BIN_S, STEP_S, ResidualProblem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile, spline_basis
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import (
    GAUSS_NEWTON,
    BoundedParameters,
    FitOptions,
    Linearisation,
    huber_root,
    minimise,
)


@dataclass(frozen=True)
class _SplinePrior:
    """
    Prior of one profile's coefficients.

    Standard deviations of a coefficient and of its second difference between knots, and the step
    of the finite differences, all in the profile's unit.
    """

    size: float
    curvature: float
    step: float


SPLINE_PRIORS = {
    "grade": _SplinePrior(0.06, 0.03, 0.005),
    "bank": _SplinePrior(0.06, 0.03, 0.005),
    "friction": _SplinePrior(0.3, 0.2, 0.03),
}
"""Grade and bank in rad: public roads reach 0.12 rad; friction relative to a dry road."""
BOUND_SIGMA = 3.0
"""Bound of a coefficient in standard deviations of its prior."""
INFLUENCE_S = 2.5
"""Time after which the influence of a knot has decayed, s."""
_CHUNK_BINS = 250
"""Bins per block of the normal equations: bounds the memory, does not change the result."""


@dataclass(frozen=True)
class _ProfileFit:
    """What the linearisation of a road profile's residuals needs, constant throughout the fit."""

    problem: ResidualProblem
    parameters: FloatArray
    profile: RoadProfile
    weights: FloatArray
    terms: ActiveTerms
    influence: BoolArray
    colours: IntArray

    def with_coefficients(self, x: FloatArray) -> RoadProfile:
        """Return the profile with the coefficients `x` (entries * knots,)."""
        return replace(self.profile, coefficients=x.reshape(self.profile.coefficients.shape))

    def residuals(self, profile: RoadProfile) -> FloatArray:
        """Return the weighted residuals (6, bins) on a road with the given profile."""
        terms = profile.terms(self.problem).merged_with(self.terms)
        return self.problem.residuals(self.parameters, terms) * self.weights

    def linearise(self, x: FloatArray, e: FloatArray) -> Linearisation:
        """Return the normal equations, summed over blocks of bins."""
        entries, knots = self.profile.coefficients.shape
        derivatives = self._coloured_derivatives(x, e)
        normal = np.zeros((entries * knots, entries * knots))
        gradient = np.zeros(entries * knots)
        root = huber_root(e)
        for begin in range(0, e.shape[1], _CHUNK_BINS):
            part = slice(begin, begin + _CHUNK_BINS)
            active = np.flatnonzero(self.influence[:, part].any(axis=1))
            columns = (
                np.concatenate(
                    [
                        derivatives[i, self.colours[active], :, part]
                        * self.influence[active, None, part]
                        for i in range(entries)
                    ]
                )
                * root[:, part]
            )
            columns = columns.reshape(columns.shape[0], -1)
            rows = np.concatenate([i * knots + active for i in range(entries)])
            normal[np.ix_(rows, rows)] += columns @ columns.T
            gradient[rows] += columns @ (e[:, part] * root[:, part]).ravel()
        return Linearisation(gradient, normal, np.empty((0, x.size)))

    def _coloured_derivatives(self, x: FloatArray, e: FloatArray) -> FloatArray:
        """Return the change by all knots of one colour together, (entries, colours, 6, bins)."""
        profile = self.with_coefficients(x)
        out = np.empty((len(profile.entries), int(self.colours.max()) + 1, *e.shape))
        for i, name in enumerate(profile.entries):
            step = SPLINE_PRIORS[name].step
            for colour in range(out.shape[1]):
                coefficients = profile.coefficients.copy()
                coefficients[i, self.colours == colour] += step
                moved = self.residuals(replace(profile, coefficients=coefficients))
                out[i, colour] = (moved - e) / step
        return out


def fit_road_profile(
    problem: ResidualProblem,
    parameters: FloatArray,
    start: RoadProfile,
    weights: FloatArray,
    fixed_terms: ActiveTerms,
    iterations: int,
) -> RoadProfile:
    """
    Return the road profile that fits best at fixed surrogate parameters, from `start`.

    `weights` (6, bins) of the residuals, zero where a bin does not count; `fixed_terms` act in
    addition to the profile.
    """
    influence = _influence_bins(problem, start)
    fit = _ProfileFit(
        problem, parameters, start, weights, fixed_terms, influence, graph_colouring(influence)
    )
    options = FitOptions(iterations, 0.0, 0.0, damping=GAUSS_NEWTON)
    found = minimise(
        lambda x: fit.residuals(fit.with_coefficients(x)),
        _bounded_coefficients(start),
        options,
        linearise=fit.linearise,
    )
    return fit.with_coefficients(found.x)


def _bounded_coefficients(profile: RoadProfile) -> BoundedParameters:
    """Return start, bounds and prior of all coefficients as one vector, entry by entry."""
    entries, knots = profile.coefficients.shape
    priors = [SPLINE_PRIORS[name] for name in profile.entries]
    size = np.repeat([prior.size for prior in priors], knots)
    second_difference = np.diff(np.eye(knots), 2, axis=0)
    coupling = np.zeros((entries * knots, entries * knots))
    for i, prior in enumerate(priors):
        block = slice(i * knots, (i + 1) * knots)
        coupling[block, block] = second_difference.T @ second_difference / prior.curvature**2
    return BoundedParameters(
        start=profile.coefficients.ravel(),
        low=-BOUND_SIGMA * size,
        high=BOUND_SIGMA * size,
        step=np.repeat([prior.step for prior in priors], knots),
        mean=np.zeros(entries * knots),
        deviation=size,
        coupling=coupling,
    )


def _influence_bins(problem: ResidualProblem, profile: RoadProfile) -> BoolArray:
    """Return whether a knot influences a bin, (knots, bins)."""
    steps_per_bin = round(BIN_S / STEP_S)
    distances = profile.distances(problem.pose[::steps_per_bin])[: problem.bins]
    on_road = np.flatnonzero(np.isfinite(distances))
    first, _ = spline_basis(distances, profile.spacing)
    passed = np.zeros((profile.coefficients.shape[1], problem.bins), dtype=bool)
    for k in range(4):
        passed[np.minimum(first[on_road] + k, passed.shape[0] - 1), on_road] = True
    duration = round(INFLUENCE_S / BIN_S)
    # One bin early and late: values are interpolated between positions that are looked up.
    total = np.cumsum(np.pad(passed, ((0, 0), (duration + 1, 3))), axis=1)
    recent = total[:, duration + 4 :] - total[:, : -(duration + 4)]
    return np.asarray(recent[:, : problem.bins] > 0)


def graph_colouring(influence: BoolArray) -> IntArray:
    """Return a colour (knots,) per row such that no two rows of one colour share a column."""
    colours = np.zeros(influence.shape[0], dtype=np.int64)
    taken: list[BoolArray] = []
    for i, row in enumerate(influence):
        for colour, others in enumerate(taken):
            if not np.any(others & row):
                taken[colour] = others | row
                colours[i] = colour
                break
        else:
            colours[i] = len(taken)
            taken.append(row.copy())
    return colours
