# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A stream from the rows of its messages: usable stamps in their order, single gaps held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.calibration.criteria import MIN_GAP_PERIODS, MIN_GAP_S
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import BoolArray, FloatArray

MIN_MESSAGES = 10
"""Messages that a stream must have: fewer have no rate."""
_MAX_VALUE = 1e9
"""SI units; a larger number is a faulty field: above any angle, torque or position of a car."""
_MAX_STRAY_S = 60.0
"""s by which stamps may leave the duration of the log."""


def usable_rows(rows: list[list[float]], seconds: float) -> tuple[FloatArray, int]:
    """
    Return rows with usable stamps in their order (n, k), and how many were out of order.

    :param rows: stamp, s, then values of each message. :param seconds: duration of the log.
    """
    table = np.array(rows, dtype=np.float64)
    if table.size == 0:
        return table, 0
    table[:, 1:][np.abs(table[:, 1:]) > _MAX_VALUE] = np.nan
    at = table[:, 0]
    # A stamp of another day would make the grid endless.
    near = np.abs(at - np.median(at)) < seconds + _MAX_STRAY_S
    usable = np.isfinite(at) & (at > 0.0) & near
    disordered = int((np.diff(at) <= 0.0).sum()) + int((~near & (at > 0.0)).sum())
    table = table[usable]
    _, kept = np.unique(table[:, 0], return_index=True)
    return table[kept], disordered


def stream_of(
    name: str, found: tuple[FloatArray, int], columns: Sequence[str], first: float
) -> Stream | None:
    """
    Return the stream of rows that `usable_rows` returned; None if they are too few.

    Missing values are interpolated, and long runs of them noted; a channel that lacks most of its
    values is NaN throughout.

    :param name: for messages. :param first: stamp from which times count, s.
    """
    table, disordered = found
    if table.shape[0] < MIN_MESSAGES:
        return None
    at_s = table[:, 0] - first
    values, unknown = {}, set()
    for i, column in enumerate(columns):
        known = np.isfinite(table[:, i + 1])
        if known.mean() < 0.5:
            values[column] = np.full_like(at_s, np.nan)
            continue
        values[column] = np.interp(at_s, at_s[known], table[known, i + 1])
        unknown |= _long_gaps(at_s, known)
    return Stream(name, at_s, values, disordered, tuple(sorted(unknown)))


def _long_gaps(at_s: FloatArray, known: BoolArray) -> set[tuple[float, float]]:
    """Return the intervals in which a channel is unknown for as long as a gap of a stream."""
    ends = np.concatenate([at_s[:1], at_s[known], at_s[-1:]])
    longest = max(MIN_GAP_S, MIN_GAP_PERIODS * float(np.median(np.diff(at_s))))
    return {
        (float(ends[i]), float(ends[i + 1]))
        for i in np.flatnonzero(np.diff(ends) > longest)
        if not known[(at_s > ends[i]) & (at_s < ends[i + 1])].any()
        and ((at_s > ends[i]) & (at_s < ends[i + 1])).any()
    }
