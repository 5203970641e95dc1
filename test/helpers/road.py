# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives over hills by the equations of motion of a point, with noise, for the road profile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.streams import Stream, Streams
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.road.recorded_drive import RecordedDrive

Profile = Callable[[FloatArray], FloatArray]
"""Angle, rad, by distance, m."""
Path = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""x, y, heading by distance."""


@dataclass(frozen=True, eq=False)
class Hilly:
    """A drive: `drive`, with stamps `at_s` (n,), s, and true `grade`, `bank` (n,), rad."""

    drive: RecordedDrive
    at_s: FloatArray
    grade: FloatArray
    bank: FloatArray


def flat(distance: FloatArray) -> FloatArray:
    """Return no slope."""
    return np.zeros_like(distance)


def hills(distance: FloatArray) -> FloatArray:
    """Return hills of 6 and 2 %, with a mean of zero over 600 m."""
    return np.asarray(
        0.06 * np.sin(2 * np.pi * distance / 300.0) + 0.02 * np.cos(2 * np.pi * distance / 120.0)
    )


def straight(distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a straight path along x."""
    return distance, np.zeros_like(distance), np.zeros_like(distance)


def circle(distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return laps of 600 m."""
    radius = 600.0 / (2.0 * np.pi)
    angle = distance / radius
    return radius * np.sin(angle), radius * (1.0 - np.cos(angle)), angle


def hilly(
    grade: Profile = hills,
    path: Path = straight,
    seconds: float = 120.0,
    *,
    bank: Profile = flat,
    seed: int = 0,
    offset: float = 0.0,
    body: float = 0.04,
    swing: float = 4.0,
) -> Hilly:
    """
    Return a drive at 12 m/s on average.

    :param offset: of a_x and a_y, m/s². :param body: share of the force that body pitch adds.
    :param swing: amplitude of the speed, m/s.
    """
    rng = np.random.default_rng(seed)
    at = np.arange(0.0, seconds, 0.01)
    rate = 2.0 * np.pi / 17.0
    v = 12.0 + swing * np.sin(rate * at)
    change = swing * rate * np.cos(rate * at)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * 0.01)])
    x, y, heading = path(distance)
    r = np.gradient(heading, at)
    up, left_up = grade(distance), bank(distance)
    a_x = (1.0 + body) * (change + GRAVITY * np.sin(up)) + offset
    a_y = 1.07 * (v * r + GRAVITY * np.sin(left_up)) + offset
    o = slice(None, None, 2)

    def noisy(values: FloatArray, sigma: float) -> FloatArray:
        return np.asarray(values + sigma * rng.standard_normal(values.size))

    drive = RecordedDrive(
        at[o],
        noisy(v[o], 0.02),
        noisy(r[o], 0.002),
        at,
        noisy(a_x, 0.05),
        noisy(a_y, 0.05),
        noisy(np.zeros(at[o].size), 0.02),
        noisy(x[o], 0.02),
        noisy(y[o], 0.02),
        noisy(heading[o], 0.002),
    )
    return Hilly(drive, at, up, left_up)


def as_streams(hilly: Hilly, attitude: bool = False) -> Streams:
    """Return a drive as streams of a recording, with a command that fits the accelerations."""
    d = hilly.drive
    assert d.v_y is not None
    assert d.x is not None
    assert d.y is not None
    assert d.heading is not None
    rng = np.random.default_rng(1)
    k = d.imu_at_s.size
    imu = {
        "a_x": d.a_x,
        "a_y": d.a_y,
        "a_z": GRAVITY + 0.05 * rng.standard_normal(k),
        "w_x": 0.002 * rng.standard_normal(k),
        "w_y": 0.002 * rng.standard_normal(k),
        "w_z": np.interp(d.imu_at_s, d.odometry_at_s, d.yaw_rate),
    }
    odometry = {
        "v_x": d.v_x,
        "v_y": d.v_y,
        "yaw_rate": d.yaw_rate,
        "x": d.x,
        "y": d.y,
        "heading": d.heading,
    }
    o = slice(None, None, 4)
    command = {"torque": 450.0 * d.a_x[o], "steering": 2.7 * d.yaw_rate[::2] / d.v_x[::2]}
    ins = Stream("the attitude", hilly.at_s, {"roll": hilly.bank, "pitch": -hilly.grade})
    return Streams(
        "drive",
        float(d.imu_at_s[-1]),
        Stream("the IMU", d.imu_at_s, imu),
        Stream("odometry", d.odometry_at_s, odometry),
        Stream("the command", d.imu_at_s[o], command),
        attitude=ins if attitude else None,
    )


def with_height(
    hilly: Hilly,
    source: str = "gps",
    *,
    factor: float = 1.0,
    rate_hz: float = 10.0,
    noise: float = 0.1,
    drift: float = 0.0,
    delay_s: float = 0.0,
    seed: int = 7,
) -> Streams:
    """
    Return a drive as streams of a recording with a height.

    :param noise: of each height, m. :param drift: random walk of the height, m after one second.
    """
    d, streams = hilly.drive, as_streams(hilly)
    rng = np.random.default_rng(seed)
    v_x = np.interp(hilly.at_s, d.odometry_at_s, d.v_x)
    true = np.cumsum(v_x * np.sin(hilly.grade)) * float(hilly.at_s[1] - hilly.at_s[0])
    at = np.arange(1.0, hilly.at_s[-1], 1.0 / rate_hz)
    height = 350.0 + factor * np.interp(at - delay_s, hilly.at_s, true)
    height += noise * rng.standard_normal(at.size)
    height += drift / np.sqrt(rate_hz) * np.cumsum(rng.standard_normal(at.size))
    return replace(streams, heights={source: Stream("the height", at, {"height": height})})
