# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sign and unit of the commanded torque.

Ahead, torque accelerates the mass: T = b_0 (dv_x/dt - v_y r) + b_1 v_x² + b_2 with b_0 = m R. The
slope of the road and the driveline make b_0 uncertain by tens of per cent, so it tells the sign
and the unit alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adk_ros.calibration.criteria import MIN_CORRELATION, UNIT_FACTORS
from adk_ros.calibration.finding import Finding, found, not_decidable, ok
from adk_ros.calibration.grid import Signals, smooth
from adk_ros.calibration.informative import MAX_PEDAL
from adk_ros.calibration.regression import regress
from adk_ros.calibration.signs_and_units import gain
from adk_ros.numerics.arrays import FloatArray

_MAX_MASS_LOG = np.log(3.0)
"""|ln| of implied over nominal mass within which the torque is in N·m: load, gear and slope."""


def check_torque(s: Signals, mass: float | None, wheel_radius: float | None) -> Iterator[Finding]:
    """Yield the finding on sign and unit of the commanded torque."""
    name = "torque"
    if s.torque is None:
        yield not_decidable(name, "the command has no torque, or a constant one")
        return
    if s.longitudinal is None or s.v_x is None:
        yield not_decidable(name, "it needs a speed")
        return
    torque = smooth(s.torque)
    # High-passed by the regression's drag and offset columns: gain and correlation of the rest.
    design = np.column_stack([s.v_x**2, np.ones_like(torque)])
    weights = s.moving
    left = [_without(design, values, weights) for values in (torque, s.longitudinal)]
    g = gain(left[0], left[1], weights)
    evidence = "commanded torque against dv_x/dt - v_y r, both without their part in v_x²"
    if g is None or abs(g.correlation) < MIN_CORRELATION - 0.2:
        correlation = 0.0 if g is None else g.correlation
        reason = (
            f"the torque follows the acceleration with a correlation of {correlation:.2f} only "
            "(slope, a pedal instead of a torque, or too little driving)"
        )
        yield not_decidable(name, reason, evidence)
        return
    evidence += f": correlation {g.correlation:.2f}, {s.moving_s:.0f} s"
    if g.value < 0.0:
        text = "the commanded torque has its sign flipped"
        yield found(name, text, evidence, {"torque_scale": -1.0})
        return
    fit = regress(np.column_stack([s.longitudinal, design]), torque, weights)
    if fit is None or mass is None or wheel_radius is None:
        reason = "sign right; unit not decidable without --vehicle"
        yield ok(name, reason, evidence)
        return
    ratio = g.value / (mass * wheel_radius)
    if abs(np.log(ratio)) < _MAX_MASS_LOG:
        yield ok(name, f"sign and unit; {ratio:.2f} times mass times wheel radius", evidence)
        return
    if float(np.abs(s.torque).max()) <= MAX_PEDAL:
        text = (
            "the commanded torque stays within ±1: it looks like a normalised pedal, not a torque "
            "in N·m"
        )
        remedy = (
            "no parameter for this: publish a torque, or estimate it from the pedal (pedal_map); "
            "train and replay can use a pedal"
        )
        yield found(name, text, evidence, remedy=remedy)
        return
    if abs(np.log(ratio / UNIT_FACTORS["kN m"])) < _MAX_MASS_LOG:
        text = "the commanded torque looks like kN m, it must be in N·m"
        yield found(name, text, evidence, {"torque_scale": UNIT_FACTORS["kN m"]})
        return
    text = (
        f"the commanded torque is no torque in N·m: {ratio:.2g} times mass times wheel radius "
        "per acceleration; a pedal, or a motor torque before the gear?"
    )
    yield found(name, text, evidence)


def _without(design: FloatArray, values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return values (n,) minus their weighted regression on the columns of a design (n, k)."""
    weighted = design * weights[:, None]
    solved = np.linalg.pinv(weighted.T @ design) @ (weighted.T @ values)
    return np.asarray(values - design @ solved)
