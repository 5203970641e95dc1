# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Residuals that are unusual together: their mean over a fraction of a second is beyond noise.

A weak pulse of some tenths of a second may leave no single residual beyond the Huber threshold,
while the mean over its duration, whose standard deviation falls with the root of the number, is
far beyond it. Whitening leaves some correlation: on clean generated recordings such means reach
six standard deviations, and on those with weak gusts thirteen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.levenberg_marquardt import HUBER_THRESHOLD
from adk_ros.signals.score import MAD_TO_SIGMA

WINDOWS = (5, 10, 20)
"""
Bins of 40 ms over which residuals are added: 0.2, 0.4 and 0.8 s. A pulse of a duration in between
loses at most 16 % of its size in standard deviations; beyond them the observer, with a time
constant of 0.5 s, follows the pulse.
"""


class Mean(NamedTuple):
    """Of the residuals of a channel in some bins, in its standard deviations."""

    sigmas: float
    channel: int
    bins: slice


def largest_mean(e: FloatArray) -> Mean:
    """Return the largest mean of whitened residuals (k, b), over at most b bins."""
    found = [
        Mean(float(sigmas[i]), channel, slice(int(i), int(i) + width))
        for channel, row in enumerate(e)
        for width in {min(width, e.shape[1]) for width in WINDOWS}
        for sigmas in [_sigmas(row, width)]
        for i in [np.argmax(sigmas)]
    ]
    return max(found, key=lambda mean: mean.sigmas)


def _sigmas(e: FloatArray, width: int) -> FloatArray:
    """
    Return the mean of residuals (b,) over each window, in its standard deviations.

    A residual of zero is one that does not count.
    """
    sums, counts = (np.cumsum(np.append(0.0, x)) for x in (e, e != 0.0))
    counted = np.maximum(counts[width:] - counts[:-width], 1.0)
    return np.asarray(np.abs(sums[width:] - sums[:-width]) / np.sqrt(counted))


def lasting_residuals(e: FloatArray, threshold: float = HUBER_THRESHOLD) -> BoolArray:
    """
    Return which whitened residuals (k, b) belong to an unusual mean, (k, b).

    A mean is compared with the threshold that a single residual must exceed, in its standard
    deviations: those of noise, or those that the means of the channel have, by their median, where
    the surrogate's error is larger or lasts. Single residuals count up to that threshold, so that
    one alone is no lasting one. Of overlapping windows, that with the largest mean is taken.
    """
    out = np.zeros(e.shape, dtype=bool)
    for row, marked in zip(np.clip(e, -threshold, threshold), out, strict=True):
        found: list[tuple[float, int, int]] = []
        for width in WINDOWS:
            sigmas = _sigmas(row, width)
            sigmas /= max(_typical(sigmas), 1.0)
            at = np.flatnonzero(sigmas > threshold)
            found += [(float(sigmas[i]), int(i), width) for i in at]
        for _, start, width in sorted(found, reverse=True):
            window = marked[start : start + width]
            if not window.any():
                window[:] = True
    return out


def _typical(sigmas: FloatArray) -> float:
    """Return the standard deviation of means of this size; of those that are measured."""
    measured = sigmas[sigmas > 0.0]
    return float(np.median(measured)) / MAD_TO_SIGMA if measured.size else 1.0
