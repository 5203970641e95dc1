# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The rolling radius of wheels, from the distance that a GPS receiver says.

Over a block of time the distance s is the radius R times the angle that the wheels turn. A
receiver that is late by tau sees the angle of a moment before, so that

    s = R (angle - tau (omega at the end - omega at the begin))

and a delay is not taken for a radius.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from adk_ros.calibration.criteria import BLOCK_S
from adk_ros.calibration.regression import Estimate, regress
from adk_ros.importing.geodesy import east_north
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import longest_gap_ns
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

_STEP_S = 0.5
"""s between the positions whose distances are added: a car at 20 m/s moves 10 m, so that noise of
0.3 m between them lengthens the way by less than 0.1 %."""


class Reference(NamedTuple):
    """Distance driven (n,), m, at stamps (n,), ns, that increases, and what it comes from."""

    stamp_ns: IntArray
    distance: FloatArray
    source: str


class RadiusFit(NamedTuple):
    """Rolling radius, m, and the delay of the reference, s, each with its 90 % interval."""

    radius: Estimate
    delay: Estimate
    source: str

    @property
    def text(self) -> str:
        """The radius in words."""
        r, d = self.radius, self.delay
        late = ""
        if d.low > 0.0 or d.high < 0.0:
            how = "late" if d.value > 0.0 else "early"
            late = f", which is {abs(d.value):.2f} s {how} (slip of driven wheels looks the same)"
        return (
            f"{r.value:.4f} m ({r.low:.4f} to {r.high:.4f}, {r.seconds:.0f} s) against "
            f"{self.source}{late}"
        )


def reference_of(given: Mapping[str, SourceChannel]) -> Reference | None:
    """Return the distance by GPS speed, else by position; None without either."""
    if "gps_speed" in given:
        speed = given["gps_speed"]
        steps = 0.5e-9 * np.diff(speed.stamp_ns) * (speed.values[1:] + speed.values[:-1])
        return Reference(speed.stamp_ns, np.concatenate([[0.0], np.cumsum(steps)]), "GPS speed")
    for first, second, source in (
        ("x", "y", "the positions"),
        ("latitude", "longitude", "GPS positions"),
    ):
        if first in given and second in given:
            x, y = given[first], given[second]
            stamps = np.intersect1d(x.stamp_ns, y.stamp_ns)
            points = [c.values[np.searchsorted(c.stamp_ns, stamps)] for c in (x, y)]
            if first == "latitude":
                points = east_north(*points)
            kept = _spaced(stamps, round(_STEP_S * 1e9))
            east, north = (np.diff(point[kept]) for point in points)
            moved = np.hypot(east, north)
            if first == "x" and "heading" in given:
                # Along the car: a slide to the side turns no wheel.
                at_s = 0.5e-9 * (stamps[kept][1:] + stamps[kept][:-1]).astype(np.float64)
                angle = _angle(given["heading"], at_s)
                moved = east * np.cos(angle) + north * np.sin(angle)
            if kept.size > 1:
                return Reference(stamps[kept], np.concatenate([[0.0], np.cumsum(moved)]), source)
    return None


def fit_radius(stamp_ns: IntArray, rate: FloatArray, reference: Reference) -> RadiusFit | None:
    """
    Return the radius of wheels that turn with `rate` (n,), rad/s, at stamps (n,), ns.

    None with too few blocks of `BLOCK_S` in which the wheels turn and nothing is missing.
    """
    begin = max(int(stamp_ns[0]), int(reference.stamp_ns[0]))
    end = min(int(stamp_ns[-1]), int(reference.stamp_ns[-1]))
    blocks = int((end - begin) * 1e-9 / BLOCK_S)
    if blocks < 1:
        return None
    edges = begin + np.arange(blocks + 1) * round(BLOCK_S * 1e9)
    steps = 0.5e-9 * np.diff(stamp_ns) * (rate[1:] + rate[:-1])
    turned = np.interp(edges, stamp_ns, np.concatenate([[0.0], np.cumsum(steps)]))
    driven = np.interp(edges, reference.stamp_ns, reference.distance)
    change = np.diff(np.interp(edges, stamp_ns, rate))
    stands = (rate[1:] <= 0.0) | (rate[:-1] <= 0.0)
    is_whole = _has_none(edges, stamp_ns, stands)
    for stamps in (stamp_ns, reference.stamp_ns):
        is_whole &= _has_none(edges, stamps, np.diff(stamps) > longest_gap_ns(stamps))
    weights = is_whole.astype(np.float64)
    columns = np.column_stack([np.diff(turned), -change])
    fit = regress(columns, np.diff(driven), weights, period_s=BLOCK_S)
    if fit is None:
        return None
    radius = fit.estimate(0)
    return RadiusFit(radius, fit.estimate(1).divided(radius.value), reference.source)


def _has_none(edges: IntArray, stamps: IntArray, is_bad: BoolArray) -> BoolArray:
    """Return whether each block is free of bad steps between stamps (n,), `is_bad` (n - 1,)."""
    bad_ns = np.concatenate([[0], np.cumsum(np.where(is_bad, np.diff(stamps), 0))])
    return np.asarray(np.diff(np.interp(edges, stamps, bad_ns)) == 0.0)


def _angle(heading: SourceChannel, at_s: FloatArray) -> FloatArray:
    """Return the heading at times, s."""
    return np.interp(at_s, 1e-9 * heading.stamp_ns, np.unwrap(heading.values))


def _spaced(stamp_ns: IntArray, least_ns: int) -> IntArray:
    """Return the rows whose stamps are at least that far apart."""
    kept: list[int] = []
    last = -least_ns
    for row, stamp in enumerate((stamp_ns - stamp_ns[0]).tolist() if stamp_ns.size else ()):
        if stamp - last >= least_ns:
            kept.append(row)
            last = stamp
    return np.array(kept, dtype=np.int64)
