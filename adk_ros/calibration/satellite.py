# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scale of v_x against the speed of a satellite receiver, and the delay of the receiver.

With g the speed over ground that the receiver reports tau late, and k the factor of odometry,
hypot(v_x, v_y)(t) = k g(t + tau). Over a block of 5 s

    integral of hypot(v_x, v_y) = k (integral of g + tau (change of g)),

so that a delay, or a filter of the receiver, is not taken for a scale.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from adk_ros.calibration.continuity import frozen, gaps
from adk_ros.calibration.criteria import (
    BLOCK_S,
    GUARD_S,
    MAX_COPY,
    MAX_UNIT_ERROR,
    PERIOD_S,
    UNIT_FACTORS,
)
from adk_ros.calibration.finding import Finding, judged, not_decidable
from adk_ros.calibration.grid import Signals, smooth
from adk_ros.calibration.odometry_calibration import blocks_of, change_over, integral_over
from adk_ros.calibration.regression import Estimate, regress
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES

_SCALE, _DELAY = "gps_scale", "gps_delay"
_REMEDY_DELAY = (
    "no parameter for this: expect speeds and positions of the receiver that late, or stamp them "
    "with the time of their measurement"
)


def check_receiver(s: Signals, gps: Stream | None, sensors: SensorConfig) -> Iterator[Finding]:
    """
    Yield scale and delay of odometry's speed and the speed of a receiver, if there is one.

    :param gps: speed over ground in the column "gps_speed", m/s.
    """
    if gps is None or s.v_x is None or not gps.has("gps_speed"):
        return
    sideways = np.zeros_like(s.v_x) if s.v_y is None else s.v_y
    speed = np.hypot(s.v_x, sideways)
    received = smooth(np.interp(s.at_s, gps.at_s, gps["gps_speed"]))
    usable = s.moving * where_received(s, gps, speed)
    if _is_copy(received, speed, usable):
        yield not_decidable(_SCALE, "v_x is the speed of the GPS receiver itself")
        return
    starts, weights = blocks_of(s, usable=usable)
    columns = np.column_stack([integral_over(received, starts), change_over(received, starts)])
    fit = regress(columns, integral_over(speed, starts), weights, period_s=BLOCK_S)
    over_ground = "v_x" if s.v_y is None else "v_x, v_y"
    evidence = (
        f"distance driven by {over_ground} over 5 s against that by GPS speed, with a column that "
        "takes up delay and filter"
    )
    if fit is None:
        seconds = float(usable.sum()) * PERIOD_S
        reason = f"{seconds:.0f} s of driving with GPS speed and without faults are too few"
        yield not_decidable(_SCALE, reason, evidence)
        return
    scale = fit.estimate(0)
    yield _of_scale(scale, sensors, evidence)
    if scale.value > 0.0:
        delay = fit.estimate(1).divided(scale.value)
        text = "the GPS speed is later than odometry's velocity, by a delay or a filter"
        yield judged(_DELAY, delay, 0.0, text, evidence, remedy=_REMEDY_DELAY)


def _of_scale(scale: Estimate, sensors: SensorConfig, evidence: str) -> Finding:
    parameters: dict[str, Any] = {}
    units = [x for x in ("km/h", "mph") if _is_near(scale.value, UNIT_FACTORS[x])]
    if ODOMETRY_TYPES[sensors.odometry_type].needs_radius and scale.value > 0.0:
        # v_x is the radius times the wheel speed.
        parameters = {"wheel_radius": round(sensors.wheel_radius / scale.value, 4)}
    elif scale.value > 0.0:
        parameters = {"odometry_scale": scale.value}
    text = "odometry's velocity is not to the scale of the GPS speed"
    text += f" (it looks like {units[0]}): ratio" if units else ": ratio"
    return judged(_SCALE, scale, 1.0, text, evidence, parameters=parameters)


def _is_near(value: float, factor: float) -> bool:
    return value > 0.0 and abs(float(np.log(value / factor))) < MAX_UNIT_ERROR


def where_received(s: Signals, gps: Stream, speed: FloatArray) -> FloatArray:
    """Return 1 (n,) where the receiver reports a speed that is not held, else 0."""
    inside = (s.at_s >= gps.at_s[0]) & (s.at_s <= gps.at_s[-1])
    at_stamps = np.interp(gps.at_s, s.at_s, speed)
    for begin, end in [*gaps(gps), *frozen(gps, at_stamps)]:
        inside &= (s.at_s < begin - GUARD_S) | (s.at_s > end + GUARD_S)
    return np.asarray(inside, dtype=np.float64)


def _is_copy(received: FloatArray, speed: FloatArray, weights: FloatArray) -> bool:
    error = float(weights @ (received - speed) ** 2)
    return error < MAX_COPY * float(weights @ speed**2)
