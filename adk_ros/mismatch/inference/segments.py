# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects that are bound to a place: a map over the lap, then stretches with edges.

The lap is cut into bins. What an effect changes it changes within half a second, so that one run
with the effect everywhere, cut into the bins, tells what it would change in each; a ridge
regression with a smoothness prior then gives its size along the lap, and dynamic programming the
stretches of one common size. Size and edges are then fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.effect import PLACE, Effect
from adk_ros.mismatch.surrogate.activation import TRANSITION_LENGTH_M, Activation
from adk_ros.mismatch.surrogate.lap import Lap
from adk_ros.numerics.arrays import BoolArray, FloatArray

BINS = 90
_SCAN_AMPLITUDES = {"low_friction": (-0.15,), "crosswind": (4.0,), "headwind": (4.0,)}
AMPLITUDE_GRID = tuple(sign * 0.12 * 1.35**k for sign in (1.0, -1.0) for k in range(16))
"""Sizes that are tried, in the sizes of the derivatives."""
GRADUAL_EDGE_WIDTHS = {"road_grade": (9.0, 18.0, 36.0), "road_bank": (9.0, 18.0, 36.0)}
"""Effects that may come and go gradually, with widths of the edges, m."""
PENALTY_PER_SEGMENT = 16.0
MAX_SEGMENTS = 6
_MERGE_DISTANCE_M = 24.0
_RIDGE = 0.03


@dataclass(frozen=True)
class SpatialProfile:
    """An effect's size (bins,) along the lap, less its neutral value; `at` (bins,) m."""

    effect: str
    at: FloatArray
    size: FloatArray


def segments_of_mask(mask: BoolArray, lap: float) -> tuple[tuple[float, float], ...]:
    """Return the (begin, end) in m of runs of True on a ring of bins."""
    n = mask.shape[0]
    if mask.all() or not mask.any():
        return ()
    width = lap / n
    out = []
    begins = np.flatnonzero(mask & ~np.roll(mask, 1))
    for begin in begins:
        count = 1
        while mask[(begin + count) % n]:
            count += 1
        out.append((float(begin * width), float((begin + count) * width)))
    return tuple(out)


def fit_segments(
    screen: LinearisedProblem, effect: Effect, lap: Lap
) -> tuple[tuple[float, ActiveEffect] | None, SpatialProfile]:
    """
    Return the best stretches for `effect` with their linear gain, if any, and its map.

    For an amount a of the effect, bin b gains 2 a n_b - a^2 d_b, n and d its part of the normal
    equation; `best_mask` takes the bins that pay, and the best of `AMOUNTS` is kept.
    """
    size = _SCAN_AMPLITUDES.get(effect.name, (effect.parameters[0].step * 5.0,))[0]
    neutral = effect.parameters[0].theta_neutral
    width = lap.length / BINS
    course = screen.likelihood.problem
    everywhere = screen.column(ActiveEffect(effect, (neutral + size,)))
    whole = everywhere[: 6 * course.bins].reshape(6, course.bins)
    bin_of = np.floor(np.interp(course.bin_s, course.middle_s, lap.unwrapped) / width)
    stacked = np.zeros((everywhere.shape[0], BINS))
    for b in range(BINS):
        there = bin_of.astype(np.int64) % BINS == b
        stacked[: 6 * course.bins, b] = (whole * there).ravel()
    free = screen.project_out(stacked)
    normal = free.T @ free
    usual = float(np.median(np.diag(normal)))
    smooth = 2.0 * np.eye(BINS) - np.roll(np.eye(BINS), 1, axis=0) - np.roll(np.eye(BINS), -1, 0)
    penalty = _RIDGE * usual * (smooth + 0.02 * np.eye(BINS))
    profile = np.linalg.solve(normal + penalty, -(free.T @ screen.left))
    at = np.asarray((np.arange(BINS) + 0.5) * width, dtype=np.float64)
    place_map = SpatialProfile(effect.name, at, np.asarray(profile * size))
    low, high = effect.parameters[0].bounds()
    weight, right = np.diag(normal), -(free.T @ screen.left)
    best: tuple[float, ActiveEffect] | None = None
    for amount in AMPLITUDE_GRID:
        if not low <= neutral + size * amount <= high:
            continue
        mask = optimal_segmentation(2.0 * amount * right - amount**2 * weight, PENALTY_PER_SEGMENT)
        where = segments_of_mask(mask, lap.length)
        if not 0 < len(where) <= MAX_SEGMENTS:
            continue
        solved, gain = screen.solve(stacked[:, mask].sum(axis=1)[:, None])
        gain -= PENALTY_PER_SEGMENT * len(where)
        if best is None or gain > best[0]:
            inner = float(np.clip(neutral + size * solved[0], low, high))
            gate = Activation(segments=where, lap_length=lap.length, distance=lap.distance)
            best = (gain, ActiveEffect(effect, (inner,), gate))
    return best, place_map


def optimal_segmentation(gain: FloatArray, per_stretch: float) -> BoolArray:
    """
    Return which bins of a ring (n,) to take for the largest sum of gains less a price a stretch.

    By dynamic programming over two states, once for each state that the ring may begin in. Bins
    that say nothing join what lies around them, since a stretch more costs more than they do.
    """
    n = gain.shape[0]
    best_total, best = 0.0, np.zeros(n, dtype=bool)
    own = gain - 1e-3
    for first in (0, 1):
        value = np.array([0.0, -np.inf]) if first == 0 else np.array([-np.inf, own[0]])
        came = np.zeros((n, 2), dtype=np.int64)
        for k in range(1, n):
            off = (value[0], value[1])
            on = (value[0] - per_stretch, value[1])
            came[k] = int(off[1] > off[0]), int(on[1] >= on[0])
            value = np.array([max(off), max(on) + own[k]])
        # Round the ring: what ends off and begins on begins a stretch there.
        if first == 1:
            value[0] -= per_stretch
        state = int(np.argmax(value))
        total = float(value[state])
        if total <= best_total:
            continue
        mask = np.zeros(n, dtype=bool)
        for k in range(n - 1, -1, -1):
            mask[k] = state == 1
            state = int(came[k, state])
        best_total, best = total, mask
    return best


def refine_segments(
    likelihood: Likelihood, start: Hypothesis, known: FloatArray, iterations: int = 5
) -> Hypothesis:
    """
    Fit sizes and edges, the edges wide at first so that they feel how far off they are.

    A place that begins gradually, as a slope does, is one of the `GRADUAL` edges' width.
    """
    wide = [
        replace(a, activation=replace(a.activation, transition_length=_MERGE_DISTANCE_M))
        if a.activation.kind == PLACE
        else a
        for a in start.actives
    ]
    coarse = likelihood.fit(wide, start.tolerances, iterations, known, edges=True)
    sharp = [
        replace(
            a, activation=replace(_merged(a.activation), transition_length=TRANSITION_LENGTH_M)
        )
        if a.activation.kind == PLACE
        else a
        for a in coarse.actives
    ]
    best = likelihood.fit(sharp, coarse.tolerances, iterations, known, edges=True)
    last = best.actives[-1]
    if last.activation.kind != PLACE or last.effect.name not in GRADUAL_EDGE_WIDTHS:
        return best
    for edge in GRADUAL_EDGE_WIDTHS[last.effect.name]:
        softer = replace(last, activation=replace(last.activation, transition_length=edge))
        tried = likelihood.fit(
            [*best.actives[:-1], softer], best.tolerances, iterations, known, edges=True
        )
        if tried.cost > best.cost:
            break
        best = tried
    return best


def _merged(gate: Activation) -> Activation:
    """Return the gate without stretches that have shrunk to nothing or run into the next."""
    kept = [s for s in gate.segments if s[1] - s[0] > 2.0 * TRANSITION_LENGTH_M]
    kept.sort()
    out: list[tuple[float, float]] = []
    for begin, end in kept:
        if out and begin < out[-1][1] + TRANSITION_LENGTH_M:
            out[-1] = (out[-1][0], max(end, out[-1][1]))
        else:
            out.append((begin, end))
    return replace(gate, segments=tuple(out) or gate.segments[:1])
