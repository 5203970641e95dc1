# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where recordings of a fleet are linearised: effect -> size, in materiality thresholds.

A recording is linearised again where the estimate has moved far enough to matter. Sizes are
rounded, more finely than that: a further drive in a fleet moves every estimate a little, and the
evidence of most others is then the same as before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from adk_ros.fleet.inference.evidence import Column, Columns

Point = Mapping[str, float]
"""Where a recording is linearised: effect -> size, thresholds."""

MOVED, _MOVED_SHARE = 0.3, 0.05
"""
A recording is linearised again where an effect has moved by so many materiality thresholds, and by
this share of its size: less changes the estimate by a fraction of its interval. By choice.
"""
_STEP, _STEP_SHARE = MOVED / 1.5, _MOVED_SHARE / 1.5
"""Steps to which sizes are rounded, by half a step at most: a third of what matters."""


def has_moved(before: Point, after: Point) -> bool:
    """Whether any effect has moved so far that a recording is to be linearised again."""
    for key in {*before, *after}:
        a, b = before.get(key, 0.0), after.get(key, 0.0)
        if abs(a - b) > max(MOVED, _MOVED_SHARE * max(abs(a), abs(b))):
            return True
    return False


def rounded_size(size: float) -> float:
    """
    Return a size, in materiality thresholds, rounded to a step that grows with it.

    Steps are powers of two times the smallest one, at most `_STEP_SHARE` of the size.
    """
    finer = max(_STEP, _STEP_SHARE * abs(size))
    step = _STEP * 2.0 ** math.floor(math.log2(finer / _STEP) + 1e-9)
    return step * round(size / step)


def rounded_values(values: Mapping[str, float], columns: Columns) -> dict[str, float]:
    """Return values (key -> difference from neutral) rounded, without those that become zero."""
    rounded = {key: rounded_value(columns.column(key), x) for key, x in values.items()}
    return {key: value for key, value in rounded.items() if value != 0.0}


def rounded_value(column: Column, value: float) -> float:
    """Return a difference from neutral of an effect's parameter, rounded within its bounds."""
    p = column.parameter
    low, high = (b - p.theta_neutral for b in p.bounds())
    rounded = rounded_size(value / column.materiality) * column.materiality
    return min(max(rounded, low), high)
