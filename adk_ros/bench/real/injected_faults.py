# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Inject faults of sensors and steering into the messages of a recording, as a faulty sensor would.

They act on the readings and stamps as recorded, before any processing. Conventions of sign are
those of the calibration: a steering ratio is the steer joint's angle over the road-wheel angle,
a positive clock offset is a command that acts later than its stamp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY

Injection = Callable[[Streams, float], Streams]
_RATE_WINDOW_S = 0.2
"""s: window in which a yaw rate is differentiated for a lever arm; a car's yaw response is slower
(below 2 Hz), and the noise of a gyro is not multiplied."""


def _stream(streams: Streams, name: str) -> Stream:
    found = streams.of(name)
    assert found is not None, name
    return found


def _scaled(stream: str, *columns: str) -> Injection:
    def inject(streams: Streams, size: float) -> Streams:
        old = _stream(streams, stream)
        return streams.with_stream(
            stream, old.having(**{name: size * old[name] for name in columns})
        )

    return inject


def _added(stream: str, column: str) -> Injection:
    def inject(streams: Streams, size: float) -> Streams:
        old = _stream(streams, stream)
        return streams.with_stream(stream, old.having(**{column: old[column] + size}))

    return inject


def _late(stream: str, sign: float) -> Injection:
    def inject(streams: Streams, size: float) -> Streams:
        old = _stream(streams, stream)
        return streams.with_stream(stream, replace(old, at_s=old.at_s + sign * size))

    return inject


def _tilted(column: str, gyro: str) -> Injection:
    """Inject a roll (a_y, w_y) or a pitch (a_x, w_x) of the IMU in its mounting."""

    def inject(streams: Streams, size: float) -> Streams:
        imu = _stream(streams, "imu")
        c, n = np.cos(size), np.sin(size)
        sign = 1.0 if column == "a_y" else -1.0
        out: dict[str, FloatArray] = {}
        for level, vertical, missing in ((column, "a_z", GRAVITY), (gyro, "w_z", 0.0)):
            up = imu[vertical] if imu.has(vertical) else np.full_like(imu[column], missing)
            across = imu[level] if imu.has(level) else np.zeros_like(up)
            if imu.has(level):
                out[level] = c * across + sign * n * up
            if imu.has(vertical):
                out[vertical] = c * up - sign * n * across
        return replace(streams, imu=imu.having(**out))

    return inject


def _displaced(ahead: float, left: float) -> Injection:
    """Inject an IMU that sits `size` m ahead or to the left of where it was."""

    def inject(streams: Streams, size: float) -> Streams:
        imu = _stream(streams, "imu")
        x, y = ahead * size, left * size
        r = imu["w_z"]
        rows = max(5, 2 * round(0.5 * _RATE_WINDOW_S / imu.period_s) + 1)
        turning = savgol_filter(r, rows, 3)
        rate = np.gradient(turning, imu.at_s)
        return replace(
            streams,
            imu=imu.having(
                a_x=imu["a_x"] - rate * y - turning**2 * x,
                a_y=imu["a_y"] + rate * x - turning**2 * y,
            ),
        )

    return inject


def _low_passed(streams: Streams, size: float) -> Streams:
    """Inject a first-order low-pass of odometry's yaw rate, exact for linear interpolation."""
    old = _stream(streams, "odometry")
    given = old["yaw_rate"]
    out = np.array(given)
    for i in range(1, out.size):
        h = old.at_s[i] - old.at_s[i - 1]
        keep = np.exp(-h / size)
        share = size / h * (1.0 - keep)
        out[i] = keep * out[i - 1] + (share - keep) * given[i - 1] + (1.0 - share) * given[i]
    return streams.with_stream("odometry", old.having(yaw_rate=out))


INJECTIONS: dict[str, Injection] = {
    "imu_bias.a_x": _added("imu", "a_x"),
    "imu_bias.a_y": _added("imu", "a_y"),
    "imu_bias.gyro": _added("imu", "w_z"),
    "imu_tilt.roll": _tilted("a_y", "w_y"),
    "imu_tilt.pitch": _tilted("a_x", "w_x"),
    "imu_lever_arm.x": _displaced(1.0, 0.0),
    "imu_lever_arm.y": _displaced(0.0, 1.0),
    "imu_delay": _late("imu", 1.0),
    "odometry_scale": _scaled("odometry", "v_x", "v_y"),
    "gyro_scale": _scaled("imu", "w_z"),
    "odometry_filter": _low_passed,
    "clock_offset": _late("command", -1.0),
    "steering_offset": _added("command", "steering"),
    "steering_ratio": _scaled("command", "steering"),
}
"""How to inject a fault, by its label in `calibration.faults`."""
