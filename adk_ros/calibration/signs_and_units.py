# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Signs and units of single channels, from the gain against what other channels imply.

The gain is the ratio of the standard deviations with the sign of the correlation, which noise in
neither signal biases towards zero. Streams are corrected for what is found, so that one fault
does not hide the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.criteria import (
    MAX_UNIT_ERROR,
    MIN_CORRELATION,
    PERIOD_S,
    UNIT_FACTORS,
)
from adk_ros.calibration.finding import Finding, found, not_decidable, ok
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.streams import Streams
from adk_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Gain:
    """Ratio of two signals with its sign, and their correlation."""

    value: float
    correlation: float


def gain(values: FloatArray, reference: FloatArray, weights: FloatArray) -> Gain | None:
    """Return the gain of `values` (n,) against `reference` (n,); None without variation."""
    total = float(weights.sum())
    if total * PERIOD_S < 5.0:
        return None
    x = reference - float(weights @ reference) / total
    y = values - float(weights @ values) / total
    xx, xy, yy = (float(weights @ product) for product in (x * x, x * y, y * y))
    if not (xx > 0.0 and yy > 0.0):
        return None
    correlation = xy / float(np.sqrt(xx * yy))
    return Gain(float(np.copysign(np.sqrt(yy / xx), correlation)), correlation)


def unit_of(factor: float, candidates: Sequence[str]) -> str | None:
    """Return the unit whose factor is nearest to |factor|, or None if SI is or none is near."""
    best, least = None, min(MAX_UNIT_ERROR, abs(np.log(abs(factor))))
    for unit in candidates:
        error = abs(np.log(abs(factor) / UNIT_FACTORS[unit]))
        if error < least:
            best, least = unit, error
    return best


def check_odometry(streams: Streams, s: Signals) -> Iterator[tuple[Finding, Streams]]:
    """Yield findings on v_x, v_y and the yaw rates, each with the streams corrected so far."""
    if streams.odometry is None:
        return
    if s.v_x is None:
        yield not_decidable("v_x", "odometry's v_x is absent or constant"), streams
    elif s.forward is None:
        yield not_decidable("v_x", "odometry has no pose to compare with"), streams
    else:
        for finding, corrected in _channel(
            streams, "odometry", "v_x", s.v_x, s.forward, s, "the velocity of its position",
            ("km/h", "mph"),
        ):  # fmt: skip
            yield finding, corrected
            streams = corrected
        streams = _sideways_in_si(streams, s)
    for finding, corrected in _yaw_rates(streams, s):
        yield finding, corrected
        streams = corrected
    yield from _sideways(streams, s)


def _sideways_in_si(streams: Streams, s: Signals) -> Streams:
    """Return streams whose v_y has the unit that v_x turned out to have."""
    odometry = streams.odometry
    if odometry is None or s.v_x is None:
        return streams
    before = gain(s.v_x, np.interp(s.at_s, odometry.at_s, odometry["v_x"]), s.moving)
    factor = 1.0 if before is None else abs(before.value)
    unit = unit_of(factor, ("km/h", "mph"))
    if unit is None:
        return streams
    scaled = odometry.having(v_y=odometry["v_y"] / UNIT_FACTORS[unit])
    return replace(streams, odometry=scaled)


def _sideways(streams: Streams, s: Signals) -> Iterator[tuple[Finding, Streams]]:
    """Yield the finding on v_y, whose reference is small: only its sign is checked."""
    if s.v_y is None:
        yield not_decidable("v_y", "odometry's v_y is absent or constant"), streams
        return
    if s.leftward is None:
        yield not_decidable("v_y", "odometry has no pose to compare with"), streams
        return
    evidence = "regression of odometry's v_y on the lateral velocity of its position"
    g = gain(s.v_y, s.leftward, s.moving)
    if g is not None and g.correlation < -MIN_CORRELATION:
        text = "odometry's v_y has its sign flipped against the lateral velocity of its position"
        odometry = streams.odometry
        if odometry is not None:
            streams = replace(streams, odometry=odometry.having(v_y=-odometry["v_y"]))
        yield found("v_y", text, f"{evidence}: correlation {g.correlation:.2f}"), streams
    elif g is None or g.correlation < MIN_CORRELATION:
        correlation = 0.0 if g is None else g.correlation
        reason = f"v_y is small or noisy (correlation {correlation:.2f} with the pose)"
        yield not_decidable("v_y", reason, evidence), streams
    else:
        yield ok("v_y", f"sign as the pose, gain {g.value:.3g}", evidence), streams


def _yaw_rates(streams: Streams, s: Signals) -> Iterator[tuple[Finding, Streams]]:
    """
    Check heading and odometry's yaw rate against each other, the course and the gyro.

    All of them vote on the sign; the pose, whose unit follows from its quaternion, decides on the
    unit.
    """
    channels = {
        _COURSE: s.course_rate,
        _HEADING: s.heading_rate,
        _YAW_RATE: s.yaw_rate,
        "the gyro": s.gyro,
    }
    present = {name: values for name, values in channels.items() if values is not None}

    def agreement(a: str, b: str) -> float:
        g = gain(present[a], present[b], s.moving)
        return (
            0.0
            if g is None or abs(g.correlation) < MIN_CORRELATION
            else 1.0
            if g.value > 0.0
            else -1.0
        )

    votes = {a: sum(agreement(a, b) for b in present if b != a) for a in present}
    if _YAW_RATE not in present:
        yield not_decidable("yaw_rate", "odometry's yaw rate is absent or constant"), streams
        return
    if _HEADING not in present:
        if s.course_rate is not None and agreement(_COURSE, _YAW_RATE):
            yield from _channel(
                streams, "odometry", "yaw_rate", s.yaw_rate, s.course_rate, s, _COURSE, ("deg",)
            )
        elif s.gyro is None:
            reason = "neither a pose nor a gyro is there to compare it with"
            yield not_decidable("yaw_rate", reason), streams
        return
    if votes[_HEADING] >= votes[_YAW_RATE]:
        yield from _channel(
            streams, "odometry", "yaw_rate", s.yaw_rate, s.heading_rate, s, _HEADING, ("deg",)
        )
        return
    yield from _channel(
        streams, "odometry", "heading", s.heading_rate, s.yaw_rate, s, _YAW_RATE, ()
    )


def independent_turning(s: Signals) -> FloatArray | None:
    """
    Return the best yaw rate (n,) that is none of the IMU's: of the heading, else of the course.

    None without a pose, and where the course is too coarse to say how the car turns.
    """
    if s.heading_rate is not None or s.course_rate is None:
        return s.heading_rate
    for other in (s.yaw_rate, s.gyro):
        g = None if other is None else gain(other, s.course_rate, s.moving)
        if g is not None and abs(g.correlation) >= MIN_CORRELATION:
            return s.course_rate
    return None


def check_gyro(streams: Streams, s: Signals) -> Iterator[tuple[Finding, Streams]]:
    """Yield the finding on sign and unit of the gyro, with the streams corrected."""
    if s.gyro is None:
        if streams.imu is not None:
            yield not_decidable("w_z", "the IMU reports no yaw rate that varies"), streams
        return
    if s.heading_rate is not None:
        yield from _channel(streams, "imu", "w_z", s.gyro, s.heading_rate, s, _HEADING, ("deg",))
        return
    by_course = None if s.course_rate is None else gain(s.gyro, s.course_rate, s.moving)
    if by_course is not None and abs(by_course.correlation) >= MIN_CORRELATION:
        yield from _channel(streams, "imu", "w_z", s.gyro, s.course_rate, s, _COURSE, ("deg",))
        return
    if s.yaw_rate is None:
        yield not_decidable("w_z", "odometry has neither a pose nor a yaw rate"), streams
        return
    g = gain(s.gyro, s.yaw_rate, s.moving)
    if g is not None and g.correlation <= -MIN_CORRELATION:
        reason = "its sign is opposite to odometry's yaw rate, and no pose says which is right"
        evidence = f"ratio of the gyro's yaw rate to odometry's: {g.value:.3g}"
        yield not_decidable("w_z", reason, evidence), streams
        return
    if g is not None and unit_of(1.0 / g.value, ("deg",)) is not None:
        # Of two yaw rates the one 57.3 times the other is in degrees.
        yield from _channel(
            streams, "odometry", "yaw_rate", s.yaw_rate, s.gyro, s, "the gyro", ("deg",)
        )
        return
    yield from _channel(streams, "imu", "w_z", s.gyro, s.yaw_rate, s, _YAW_RATE, ("deg",))


_HEADING, _YAW_RATE = "the rate of its heading", "odometry's yaw rate"
_COURSE = "the course of its position"
_PARAMETERS = {"v_x": "odometry_scale", "yaw_rate": "yaw_rate_scale", "w_z": "gyro_scale"}
_TITLES = {
    "v_x": "odometry's v_x",
    "heading": "the heading of the pose",
    "yaw_rate": "odometry's yaw rate",
    "w_z": "the gyro's yaw rate",
}


def _channel(
    streams: Streams,
    stream_name: str,
    column: str,
    values: FloatArray | None,
    reference: FloatArray | None,
    s: Signals,
    reference_name: str,
    units: Sequence[str],
) -> Iterator[tuple[Finding, Streams]]:
    """Yield the finding on one channel, with the streams corrected for it."""
    title = _TITLES[column]
    evidence = f"ratio of {title} to {reference_name}"
    if values is None or reference is None:
        return
    g = gain(values, reference, s.moving)
    if g is None or abs(g.correlation) < MIN_CORRELATION:
        correlation = 0.0 if g is None else g.correlation
        reason = f"its correlation with {reference_name} is {correlation:.2f}: too little driving"
        if s.moving_s > 60.0 and g is not None and column != "w_z":
            reason = (
                f"its correlation with {reference_name} is {correlation:.2f}: too little "
                "excitation, or one of them is wrong"
            )
        yield not_decidable(column, reason, evidence), streams
        return
    evidence += f": {g.value:.3g}, correlation {g.correlation:.3f}, {s.moving_s:.0f} s"
    factor = 1.0
    texts = []
    if g.value < 0.0:
        factor = -1.0
        texts.append(f"{title} has its sign flipped against {reference_name}")
    unit = unit_of(g.value, units)
    if unit is not None:
        factor *= UNIT_FACTORS[unit]
        texts.append(f"{title} is {abs(g.value):.3g} times {reference_name}: it looks like {unit}")
    if not texts:
        text = f"sign and unit as {reference_name}, ratio {g.value:.3g}"
        yield ok(column, text, evidence), streams
        return
    stream = streams.of(stream_name)
    if stream is not None:
        corrected = stream.having(**{column: stream[column] / factor})
        streams = streams.with_stream(stream_name, corrected)
    parameter = _PARAMETERS.get(column)
    # A v_x with a flipped sign is that of a turned frame: v_y would be flipped as well.
    known = parameter is not None and (factor > 0.0 or column != "v_x")
    proposal = {parameter: factor} if known and parameter is not None else {}
    yield found(column, "; ".join(texts), evidence, proposal), streams
