# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Wheel radius from wheel speeds, by a regression of v_x on them where little slips.

The centre of a wheel moves ahead with v_x ∓ r b/2, at half the track b to the left or right; it
rolls in its direction, which front wheels turn by delta. At small slip angles,

    v_x = R omega cos(delta) + c r,

with the yaw rate r in a separate column: bends to one side are not taken for another radius.
Joints, whose place is unknown, have neither term.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from adk_ros.bags.auxiliary_topics import AXLES
from adk_ros.calibration.finding import Finding, Verdict, judged, not_decidable
from adk_ros.calibration.grid import Signals, smooth
from adk_ros.calibration.regression import Estimate, regress
from adk_ros.calibration.signs_and_units import gain
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import FloatArray

_NAME = "wheel_radius"
_MAX_SLIP_ACCEL = 1.0
"""m/s² below which a wheel rolls with less than 1 % of slip (slip stiffness of 10 to 20)."""
_MIN_WHEEL_CORRELATION = 0.98
"""Correlation of a wheel speed with v_x; a motor or a steered joint has less. By choice."""
_MAX_RADIUS_RATIO = 2.0
"""Over the nominal radius, or under it; the least gear of a motor is above. By choice."""
_REMEDY = (
    "the wheels do not agree on a radius, so none is proposed: compare the sizes and pressures of "
    "the tyres"
)


def check_joints(
    s: Signals, joints: Mapping[str, Stream], nominal: float | None
) -> Iterator[Finding]:
    """
    Yield the wheel radius from each joint that turns with the speed; a proposal as `check_wheels`.

    A joint with a radius far from the nominal one is none of a wheel.
    """
    found: list[Finding] = []
    radii: list[float] = []
    for joint, stream in joints.items():
        speed = _rolling(s, stream)
        if speed is None or s.v_x is None:
            continue
        evidence = f"regression of v_x on the angular velocity of joint '{joint}' below 1 m/s²"
        fit = regress(speed[:, None], s.v_x, _weights(s))
        if fit is None:
            continue
        radius = fit.estimate(0)
        if nominal is not None and not _is_of_wheel(radius.value, nominal):
            times = nominal / radius.value
            reason = (
                f"joint '{joint}' turns {times:.3g} times as fast as a wheel: a motor, or no rad/s"
            )
            yield not_decidable(_NAME, reason, evidence)
            continue
        found.append(_judged(_NAME, radius, nominal, f"joint '{joint}'", evidence))
        radii.append(radius.value)
    yield from _proposing(found, radii)


def _is_of_wheel(radius: float, nominal: float) -> bool:
    return nominal / _MAX_RADIUS_RATIO < radius < nominal * _MAX_RADIUS_RATIO


def _proposing(found: list[Finding], radii: list[float]) -> list[Finding]:
    """Return the findings with the mean radius as proposal, if all of them deviate."""
    if not found or any(x.verdict is not Verdict.FINDING for x in found):
        return found
    parameters = {_NAME: round(float(np.mean(radii)), 4)}
    return [replace(x, parameters=parameters, remedy="") for x in found]


def check_wheels(
    s: Signals, wheels: Mapping[str, Stream], nominal: float | None
) -> Iterator[Finding]:
    """
    Yield the radius of each wheel or axle, by its position.

    A radius is proposed only where all of them deviate from the nominal one: their mean.
    """
    found: list[Finding] = []
    radii: list[float] = []
    for position, stream in wheels.items():
        speed = _rolling(s, stream)
        if speed is None or s.v_x is None:
            continue
        columns, terms = [speed], [f"the angular velocity of wheel '{position}'"]
        if position not in AXLES:
            if s.turning is not None:
                columns.append(s.turning)
                terms.append("the yaw rate")
        else:
            terms = [f"the angular velocity of the {position} axle"]
        if position.startswith("front") and s.steering is not None:
            columns[0] = speed * np.cos(smooth(s.steering))
            terms[0] += " times the cosine of the steering angle"
        evidence = f"regression of v_x on {' and '.join(terms)} below 1 m/s²"
        fit = regress(np.column_stack(columns), s.v_x, _weights(s))
        if fit is None:
            continue
        radius = fit.estimate(0)
        title = f"{position.replace('_', ' ')} {'axle' if position in AXLES else 'wheel'}"
        found.append(_judged(f"{_NAME}_{position}", radius, nominal, title, evidence))
        radii.append(radius.value)
    yield from _proposing(found, radii)


def _weights(s: Signals) -> FloatArray:
    assert s.longitudinal is not None
    return np.asarray(s.moving * (np.abs(s.longitudinal) < _MAX_SLIP_ACCEL))


def _rolling(s: Signals, stream: Stream) -> FloatArray | None:
    """Return an angular velocity (n,) on the grid; None if it does not turn with the speed."""
    if s.v_x is None or not stream.has("velocity"):
        return None
    speed = smooth(np.interp(s.at_s, stream.at_s, stream["velocity"]))
    g = gain(speed, s.v_x, _weights(s))
    return None if g is None or abs(g.correlation) < _MIN_WHEEL_CORRELATION else speed


def _judged(
    name: str, radius: Estimate, nominal: float | None, title: str, evidence: str
) -> Finding:
    if nominal is None:
        reason = f"the nominal radius is unknown: give --vehicle; {radius.value:.4g} m"
        return not_decidable(name, reason, evidence)
    text = f"{title}: wheel radius over the nominal {nominal:.4g} m"
    ratio = radius.divided(nominal)
    return judged(name, ratio, 1.0, text, evidence, kind=_NAME, remedy=_REMEDY)
