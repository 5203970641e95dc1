# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A road map fitted to what the stand-in leaves of a drive.

Gauss-Newton on all channels' residuals. What a knot changes has died away a few seconds after it
was passed, so that knots which are never felt at the same time are moved in one run (A. R. Curtis,
M. J. D. Powell, J. K. Reid, IMA J. Appl. Math. 13 (1974) 117). A prior on size and bend keeps the
curve smooth where the drive says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.surrogate.residuals import BIN_S, STEP_S, ActiveTerms, ResidualProblem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile, basis
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import huber_root


@dataclass(frozen=True)
class _SplinePrior:
    """An entry's usual size, how much it usually bends from knot to knot, and a small step."""

    size: float
    curvature: float
    step: float


SPLINE_PRIORS = {
    "grade": _SplinePrior(0.06, 0.03, 0.005),
    "bank": _SplinePrior(0.06, 0.03, 0.005),
    "friction": _SplinePrior(0.3, 0.2, 0.03),
}
INFLUENCE_S = 2.5
"""A knot is felt this long after it was passed."""
_CHUNK = 250


def fit_road_profile(
    course: ResidualProblem,
    parameters: FloatArray,
    start: RoadProfile,
    weights: FloatArray,
    besides: ActiveTerms,
    rounds: int,
) -> RoadProfile:
    """
    Return the map that fits best under the stand-in's parameters, from `start`.

    `weights` (6, bins) of the residuals, zero where none counts; `besides` is what else acts.
    """
    now = start
    felt = _influence_bins(course, now)
    colours = graph_colouring(felt)
    for _ in range(rounds):
        residuals = course.residuals(parameters, now.terms(course).merged_with(besides))
        moved = _moved(course, parameters, now, residuals, besides, colours)
        now = _stepped(now, residuals * weights, moved * weights, felt, colours)
    return now


def _influence_bins(course: ResidualProblem, road: RoadProfile) -> BoolArray:
    """Return whether a knot is felt in a bin, (knots, bins)."""
    per_bin = round(BIN_S / STEP_S)
    places = road.distances(course.pose[::per_bin])[: course.bins]
    on = np.flatnonzero(np.isfinite(places))
    first, _ = basis(places, road.spacing)
    felt = np.zeros((road.coefficients.shape[1], course.bins), dtype=bool)
    for k in range(4):
        felt[np.minimum(first[on] + k, felt.shape[0] - 1), on] = True
    long = round(INFLUENCE_S / BIN_S)
    # A bin early, since what is interpolated between two places is felt from the first on.
    total = np.cumsum(np.pad(felt, ((0, 0), (long + 1, 3))), axis=1)
    recent = total[:, long + 4 :] - total[:, : -(long + 4)]
    return np.asarray(recent[:, : course.bins] > 0)


def graph_colouring(felt: BoolArray) -> IntArray:
    """Return a colour (knots,) for each row, so that no two of a colour share a column."""
    colours = np.zeros(felt.shape[0], dtype=np.int64)
    taken: list[BoolArray] = []
    for i, row in enumerate(felt):
        for colour, others in enumerate(taken):
            if not np.any(others & row):
                taken[colour] = others | row
                colours[i] = colour
                break
        else:
            colours[i] = len(taken)
            taken.append(row.copy())
    return colours


def _moved(
    course: ResidualProblem,
    parameters: FloatArray,
    road: RoadProfile,
    residuals: FloatArray,
    besides: ActiveTerms,
    colours: IntArray,
) -> FloatArray:
    """Return what moving all knots of a colour changes, (entries, colours, 6, bins)."""
    out = np.empty((len(road.entries), int(colours.max()) + 1, *residuals.shape))
    for e, name in enumerate(road.entries):
        step = SPLINE_PRIORS[name].step
        for colour in range(out.shape[1]):
            coefficients = road.coefficients.copy()
            coefficients[e, colours == colour] += step
            terms = replace(road, coefficients=coefficients).terms(course).merged_with(besides)
            out[e, colour] = (course.residuals(parameters, terms) - residuals) / step
    return out


def _stepped(
    road: RoadProfile, weighted: FloatArray, moved: FloatArray, felt: BoolArray, colours: IntArray
) -> RoadProfile:
    entries, knots = road.coefficients.shape
    normal = np.zeros((entries * knots, entries * knots))
    gradient = np.zeros(entries * knots)
    root = huber_root(weighted)
    for begin in range(0, weighted.shape[1], _CHUNK):
        part = slice(begin, begin + _CHUNK)
        there = np.flatnonzero(felt[:, part].any(axis=1))
        columns = (
            np.concatenate(
                [
                    moved[e, colours[there], :, part] * felt[there, None, part]
                    for e in range(entries)
                ]
            )
            * root[:, part]
        )
        columns = columns.reshape(columns.shape[0], -1)
        where = np.concatenate([e * knots + there for e in range(entries)])
        normal[np.ix_(where, where)] += columns @ columns.T
        gradient[where] += columns @ (weighted[:, part] * root[:, part]).ravel()
    bends = np.diff(np.eye(knots), 2, axis=0)
    for e, name in enumerate(road.entries):
        manner = SPLINE_PRIORS[name]
        own = slice(e * knots, (e + 1) * knots)
        pull = np.eye(knots) / manner.size**2 + bends.T @ bends / manner.curvature**2
        normal[own, own] += pull
        gradient[own] += pull @ road.coefficients[e]
    change = np.linalg.solve(normal, -gradient).reshape(entries, knots)
    most = np.array([3.0 * SPLINE_PRIORS[name].size for name in road.entries])[:, None]
    return replace(road, coefficients=np.clip(road.coefficients + change, -most, most))
