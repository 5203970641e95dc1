# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Heading and sideslip of odometry against the direction of a satellite receiver's velocity.

With the heading psi (REP-103: from east to the left), the sideslip beta = atan2(v_y, v_x), the yaw
rate r and the speed v, the direction chi of the velocity of an antenna that lies x ahead of
odometry's reference point and that reports tau late is

    chi(t + tau) = psi + beta + x r / v + offset + drift t + noise / v,

where tau is found by a search; what is left of it is a column with the rate of psi + beta. Where
v_y is not measured, beta = l r / v - K r v (steady state of a single-track model) adds a column
r v. The noise of the velocity across its direction, m/s, follows from the
residuals; only speeds at which it is an angle of less than the smallest material one are used.

A pose with a position has a direction chi_p of its motion. chi - chi_p tells by how much its frame
is turned from east, which for a local frame is no error; the heading is then compared in that
frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from adk_ros.calibration.course_angles import (
    HEADING,
    Course,
    centred,
    course_of,
    least_speed,
    without_delay,
)
from adk_ros.calibration.criteria import (
    LONGER_BLOCKS_S,
    MATERIAL,
    MAX_COPY,
    MIN_CORRELATION,
    SIGNIFICANCE,
)
from adk_ros.calibration.finding import Finding, Verdict, found, judged, not_decidable, undecided
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.regression import Estimate, regress
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.decode import SensorConfig

_SIDESLIP = "gps_sideslip"
_LARGEST_NOISE = f"{np.degrees(MATERIAL[HEADING].size):.0f}°"
_MAX_MOUNTING = np.radians(10.0)
"""rad; largest offset of a heading that is no turned frame: above the declination of a compass
and the convergence of a map grid in most places. By choice."""
_REMEDY = (
    "no parameter for this: correct the mounting of the heading's sensor or its reference (true, "
    "magnetic or grid north), as v_y is off by v_x times this angle if it has the same axes"
)


def check_course(s: Signals, gps: Stream | None, sensors: SensorConfig) -> Iterator[Finding]:
    """
    Yield the offset of odometry's heading and the gain of its sideslip, where a course is there.

    :param gps: speed over ground in the column "gps_speed", m/s, and its direction in
        "gps_course", rad, clockwise from north. Without it, or without a heading, nothing.
    """
    c = None if gps is None else course_of(s, gps)
    if gps is None or c is None or not c.weights.any():
        return
    raw, centre, agreement = centred(c.course - c.heading, c.weights)
    if agreement < MIN_CORRELATION:
        yield _apart(c, agreement)
        return
    if float(c.weights @ raw**2) < MAX_COPY * float(c.weights.sum()):
        yield not_decidable(HEADING, "the heading is the direction of the GPS velocity itself")
        return
    c = without_delay(s, gps, c)
    limit, noise = least_speed(c)
    fast = replace(c, weights=c.weights * (c.speed >= limit))
    if not fast.weights.any():
        reason = (
            f"the GPS velocity scatters by {noise:.2f} m/s across the heading, which is less than "
            f"{_LARGEST_NOISE} from {limit:.0f} m/s on only: the car is slower"
        )
        yield not_decidable(HEADING, reason)
        return
    compared = "the heading and the sideslip" if c.has_v_y else "the heading"
    slip = "" if c.has_v_y else ", sideslip"
    evidence = (
        f"direction of the GPS velocity less {compared} from {limit:.1f} m/s on, where its "
        f"scatter of {noise:.2f} m/s is less than {_LARGEST_NOISE}; columns for delay, lever arm "
        f"of the antenna{slip} and drift"
    )
    yield _heading(fast, evidence)
    yield from _sideslip(fast, s, sensors, centre, evidence)


def _apart(c: Course, agreement: float) -> Finding:
    """Return what to say of a course that does not follow the heading."""
    opposite = centred(c.course + c.heading, c.weights)[2]
    evidence = "mean direction of the GPS velocity less the heading"
    if opposite > MIN_CORRELATION:
        text = "heading and direction of the GPS velocity turn in opposite directions"
        remedy = "headings count to the left (REP-103), courses clockwise: correct one's sign"
        return found(HEADING, text, evidence, remedy=remedy)
    reason = f"the GPS velocity does not follow the heading (agreement {agreement:.2f})"
    return not_decidable(HEADING, reason, evidence)


def _heading(c: Course, evidence: str) -> Finding:
    """Return the offset of the heading, in the frame of the pose if that is turned from east."""
    error = _offset(c, c.heading + c.sideslip - c.course)
    if error is None:
        seconds = float((c.weights > 0.0).sum()) * c.period_s
        return not_decidable(HEADING, f"{seconds:.0f} s of such driving are too few", evidence)
    frame = None
    if c.path is not None and centred(c.path - c.heading, c.weights)[2] > MIN_CORRELATION:
        frame = _offset(c, c.path - c.course)
    size, note = MATERIAL[HEADING].size, ""
    if frame is not None and abs(frame.value) >= max(size, SIGNIFICANCE * frame.standard_error):
        assert c.path is not None
        note = (
            f"; the frame of the pose is turned by {_degrees(frame)} against east, which is no "
            "error of a local frame"
        )
        error = _offset(c, c.heading + c.sideslip - c.path) or error
    quarter = round(error.value / (0.5 * np.pi))
    if abs(error.value - quarter * 0.5 * np.pi) > _MAX_MOUNTING:
        if frame is None:
            reason = "a heading without a position may be that of a frame that is turned, by"
            return not_decidable(HEADING, f"{reason} {_degrees(error)}", evidence)
    elif quarter:
        note += f"; it looks like another convention, whose zero is {-90 * quarter}° from east"
    text = f"the heading is turned by {_degrees(error)}, positive to the left: offset"
    finding = judged(HEADING, error, 0.0, text, evidence, remedy=_REMEDY)
    return replace(finding, text=finding.text + note)


def _offset(c: Course, angles: FloatArray) -> Estimate | None:
    values, centre, _ = centred(angles, c.weights)
    estimate = _widest(c, c.columns(), values)
    return None if estimate is None else estimate.shifted(centre)


def _widest(c: Course, columns: FloatArray, values: FloatArray) -> Estimate | None:
    """Return the first coefficient, its interval from the blocks that make it widest."""
    fits = [
        regress(columns, values, c.weights, period_s=c.period_s, block_s=block_s)
        for block_s in LONGER_BLOCKS_S
    ]
    estimates = [
        replace(fit.estimate(0), seconds=float((c.weights > 0.0).sum()) * c.period_s)
        for fit in fits
        if fit is not None
    ]
    return max(estimates, key=lambda x: x.standard_error, default=None)


def _degrees(x: Estimate) -> str:
    value, low, high = np.degrees([x.value, x.low, x.high])
    return f"{value:.1f}° ({low:.1f} to {high:.1f})"


def _sideslip(
    c: Course, s: Signals, sensors: SensorConfig, centre: float, evidence: str
) -> Iterator[Finding]:
    """Yield the gain of odometry's sideslip, or of its estimate where v_y is not measured."""
    length, kappa = sensors.sideslip
    slip = -c.yaw_rate * c.speed
    known = c.sideslip if c.has_v_y else (kappa or 1.0) * slip
    others = c.columns()[:, :4]
    angles = np.angle(np.exp(1j * (c.course - c.heading - centre)))
    gain = _widest(c, np.column_stack([known, others]), angles)
    if gain is None:
        return
    correlation = _partial(known, angles, others, c.weights)
    about = f"; correlation {correlation:.2f}"
    if not c.has_v_y and not kappa:
        number = f"{gain.value:.4f} ({gain.low:.4f} to {gain.high:.4f}) rad s²/m"
        if gain.low <= 0.0:
            reason = f"the slip per lateral acceleration is {number}"
            yield not_decidable(_SIDESLIP, reason, evidence)
            return
        text = (
            f"v_y is not measured; the slip per lateral acceleration is {number}: second value of "
            f"the parameter `sideslip`{about}"
        )
        yield Finding(
            _SIDESLIP, Verdict.OK, text, gain.value, gain.low, gain.high, "rad s²/m",
            evidence=evidence, seconds=gain.seconds,
        )  # fmt: skip
        return
    title = f"sideslip by GPS over that by {'v_y' if c.has_v_y else 'the parameter `sideslip`'}"
    parameters = {} if c.has_v_y else {"sideslip": [length, round(kappa * gain.value, 5)]}
    remedy = "no parameter for this: correct v_y of odometry"
    finding = judged(_SIDESLIP, gain, 1.0, title, evidence, parameters=parameters, remedy=remedy)
    if abs(gain.value) < MATERIAL[_SIDESLIP].size and finding.verdict is Verdict.FINDING:
        reason = f"a heading that follows the course has no sideslip (ratio {gain.value:.2f})"
        yield undecided(finding, reason)
        return
    start = f"{title}: " if finding.verdict is Verdict.OK else ""
    yield replace(finding, text=f"{start}{finding.text}{about}")


def _partial(x: FloatArray, y: FloatArray, others: FloatArray, weights: FloatArray) -> float:
    """Return the correlation of x and y (n,) without what other columns (n, k) explain."""
    root = np.sqrt(weights)[:, None]
    pair = np.column_stack([x, y]) * root
    left = pair - others * root @ np.linalg.lstsq(others * root, pair, rcond=None)[0]
    power = np.sqrt((left**2).sum(axis=0))
    return float(left[:, 0] @ left[:, 1] / max(float(power.prod()), 1e-300))
