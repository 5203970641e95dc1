# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The streams on a common grid, smoothed alike, with weights that exclude unusable samples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.criteria import GUARD_S, PERIOD_S
from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.differentiation import savitzky_golay
from adk_ros.signals.moving_speed import moving_speed


@dataclass(frozen=True)
class Signals:
    """
    Signals (n,) on a grid of `PERIOD_S`, each smoothed with the same filter; SI.

    Channels that the recording lacks are None. `heading_rate`, `forward` and `leftward`: the rate
    of the pose's heading and the velocity of its position along and across the heading.
    `a` (3, n), `w` (3, n): the axes of the IMU. `torque`, `steering`: the commands as held until
    the next, before smoothing. `moving` (n,): weight 1 where the car moves and every stream is
    present and alive, else 0.
    """

    at_s: FloatArray
    moving: FloatArray
    v_x: FloatArray | None = None
    v_y: FloatArray | None = None
    yaw_rate: FloatArray | None = None
    heading: FloatArray | None = None
    heading_rate: FloatArray | None = None
    course_rate: FloatArray | None = None
    forward: FloatArray | None = None
    leftward: FloatArray | None = None
    x: FloatArray | None = None
    y: FloatArray | None = None
    a: FloatArray | None = None
    w: FloatArray | None = None
    torque: FloatArray | None = None
    steering: FloatArray | None = None

    @property
    def moving_s(self) -> float:
        """Time of usable driving, s."""
        return float(self.moving.sum()) * PERIOD_S

    @property
    def turning(self) -> FloatArray | None:
        """Best yaw rate (n,) that is no command: of the pose, else the gyro, else odometry's."""
        if self.heading_rate is not None:
            return self.heading_rate
        return self.yaw_rate if self.gyro is None else self.gyro

    @property
    def gyro(self) -> FloatArray | None:
        """Yaw rate (n,) of the IMU; None if it has none that varies."""
        return None if self.w is None or float(np.ptp(self.w[2])) == 0.0 else self.w[2]

    @property
    def lateral(self) -> FloatArray | None:
        """Lateral acceleration (n,), v_x r + dv_y/dt, of the odometry."""
        if self.v_x is None or self.turning is None:
            return None
        sideways = 0.0 if self.v_y is None else np.gradient(self.v_y, PERIOD_S)
        return np.asarray(self.v_x * self.turning + sideways)

    @property
    def longitudinal(self) -> FloatArray | None:
        """Longitudinal acceleration (n,), dv_x/dt - v_y r, of the odometry."""
        if self.v_x is None:
            return None
        out = np.gradient(self.v_x, PERIOD_S)
        if self.v_y is not None and self.turning is not None:
            out = out - self.v_y * self.turning
        return np.asarray(out)


def smooth(values: FloatArray, window_s: float = 0.5) -> FloatArray:
    """Return values on the grid, smoothed without a phase shift; a constant exactly as it is."""
    if values.size and np.ptp(values) == 0.0:
        # Checks ask whether an axis varies, such as the zeros of a missing gyro less a known bias.
        return values
    return savitzky_golay(values, PERIOD_S, window_s)


def slowest_driving(v_x: FloatArray) -> float:
    """Return the speed below which a car of this speed range stands or manoeuvres, m/s."""
    return moving_speed(float(np.percentile(np.abs(v_x), 95.0)) if v_x.size else 0.0)


def by_speed(s: Signals) -> FloatArray:
    """Return weights (n,) of usable samples in proportion to v_x², at most 1."""
    if s.v_x is None or not s.moving.any():
        return s.moving
    usual = float(np.percentile(np.abs(s.v_x[s.moving > 0.0]), 75))
    return np.asarray(s.moving * np.minimum((s.v_x / max(usual, 1e-9)) ** 2, 1.0))


def shifted(values: FloatArray, later_s: float) -> FloatArray:
    """Return values on the grid, later by `later_s`."""
    at = np.arange(values.shape[0], dtype=np.float64)
    return np.asarray(np.interp(at - later_s / PERIOD_S, at, values))


def on_grid(streams: Streams, unusable: Iterable[tuple[float, float]]) -> Signals | None:
    """
    Return the signals on the time that all streams cover.

    None if they do not overlap, or if there is none.

    :param unusable: intervals (s) of gaps, frozen readings and jumps, which get weight zero
        together with `GUARD_S` around them.
    """
    present = streams.present()
    if not present:
        return None
    begin = max(float(x.at_s[0]) for x in present)
    end = min(float(x.at_s[-1]) for x in present)
    at = np.arange(begin, end, PERIOD_S)
    if at.size < 2:
        return None
    moving = np.ones(at.size)
    for first, last in unusable:
        moving[(at > first - GUARD_S) & (at < last + GUARD_S)] = 0.0
    edge = round(GUARD_S / PERIOD_S)
    moving[:edge] = moving[-edge:] = 0.0
    signals = Signals(at, moving)
    if streams.odometry is not None:
        signals = _with_odometry(signals, streams.odometry)
    if streams.imu is not None:
        signals = _with_imu(signals, streams.imu)
    if streams.command is not None:
        signals = _with_command(signals, streams.command)
    return signals


def _column(at: FloatArray, stream: Stream, name: str) -> FloatArray | None:
    return smooth(np.interp(at, stream.at_s, stream[name])) if stream.has(name) else None


def _with_odometry(s: Signals, odometry: Stream) -> Signals:
    v_x = _column(s.at_s, odometry, "v_x")
    x, y, heading = (_column(s.at_s, odometry, name) for name in ("x", "y", "heading"))
    moving = s.moving if v_x is None else s.moving * (np.abs(v_x) > slowest_driving(v_x))
    out = replace(
        s,
        moving=np.asarray(moving, dtype=np.float64),
        v_x=v_x,
        v_y=_column(s.at_s, odometry, "v_y"),
        yaw_rate=_column(s.at_s, odometry, "yaw_rate"),
        heading=heading,
        heading_rate=None if heading is None else np.gradient(heading, PERIOD_S),
    )
    if x is None or y is None:
        return out
    rate_x, rate_y = np.gradient(x, PERIOD_S), np.gradient(y, PERIOD_S)
    course = np.unwrap(np.arctan2(smooth(rate_y, 1.0), smooth(rate_x, 1.0)))
    # Turned by pi when reversing: the rate is the same but for the instant of the change.
    course_rate = np.clip(np.gradient(smooth(course, 1.0), PERIOD_S), -2.0, 2.0)
    out = replace(out, x=x, y=y, course_rate=course_rate)
    if v_x is None:
        speed = np.hypot(rate_x, rate_y)
        out = replace(out, moving=out.moving * (speed > slowest_driving(speed)))
    if heading is None:
        return out
    c, n = np.cos(heading), np.sin(heading)
    return replace(out, forward=rate_x * c + rate_y * n, leftward=rate_y * c - rate_x * n)


def _with_imu(s: Signals, imu: Stream) -> Signals:
    def axes(names: tuple[str, ...]) -> FloatArray | None:
        if not any(imu.has(name) for name in names):
            return None
        # An axis that is not reported is zero throughout.
        values = (np.nan_to_num(imu[name]) for name in names)
        return np.vstack([smooth(np.interp(s.at_s, imu.at_s, each)) for each in values])

    return replace(s, a=axes(("a_x", "a_y", "a_z")), w=axes(("w_x", "w_y", "w_z")))


def _with_command(s: Signals, command: Stream) -> Signals:
    # A command is held until the next: its value at a time is that of the last stamp.
    latest = np.maximum(np.searchsorted(command.at_s, s.at_s, side="right") - 1, 0)
    torque = command["torque"][latest] if command.has("torque") else None
    steering = command["steering"][latest] if command.has("steering") else None
    return replace(s, torque=torque, steering=steering)
