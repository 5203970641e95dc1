# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects in segments of the lap: a profile along the lap, its segmentation, a fit of the boundaries.

The lap is divided into bins. The response to an effect decays within half a second, so that one
simulation with the effect everywhere, split by bin, gives the response to the effect in each bin.
A ridge regression with a smoothness prior yields the effect's size along the lap; dynamic
programming yields the segments of one common size. Size and boundaries are then fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.fit_budget import SEGMENTS
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.score_test import Candidate, LinearisedProblem
from adk_ros.mismatch.inference.segmentation import BINS, best_segments, bins_of_lap
from adk_ros.mismatch.library.criteria import MIN_SEGMENT_TRANSITIONS, PENALTY_PER_SEGMENT
from adk_ros.mismatch.library.effect import PLACE, Effect
from adk_ros.mismatch.library.search_limits import MAX_SEGMENTS
from adk_ros.mismatch.surrogate.activation import (
    ALWAYS_ACTIVE,
    ROUTE_SPACING_M,
    TRANSITION_LENGTH_M,
    Activation,
)
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_values

_SCAN_SIZES = {"low_friction": -0.15, "crosswind": 4.0, "headwind": 4.0}
"""Sizes at which the derivative is taken, in the effect's unit."""
_SCAN_STEPS = 5.0
"""Size at which the derivative of other effects is taken, in their difference steps."""
AMPLITUDE_GRID = tuple(sign * 0.12 * 1.35**k for sign in (1.0, -1.0) for k in range(16))
"""Sizes that are tried, as multiples of the size at which the derivative is taken."""
GRADUAL_EDGE_WIDTHS = {"road_grade": (9.0, 18.0, 36.0), "road_bank": (9.0, 18.0, 36.0)}
"""Effects that may change gradually, with the transition lengths that are tried, m."""
_SEARCH_TRANSITION_M = 24.0
"""m. Wide transitions of a first fit, so that boundaries far off have derivatives."""
_RIDGE = 0.03
"""Weight of the smoothness prior, relative to the median of the normal matrix's diagonal."""
_RIDGE_SIZE = 0.02
"""Weight of the profile's size in that prior, relative to its second difference."""
_MAX_RESEGMENTATIONS = 2
"""Most times that segments are chosen anew. Empirical: computing time."""


@dataclass(frozen=True)
class SpatialProfile:
    """An effect's size (bins,) along the lap, minus its neutral value; `at` (bins,) in m."""

    effect: str
    at: FloatArray
    size: FloatArray


def fit_segments(
    linearised: LinearisedProblem, effect: Effect, lap: Lap
) -> tuple[Candidate | None, SpatialProfile]:
    """
    Return the effect in its best segments with the linearised gain, if any, and its profile.

    For an amplitude a, bin b gains 2 a n_b - a^2 d_b, with n and d its entries in the normal
    equation. `optimal_segmentation` selects the bins; the best of `AMPLITUDE_GRID` is kept.
    """
    parameter, routes = effect.parameters[0], lap.routes
    lengths = [route.length for route in routes]
    scan = _SCAN_SIZES.get(effect.name, parameter.step * _SCAN_STEPS)
    neutral = parameter.theta_neutral
    columns = _bin_columns(linearised, ActiveEffect(effect, (neutral + scan,)), lap)
    free = linearised.project_out(columns)
    normal = free.T @ free
    usual = float(np.median(np.diag(normal)))
    smooth = 2.0 * np.eye(BINS) - np.roll(np.eye(BINS), 1, axis=0) - np.roll(np.eye(BINS), -1, 0)
    ring = smooth + _RIDGE_SIZE * np.eye(BINS)
    penalty = _RIDGE * usual * np.kron(np.eye(len(routes)), ring)
    right = -(free.T @ linearised.projected)
    amplitude = np.linalg.solve(normal + penalty, right)
    at = np.concatenate(
        [
            i * ROUTE_SPACING_M + (np.arange(BINS) + 0.5) * (route.length / BINS)
            for i, route in enumerate(routes)
        ]
    )
    profile = SpatialProfile(effect.name, at, np.asarray(amplitude * scan))
    low, high = parameter.bounds()
    weight = np.diag(normal)
    best: Candidate | None = None
    for amount in AMPLITUDE_GRID:
        if not low <= neutral + scan * amount <= high:
            continue
        gains = 2.0 * amount * right - amount**2 * weight
        mask, segments = best_segments(gains, lengths)
        if not 0 < len(segments) <= MAX_SEGMENTS * len(routes):
            continue
        solved, gain = linearised.solve(columns[:, mask].sum(axis=1)[:, None])
        gain -= PENALTY_PER_SEGMENT * len(segments)
        if best is None or gain > best.gain:
            theta = float(np.clip(neutral + scan * solved[0], low, high))
            activation = Activation(
                segments=segments,
                lap_length=lap.length,
                distance=lap.distance,
                route_lengths=tuple(lengths) if len(routes) > 1 else (),
            )
            best = Candidate(ActiveEffect(effect, (theta,), activation), gain)
    return best, profile


def _bin_columns(linearised: LinearisedProblem, active: ActiveEffect, lap: Lap) -> FloatArray:
    """Return the change of the residuals by an effect in each bin of the laps, route by route."""
    problem = linearised.likelihood.problem
    everywhere = linearised.column(active)
    n = 6 * problem.bins
    response = everywhere[:n].reshape(6, problem.bins)
    columns = np.zeros((everywhere.shape[0], BINS * len(lap.routes)))
    for i, route in enumerate(lap.routes):
        bin_of = bins_of_lap(problem, route.distance, route.length)
        for b in range(BINS):
            columns[:n, i * BINS + b] = (response * (bin_of == b)).ravel()
    return columns


def refine_segments(likelihood: Likelihood, start: Hypothesis, jacobian: FloatArray) -> Hypothesis:
    """
    Fit sizes and boundaries, with wide transitions first.

    The segments of the last effect are then chosen anew at its fitted size, while that fits
    better; it also gets the best of its `GRADUAL_EDGE_WIDTHS`.
    """

    def fit(effects: Sequence[ActiveEffect], nuisances: FloatArray) -> Hypothesis:
        return likelihood.fit(
            effects, nuisances=nuisances, budget=SEGMENTS, jacobian=jacobian, fit_activation=True
        )

    def fit_coarse_to_fine(h: Hypothesis) -> Hypothesis:
        wide = [_with_transition(a, _SEARCH_TRANSITION_M) for a in h.effects]
        coarse = fit(wide, h.nuisances)
        merged = [replace(a, activation=_merged(a.activation)) for a in coarse.effects]
        sharp = [_with_transition(a, TRANSITION_LENGTH_M) for a in merged]
        return fit(sharp, coarse.nuisances)

    best = fit_coarse_to_fine(start)
    for _ in range(_MAX_RESEGMENTATIONS):
        anew = _resegmented(likelihood, best)
        trial = best if anew is None else fit_coarse_to_fine(anew)
        if trial.loss >= best.loss:
            break
        best = trial
    last = best.effects[-1]
    if last.activation.kind != PLACE or last.effect.name not in GRADUAL_EDGE_WIDTHS:
        return best
    for length in GRADUAL_EDGE_WIDTHS[last.effect.name]:
        gradual = _with_transition(last, length)
        trial = fit([*best.effects[:-1], gradual], best.nuisances)
        if trial.loss > best.loss:
            break
        best = trial
    return best


def _resegmented(likelihood: Likelihood, h: Hypothesis) -> Hypothesis | None:
    """
    Return a hypothesis with the segments of its last effect chosen at its fitted size.

    The first choice is made at the derivative for a standard size, which is inexact for friction.
    A bin's gain is the loss of the recording without the effect minus that with the effect
    everywhere. None where other segments gain no more than another segment would cost.
    """
    last = h.effects[-1]
    activation = last.activation
    if activation.kind != PLACE or activation.distance is None:
        return None
    problem = likelihood.problem
    rows = 6 * problem.bins
    others = h.effects[:-1]
    everywhere = replace(last, activation=ALWAYS_ACTIVE)
    losses = [
        huber_values(likelihood.residuals(h.nuisances, effects)[:rows])
        for effects in (others, (*others, everywhere))
    ]
    by_time = (losses[0] - losses[1]).reshape(6, problem.bins).sum(axis=0)
    gains, lengths = [], []
    for distance, _, length in activation.by_route(activation.distance):
        bin_of = bins_of_lap(problem, distance, length)
        on = np.isfinite(bin_of)
        gains.append(np.bincount(bin_of[on].astype(np.int64), by_time[on], minlength=BINS))
        lengths.append(length)
    gain = np.asarray(np.concatenate(gains), dtype=np.float64)
    mask, segments = best_segments(gain, lengths)
    weight = np.interp(problem.bin_s, problem.middle_s, activation.series(problem))
    improvement = float(gain[mask].sum() - by_time @ weight)
    most = MAX_SEGMENTS * len(lengths)
    if not 0 < len(segments) <= most or improvement < PENALTY_PER_SEGMENT:
        return None
    anew = replace(last, activation=replace(activation, segments=segments))
    return Hypothesis((*others, anew), h.nuisances, h.loss)


def _with_transition(active: ActiveEffect, length: float) -> ActiveEffect:
    """Return an effect in segments with this transition length, m; others as they are."""
    if active.activation.kind != PLACE:
        return active
    return replace(active, activation=replace(active.activation, transition_length=length))


def _merged(activation: Activation) -> Activation:
    """Return the activation without vanished segments, overlapping ones merged."""
    if activation.kind != PLACE:
        return activation
    shortest = MIN_SEGMENT_TRANSITIONS * TRANSITION_LENGTH_M
    kept = [s for s in activation.segments if s[1] - s[0] > shortest]
    kept.sort()
    out: list[tuple[float, float]] = []
    for begin, end in kept:
        if out and begin < out[-1][1] + TRANSITION_LENGTH_M:
            out[-1] = (out[-1][0], max(end, out[-1][1]))
        else:
            out.append((begin, end))
    return replace(activation, segments=tuple(out) or activation.segments[:1])
