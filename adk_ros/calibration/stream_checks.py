# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Presence, rate, order, gaps and frozen readings of the streams, standing share, pose jumps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adk_ros.calibration.continuity import Interval, frozen, gaps, pose_jumps
from adk_ros.calibration.criteria import (
    GUARD_S,
    MAX_STANDING_SHARE,
    MIN_MOVING_S,
    MIN_RATE_HZ,
)
from adk_ros.calibration.finding import Finding, found, not_decidable, ok
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.moving_speed import STANDING_SPEED

_REMEDY_RECORD = "record it, or leave out what depends on it"
_OPTIONAL = {"x", "y", "heading", "a_z", "w_x", "w_y"}
"""Channels that may be absent without a finding: nothing depends on them alone."""


@dataclass(frozen=True)
class StreamFaults:
    """Findings on the streams, and the intervals (s) that the other checks must not use."""

    findings: list[Finding]
    unusable: list[Interval]


def check_streams(streams: Streams, size: float = 1.0) -> StreamFaults:
    """
    Return the findings on every stream and the intervals without usable readings.

    :param size: scale of the car's lengths (`numerics.similarity`).
    """
    findings: list[Finding] = []
    unusable: list[Interval] = []
    for name in ("imu", "odometry", "command"):
        stream = streams.of(name)
        if stream is None:
            reason = f"the recording has no {'IMU' if name == 'imu' else name}"
            findings.append(not_decidable(f"{name}_stream", reason))
            continue
        findings += _rate(name, stream)
        findings += _constant(name, stream, streams)
        findings += _interrupted(name, stream, streams, unusable)
    if streams.odometry is not None:
        findings += _standing(streams.odometry)
        findings += _jumps(streams.odometry, unusable, size)
    return StreamFaults(findings, unusable)


def _rate(name: str, stream: Stream) -> Iterator[Finding]:
    rate = 1.0 / stream.period_s
    evidence = f"median of {stream.at_s.size - 1} intervals between stamps"
    if rate < MIN_RATE_HZ:
        text = f"{stream.name} has {rate:.1f} Hz: at least {MIN_RATE_HZ:g} Hz are needed"
        yield found(f"{name}_rate", text, evidence, remedy="record at a higher rate")
    else:
        yield ok(f"{name}_rate", f"{rate:.1f} Hz", evidence)
    if stream.disordered:
        text = (
            f"{stream.disordered} messages of {stream.name} have a stamp that is not later than "
            "the one before"
        )
        remedy = "stamp the messages when they are measured, with one clock"
        yield found(f"{name}_stamps", text, "order of the stamps", remedy=remedy)


def _constant(name: str, stream: Stream, streams: Streams) -> Iterator[Finding]:
    by_gyro = {"yaw_rate"} if streams.imu is not None and streams.imu.has("w_z") else set()
    for column, values in stream.columns.items():
        if stream.has(column) or column in _OPTIONAL | by_gyro:
            continue
        if not np.isfinite(values).all():
            text = f"{column} of {stream.name} is not reported"
        else:
            text = f"{column} of {stream.name} is {values[0] + 0.0:g} throughout: not measured"
        yield found(f"{name}_{column}", text, "range of the channel", remedy=_REMEDY_RECORD)


def _interrupted(
    name: str, stream: Stream, streams: Streams, unusable: list[Interval]
) -> Iterator[Finding]:
    missing = sorted({*gaps(stream), *stream.unknown})
    unusable += missing
    lacking = "messages or values" if stream.unknown else "messages"
    text = _intervals_text(f"{stream.name} has no {lacking}", missing)
    if missing:
        yield found(
            f"{name}_gaps", text, "intervals between stamps", remedy="data there are not used"
        )
    else:
        yield ok(f"{name}_gaps", "no gap", "intervals between stamps")
    if name == "command" or streams.odometry is None:
        # A command may rightly stay the same; without a speed nobody knows what may.
        return
    odometry = streams.odometry
    speed = np.interp(stream.at_s, odometry.at_s, np.abs(odometry["v_x"]))
    still = frozen(stream, np.nan_to_num(speed))
    unusable += still
    evidence = "identical readings in all channels while the car moves"
    if still:
        text = _intervals_text(f"{stream.name} repeats its last reading", still)
        yield found(f"{name}_frozen", text, evidence, remedy="data there are not used")
    else:
        yield ok(f"{name}_frozen", "no frozen readings", evidence)


def _intervals_text(what: str, intervals: list[Interval]) -> str:
    if not intervals:
        return ""
    lengths = [end - begin for begin, end in intervals]
    where = f"from {intervals[0][0]:.1f} s on"
    if len(intervals) == 1:
        return f"{what} for {lengths[0]:.2f} s, {where}"
    return (
        f"{what} in {len(intervals)} intervals, {sum(lengths):.2f} s in all, the longest "
        f"{max(lengths):.2f} s, the first {where}"
    )


def _standing(odometry: Stream) -> Iterator[Finding]:
    speed = _speed(odometry)
    share = float((speed < STANDING_SPEED).mean())
    moving_s = float((speed >= STANDING_SPEED).mean()) * float(np.ptp(odometry.at_s))
    evidence = f"share of odometry messages below {STANDING_SPEED:g} m/s"
    if moving_s < MIN_MOVING_S:
        text = (
            f"the car moves for {moving_s:.1f} s only: at least {MIN_MOVING_S:g} s are needed to "
            "estimate anything"
        )
        yield found("driving", text, evidence, remedy="record a longer drive")
    elif share > MAX_STANDING_SHARE:
        text = f"the car stands for {share:.0%} of the recording"
        yield found("driving", text, evidence, remedy="data there are not used")
    else:
        yield ok("driving", f"{moving_s:.0f} s of driving, {share:.0%} standing", evidence)


def _speed(odometry: Stream) -> FloatArray:
    speed = np.abs(np.nan_to_num(odometry["v_x"]))
    if odometry.has("v_x"):
        return speed
    x, y = (np.gradient(odometry[name], odometry.at_s) for name in ("x", "y"))
    return np.asarray(np.hypot(x, y))


def _jumps(odometry: Stream, unusable: list[Interval], size: float) -> Iterator[Finding]:
    if not (odometry.has("x") and odometry.has("y") and odometry.has("v_x")):
        yield not_decidable("pose_jumps", "odometry has no position or no velocity")
        return
    jumps = pose_jumps(odometry, unusable, size)
    evidence = "step of the pose minus the step of the twist, between messages"
    if not jumps:
        yield ok("pose_jumps", "no pose jump", evidence)
        return
    unusable += [(at - odometry.period_s, at) for at, _, _ in jumps]
    # A single wrong pose is two steps, there and back.
    count = 1 + int((np.diff([each[0] for each in jumps]) > GUARD_S).sum())
    at, distance, angle = max(jumps, key=lambda jump: jump[1] + 10.0 * jump[2])
    times = "once" if count == 1 else f"{count} times"
    text = (
        f"the pose jumps {times}, most at {at:.1f} s: {distance:.2f} m, {np.degrees(angle):.1f}°"
    )
    yield found("pose_jumps", text, evidence, remedy="the drive around each jump is not used")
