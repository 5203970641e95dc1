# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Position of odometry from the fixes of a GPS receiver: metres to the east and north of the first.

Loggers repeat the last fix in every row until the next one. Only where a fix changes is it new;
between fixes the position is interpolated when the message is made (`importing.streams`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from adk_ros.errors import DataError
from adk_ros.importing.geodesy import east_north
from adk_ros.importing.source_channels import SourceChannel
from adk_ros.importing.streams import MessageStream, longest_gap_ns, rate_text
from adk_ros.importing.wheel_velocity import computed_channel
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray

_MIN_FIXES = 2


def fixes(given: Mapping[str, SourceChannel]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return stamps (n,), ns, latitude and longitude (n,), degrees, where both are known."""
    latitude, longitude = given["latitude"], given["longitude"]
    stamps = np.intersect1d(latitude.stamp_ns, longitude.stamp_ns)
    north, east = (c.values[np.searchsorted(c.stamp_ns, stamps)] for c in (latitude, longitude))
    return stamps, north, east


def gps_position(given: Mapping[str, SourceChannel], notes: list[str]) -> list[SourceChannel]:
    """
    Return x and y by latitude and longitude, at the stamps of new fixes; a note says how many.

    Rows without a fix (both 0, or not finite) are left out.

    :raises DataError: there are fewer than two different fixes.
    """
    stamps, north, east = fixes(given)
    known = np.isfinite(north) & np.isfinite(east) & ((north != 0.0) | (east != 0.0))
    without = int((~known).sum())
    stamps, north, east = stamps[known], north[known], east[known]
    new = _is_new(stamps, north, east)
    if int(new.sum()) < _MIN_FIXES or not (np.ptp(north) or np.ptp(east)):
        raise DataError("computed.position: latitude and longitude have no two different fixes")
    kept = new | _in_pauses(stamps, new)
    stamps, values = stamps[kept], east_north(north[kept], east[kept])
    text = f"x, y from latitude, longitude: {int(new.sum())} fixes ({rate_text(stamps)})"
    notes.append(text + (f"; {without} rows without a fix are left out" if without else ""))
    stream = MessageStream(stamps, {})
    source = f"{given['latitude'].column}, {given['longitude'].column}"
    return [computed_channel(n, source, stream, v) for n, v in zip("xy", values, strict=True)]


def _is_new(stamps: IntArray, north: FloatArray, east: FloatArray) -> BoolArray:
    """Return which rows (n,) have another fix than the row before."""
    new = np.ones(stamps.shape[0], dtype=bool)
    new[1:] = (np.diff(north) != 0.0) | (np.diff(east) != 0.0)
    return new


def _in_pauses(stamps: IntArray, new: BoolArray) -> BoolArray:
    """
    Return the rows (n,) of fixes that are repeated for longer than fixes are interpolated.

    The car stands there, and without these rows the pause would be a gap.
    """
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], stamps.shape[0])
    is_long = stamps[ends - 1] - stamps[starts] > longest_gap_ns(stamps[starts])
    return np.asarray(np.repeat(is_long, ends - starts))
