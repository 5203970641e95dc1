# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of a fleet, in materiality thresholds of the fitted variable, in the parameter's unit."""

from __future__ import annotations

from adk_ros.fleet.inference.evidence import Column
from adk_ros.mismatch.library.effect import EffectParameter


def size_in_unit(p: EffectParameter, theta: float) -> float:
    """Return a fitted variable's difference from neutral in its unit; its value if inverse."""
    if p.inverse:
        return p.value(max(p.theta_neutral + theta, 1e-30))
    return theta


def interval_in_unit(column: Column, low: float, high: float) -> tuple[float, float]:
    """Return the ends of an interval, of thresholds, in the unit, the lower one first."""
    values = [size_in_unit(column.parameter, x * column.materiality) for x in (low, high)]
    return min(values), max(values)


def deviation_in_unit(column: Column, size: float, deviation: float) -> float:
    """Return a standard deviation, of thresholds, in the unit; of an inverse to first order."""
    p, theta = column.parameter, deviation * column.materiality
    return theta * size_in_unit(p, size * column.materiality) ** 2 if p.inverse else theta
