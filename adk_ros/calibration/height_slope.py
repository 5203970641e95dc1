# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The slope of a recorded height along the way, against the grade from specific force and velocity.

Over a block of driving, the slope of a height h is its regression on the travelled distance s,

    dh/ds = sum (s - mean s) h / sum (s - mean s)²,

and that of the profile is the same of its height H, the integral of v_x sin(grade). With d the
travelled distance of a block, over all blocks

    d dh/ds = scale (d dH/ds) + level d - lag (d dV/ds) + noise,    V = v_x sin(grade).

The profile is the mean of a posterior, which does not correlate with its error: that error adds
noise, and does not lower the scale. V takes up a delay or a filter of the height. Blocks as long
as 5, 10, 20 or 40 s are tried: the noise of the height favours long ones, a drift of it and short
hills favour short ones. Those with the least standard error of the scale count.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.continuity import Interval, frozen, gaps
from adk_ros.calibration.criteria import LONGER_BLOCKS_S
from adk_ros.calibration.regression import Estimate, regress
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.constants import QUANTILE_90
from adk_ros.road.profile import RoadProfile

_MIN_HEIGHTS = 4
"""Heights in a block: two more than a line has parameters."""
_MAX_STEPS = 1.5
"""Steps between two nodes of the profile: more is a gap."""


@dataclass(frozen=True)
class HeightSlope:
    """
    What a height says of the grade.

    `grade` (n,): slope of the height at the nodes of the profile, over `block_s` s around them,
    rad; NaN where it is unknown. `scale`: of the height against the profile; `level`: mean of the
    slope less that of the profile, 1. `correlation` and RMS difference `rms` (1, without the
    level) of both over the blocks.
    """

    grade: FloatArray
    block_s: float
    scale: Estimate
    level: Estimate
    correlation: float
    rms: float


def height_slope(profile: RoadProfile, odometry: Stream, height: Stream) -> HeightSlope | None:
    """
    Return the slope of a height in comparison with a profile; None with too few data.

    :param odometry: with v_x, in m/s. :param height: m, in the column "height".
    """
    if profile.at_s.size < 2:
        return None
    along = _Along(profile, odometry, height)
    fits = [fit for fit in map(along.compared, LONGER_BLOCKS_S) if fit is not None]
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.scale.standard_error)
    return replace(best, grade=along.grade(best.block_s))


class _Along:
    """Height, height of the profile and vertical velocity at the stamps of the height."""

    def __init__(self, profile: RoadProfile, odometry: Stream, height: Stream) -> None:
        nodes = profile.at_s
        self._nodes = nodes
        inside = (height.at_s >= nodes[0]) & (height.at_s <= nodes[-1])
        self._at = height.at_s[inside]
        v_x = np.interp(nodes, odometry.at_s, odometry["v_x"])
        vertical = v_x * np.sin(profile.grade.value)
        travelled, rise = (_integral(nodes, values) for values in (v_x, vertical))
        self._s = np.interp(self._at, nodes, travelled)
        columns = [height["height"][inside], *(
            np.interp(self._at, nodes, values) for values in (rise, vertical)
        )]  # fmt: skip
        self._sums = _sums(self._s, columns)
        self._travelled = travelled
        self._scale_error = profile.grade.scale
        speed = np.interp(height.at_s, odometry.at_s, np.abs(odometry["v_x"]))
        step = float(np.median(np.diff(nodes)))
        jumps = np.flatnonzero(np.diff(nodes) > _MAX_STEPS * step)
        self._unusable: list[Interval] = [
            *zip(nodes[jumps].tolist(), nodes[jumps + 1].tolist(), strict=True),
            *gaps(height),
            *frozen(height, speed),
        ]

    def compared(self, block_s: float) -> HeightSlope | None:
        """Return the comparison over blocks of a length, without its `grade`."""
        begin = np.arange(self._nodes[0], self._nodes[-1] - block_s, block_s)
        slopes, used = self._slopes(begin, begin + block_s)
        moved = np.diff([np.interp(t, self._nodes, self._travelled) for t in
                         (begin, begin + block_s)], axis=0)[0]  # fmt: skip
        risen = np.where(used, slopes * moved, 0.0)
        weights = used.astype(np.float64)
        by_height, by_profile, vertical = risen
        columns = np.column_stack([by_profile, moved, vertical])
        fit = regress(columns, by_height, weights, period_s=block_s)
        level = regress(moved[:, None], by_height - by_profile, weights, period_s=block_s)
        if fit is None or level is None:
            return None
        scale = _widened(fit.estimate(0), self._scale_error)
        heights, grades = slopes[:2, used]
        if not (np.ptp(heights) > 0.0 and np.ptp(grades) > 0.0):
            return None
        correlation = float(np.corrcoef(heights, grades)[0, 1])
        rms = float(np.std(heights - grades))
        return HeightSlope(np.zeros(0), block_s, scale, level.estimate(0), correlation, rms)

    def grade(self, block_s: float) -> FloatArray:
        """Return the slope (n,) of the height around each node of the profile, rad."""
        slopes, used = self._slopes(self._nodes - 0.5 * block_s, self._nodes + 0.5 * block_s)
        return np.where(used, np.arcsin(np.clip(slopes[0], -1.0, 1.0)), np.nan)

    def _slopes(self, begin: FloatArray, end: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return slopes (3, b) over intervals, s, and whether (b,) they are usable."""
        first, last = (np.searchsorted(self._at, x) for x in (begin, end))
        used = (begin >= self._nodes[0]) & (end <= self._nodes[-1])
        used &= (last - first >= _MIN_HEIGHTS) & ~_meets(begin, end, self._unusable)
        return _regressed(self._sums, first, last, used)


def _sums(s: FloatArray, columns: Iterable[FloatArray]) -> FloatArray:
    """Return running sums (n + 1, 3 + 2 k) of 1, s, s², and y, s y of k columns y (n,)."""
    # About the means, for the differences of large sums.
    s = s - np.mean(s) if s.size else s
    terms = [np.ones_like(s), s, s**2]
    for y in columns:
        centred = y - np.mean(y) if y.size else y
        terms += [centred, s * centred]
    return np.vstack([np.zeros(len(terms)), np.cumsum(np.column_stack(terms), axis=0)])


def _regressed(
    sums: FloatArray, first: IntArray, last: IntArray, used: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Return the slopes (k, b) of regressions on s over rows from `first` to before `last`."""
    n, s, ss, *pairs = (sums[last] - sums[first]).T
    spread = n * ss - s**2
    # Heights at one place (within 1 mm) have no slope.
    used = used & (spread > n**2 * 1e-6)
    divisor = np.where(used, spread, 1.0)
    slopes = [(n * sy - s * y) / divisor for y, sy in zip(pairs[::2], pairs[1::2], strict=True)]
    return np.where(used, slopes, 0.0), used


def _integral(at_s: FloatArray, values: FloatArray) -> FloatArray:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(at_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _meets(begin: FloatArray, end: FloatArray, intervals: Iterable[Interval]) -> BoolArray:
    out = np.zeros(begin.size, dtype=bool)
    for first, last in intervals:
        out |= (begin < last) & (end > first)
    return out


def _widened(estimate: Estimate, share: float) -> Estimate:
    """Return an estimate whose 90 % interval also has an error of `share` of its value."""
    more = share * abs(estimate.value)
    return replace(
        estimate,
        standard_error=float(np.hypot(estimate.standard_error, more / QUANTILE_90)),
        low=estimate.value - float(np.hypot(estimate.value - estimate.low, more)),
        high=estimate.value + float(np.hypot(estimate.high - estimate.value, more)),
    )
