# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Segments of laps with the largest gain, by dynamic programming over bins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.library.criteria import PENALTY_PER_SEGMENT
from adk_ros.mismatch.surrogate.activation import ROUTE_SPACING_M
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.numerics.arrays import BoolArray, FloatArray

BINS = 90
"""Bins of a lap; 10 to 20 m each on usual routes."""
_EMPTY_BIN_COST = 1e-3
"""Loss of including a bin: bins without data count only between two that gain."""


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


def bins_of_lap(problem: ResidualProblem, distance: FloatArray, length: float) -> FloatArray:
    """
    Return the bin of the lap at each bin of the residuals (b,), NaN off the lap.

    `distance` (n,) along the lap of `length` m.
    """
    unwrapped, known = distance.copy(), np.isfinite(distance)
    unwrapped[known] = np.unwrap(distance[known], period=length)
    along = np.interp(problem.bin_s, problem.middle_s, unwrapped)
    return np.asarray(np.floor(along / (length / BINS)) % BINS)


def best_segments(
    gain: FloatArray, lengths: Sequence[float]
) -> tuple[BoolArray, tuple[tuple[float, float], ...]]:
    """Return the bins of all routes with the largest penalised gain, and their segments."""
    masks = [
        optimal_segmentation(route, PENALTY_PER_SEGMENT)
        for route in gain.reshape(len(lengths), BINS)
    ]
    segments = tuple(
        (i * ROUTE_SPACING_M + begin, i * ROUTE_SPACING_M + end)
        for i, (mask, length) in enumerate(zip(masks, lengths, strict=True))
        for begin, end in segments_of_mask(mask, length)
    )
    return np.concatenate(masks), segments


def optimal_segmentation(gain: FloatArray, penalty_per_segment: float) -> BoolArray:
    """
    Return the bins (n,) of a ring with the largest sum of gains minus a penalty per segment.

    Dynamic programming over two states, once for each initial state of the ring. Bins with almost
    no gain join their neighbours' segment, since a further segment costs more than they do.
    """
    n = gain.shape[0]
    best_total, best = 0.0, np.zeros(n, dtype=bool)
    net = gain - _EMPTY_BIN_COST
    for first in (0, 1):
        value = np.array([0.0, -np.inf]) if first == 0 else np.array([-np.inf, net[0]])
        previous = np.zeros((n, 2), dtype=np.int64)
        for k in range(1, n):
            off = (value[0], value[1])
            on = (value[0] - penalty_per_segment, value[1])
            previous[k] = int(off[1] > off[0]), int(on[1] >= on[0])
            value = np.array([max(off), max(on) + net[k]])
        # Closing the ring: a segment that begins at bin 0 after an inactive last bin costs, too.
        if first == 1:
            value[0] -= penalty_per_segment
        state = int(np.argmax(value))
        total = float(value[state])
        if total <= best_total:
            continue
        mask = np.zeros(n, dtype=bool)
        for k in range(n - 1, -1, -1):
            mask[k] = state == 1
            state = int(previous[k, state])
        best_total, best = total, mask
    return best
