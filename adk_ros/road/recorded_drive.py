# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the estimate of the road needs of a recording, on common time steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.differentiation import savitzky_golay

Interval = tuple[float, float]
"""Begin and end, s."""

MIN_STEPS = 25
"""Steps of a moving car from which the road has a profile: 5 s. By choice."""
STEP_S = 0.2
"""Time step, s. A grade that changes within two steps (2.5 Hz) is a bump: below the wavelength of
50 m that ISO 8608 takes for the profile of a road at any speed above 20 m/s."""
PERIODS_PER_STEP = 2.0
"""Messages of odometry in a step, at least: fewer would leave steps without a reading."""


@dataclass(frozen=True)
class RecordedDrive:
    """
    Streams of a drive in SI units, each with stamps in s.

    `odometry_at_s` (m,) with `v_x`, `yaw_rate` and, where measured, `v_y`, `x`, `y`, `heading`
    (m,), the heading without jumps of 2 pi; `imu_at_s` (k,) with the specific force `a_x`, `a_y`
    (k,), gravity included, in the axes of the vehicle (REP-103). `unusable`: intervals with gaps
    or faulty readings.
    """

    odometry_at_s: FloatArray
    v_x: FloatArray
    yaw_rate: FloatArray
    imu_at_s: FloatArray
    a_x: FloatArray
    a_y: FloatArray
    v_y: FloatArray | None = None
    x: FloatArray | None = None
    y: FloatArray | None = None
    heading: FloatArray | None = None
    unusable: tuple[Interval, ...] = ()


@dataclass(frozen=True)
class Steps:
    """
    A drive at n nodes, `step_s` apart, and on the n - 1 steps between them; SI units.

    (n,): `at_s`; `distance` driven from the start, backwards as well as ahead; `v_x`, `v_y`, mean
    reading around the node; `readings`, how many, zero where the node is not used; `yaw_rate`;
    `longitudinal` and `lateral` acceleration by odometry, dv_x/dt - r v_y and dv_y/dt + r v_x;
    `x`, `y`, `heading`, or None. (n - 1,): `used`, whether a step joins two used nodes; integrals
    over the step: `force_x`, `force_y` of a_x, a_y; `turn_x`, `turn_y` of r v_y, r v_x;
    `yaw_rate_2` of r².
    """

    step_s: float
    at_s: FloatArray
    distance: FloatArray
    v_x: FloatArray
    v_y: FloatArray
    readings: IntArray
    used: BoolArray
    yaw_rate: FloatArray
    longitudinal: FloatArray
    lateral: FloatArray
    force_x: FloatArray
    force_y: FloatArray
    turn_x: FloatArray
    turn_y: FloatArray
    yaw_rate_2: FloatArray
    x: FloatArray | None
    y: FloatArray | None
    heading: FloatArray | None


def in_steps(drive: RecordedDrive, standing_speed: float) -> Steps | None:
    """
    Return a drive in steps; None if IMU and odometry overlap for less than three steps.

    :param standing_speed: m/s; slower nodes are not used.
    """
    odometry, imu = drive.odometry_at_s, drive.imu_at_s
    if odometry.size < 2 or imu.size < 2:
        return None
    step = max(STEP_S, PERIODS_PER_STEP * float(np.median(np.diff(odometry))))
    begin, end = max(odometry[0], imu[0]), min(odometry[-1], imu[-1])
    if end - begin < 3.0 * step:
        return None
    at = np.arange(begin, end - 0.5 * step, step) + 0.5 * step
    nearest = np.rint((odometry - at[0]) / step).astype(np.int64)
    inside = (nearest >= 0) & (nearest < at.size)
    readings = np.bincount(nearest[inside], minlength=at.size)
    offsets = np.bincount(
        nearest[inside], odometry[inside] - at[nearest[inside]], minlength=at.size
    )
    late = offsets / np.maximum(readings, 1)

    def mean(values: FloatArray) -> FloatArray:
        sums = np.bincount(nearest[inside], values[inside], minlength=at.size)
        means = np.where(
            readings > 0, sums / np.maximum(readings, 1), np.interp(at, odometry, values)
        )
        # The stamps around a node are not centred on it.
        return np.asarray(means - late * np.gradient(means, step))

    def integral(stamps: FloatArray, values: FloatArray) -> FloatArray:
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(stamps)
        total = np.concatenate([[0.0], np.cumsum(steps)])
        return np.diff(np.interp(at, stamps, total))

    v_y = np.zeros_like(drive.v_x) if drive.v_y is None else drive.v_y
    v_x = mean(drive.v_x)
    is_used = (readings > 0) & (np.abs(v_x) > standing_speed)
    for first, last in drive.unusable:
        is_used &= (at < first - 0.5 * step) | (at > last + 0.5 * step)
    speed = integral(odometry, np.abs(drive.v_x))
    r = drive.yaw_rate

    means = mean(v_y)
    rate = mean(r)

    def at_nodes(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else np.interp(at, odometry, values)

    return Steps(
        step,
        at,
        np.concatenate([[0.0], np.cumsum(speed)]),
        v_x,
        means,
        np.where(is_used, readings, 0),
        is_used[1:] & is_used[:-1],
        rate,
        _rate_of_change(v_x, step) - rate * means,
        _rate_of_change(means, step) + rate * v_x,
        integral(imu, drive.a_x),
        integral(imu, drive.a_y),
        integral(odometry, r * v_y),
        integral(odometry, r * drive.v_x),
        integral(odometry, r**2),
        at_nodes(drive.x),
        at_nodes(drive.y),
        at_nodes(drive.heading),
    )


def middle(values: FloatArray) -> FloatArray:
    """Return the mean (n - 1,) of values (n,) over each step."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def _rate_of_change(values: FloatArray, step_s: float) -> FloatArray:
    return np.asarray(np.gradient(savitzky_golay(values, step_s, 1.0), step_s))
