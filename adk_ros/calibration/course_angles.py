# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Direction of a satellite receiver's velocity next to heading and sideslip, at its stamps.

The delay of the receiver is the one that leaves least of its direction over heading, sideslip and
the columns of `course`. The noise of its velocity across its direction, m/s, follows from what is
left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.calibration.criteria import (
    LAG_STEP_S,
    MATERIAL,
    MAX_COPY,
    MAX_LAG_S,
    MAX_LATERAL,
    PERIOD_S,
)
from adk_ros.calibration.grid import Signals
from adk_ros.calibration.satellite import where_received
from adk_ros.calibration.streams import Stream
from adk_ros.numerics.arrays import FloatArray

HEADING = "gps_heading"
"""Name of the finding whose material angle noise must not exceed."""


@dataclass(frozen=True)
class Course:
    """
    Angles (n,) and motion (n,) at the stamps of the receiver less its delay, SI.

    `course`, `heading`; `path`: direction of the motion of the position, None without one;
    `sideslip`, zeros where v_y is not measured; `turning`: rate of heading and sideslip; `speed`,
    `yaw_rate`; `weights`: v² where usable.
    """

    at_s: FloatArray
    course: FloatArray
    heading: FloatArray
    path: FloatArray | None
    sideslip: FloatArray
    turning: FloatArray
    speed: FloatArray
    yaw_rate: FloatArray
    weights: FloatArray
    period_s: float
    has_v_y: bool

    def columns(self) -> FloatArray:
        """Return the columns of the offset, the delay, the lever arm, the drift and the slip."""
        ratio = self.yaw_rate / np.maximum(self.speed, 1e-3)
        middle = self.at_s - np.mean(self.at_s)
        out = [np.ones_like(ratio), self.turning, ratio, middle]
        return np.column_stack(out if self.has_v_y else [*out, self.yaw_rate * self.speed])


def course_of(s: Signals, gps: Stream, delay_s: float = 0.0) -> Course | None:
    """Return the angles to compare; None if course, heading or v_x are absent or constant."""
    if s.v_x is None or s.heading is None or s.turning is None or not gps.has("gps_course"):
        return None
    speed = np.hypot(s.v_x, 0.0 if s.v_y is None else s.v_y)
    inside = (gps.at_s >= s.at_s[0]) & (gps.at_s <= s.at_s[-1])
    at = gps.at_s[inside]
    course = 0.5 * np.pi - gps["gps_course"][inside]
    if at.size < 2 or np.ptp(np.cos(course)) + np.ptp(np.sin(course)) < MAX_COPY:
        return None

    def here(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(at - delay_s, s.at_s, values))

    usable = s.moving * where_received(s, gps, speed) * (s.v_x > 0.0)
    if s.v_y is None:
        # Its columns are those of linear tyres.
        usable = usable * (np.abs(s.v_x * s.turning) < MAX_LATERAL)
    path = None
    if s.forward is not None and s.leftward is not None:
        path = here(s.heading) + np.arctan2(here(s.leftward), here(s.forward))
    slip = np.zeros_like(s.v_x) if s.v_y is None else np.arctan2(s.v_y, np.maximum(s.v_x, 1e-3))
    # A stamp between a usable and an unusable sample does not count.
    weights = (here(usable) > 1.0 - 1e-9) * here(speed) ** 2
    weights = weights / max(float(weights.max()), 1e-9)
    return Course(
        at, course, here(s.heading), path, here(slip),
        here(np.gradient(s.heading + slip, PERIOD_S)), here(speed), here(s.turning),
        np.asarray(weights), gps.period_s, s.v_y is not None,
    )  # fmt: skip


def centred(angles: FloatArray, weights: FloatArray) -> tuple[FloatArray, float, float]:
    """
    Return angles (n,) less their mean direction, in (-pi, pi], that mean, and their agreement.

    The agreement is the length of the mean unit vector: 1 for equal angles, 0 for any.
    """
    mean = complex(weights @ np.exp(1j * angles)) / float(weights.sum())
    centre = float(np.angle(mean))
    return np.angle(np.exp(1j * (angles - centre))), centre, abs(mean)


def without_delay(s: Signals, gps: Stream, c: Course) -> Course:
    """Return the angles with the delay of the receiver that leaves least taken from its stamps."""
    steps = round(MAX_LAG_S / LAG_STEP_S)
    delays = LAG_STEP_S * np.arange(-steps, steps + 1)
    moved = [course_of(s, gps, delay) or c for delay in delays.tolist()]
    costs = np.array([float(x.weights @ _residuals(x) ** 2 / x.weights.sum()) for x in moved])
    best = int(np.argmin(costs))
    if not 0 < best < costs.size - 1:
        return moved[best]
    before, least, after = costs[best - 1 : best + 2].tolist()
    bend = before - 2.0 * least + after
    finer = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return course_of(s, gps, float(delays[best]) + finer * LAG_STEP_S) or c


def _residuals(c: Course) -> FloatArray:
    """Return what heading, sideslip and columns other than the delay leave of the course (n,)."""
    values = centred(c.course - c.heading - c.sideslip, c.weights)[0]
    # A sideslip of another size would look like a delay.
    columns = np.column_stack([np.delete(c.columns(), 1, axis=1), c.sideslip])
    root = np.sqrt(c.weights)
    fit = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)[0]
    return np.asarray(values - columns @ fit)


def least_speed(c: Course) -> tuple[float, float]:
    """Return the speed, m/s, from which noise is no material angle, and that noise, m/s."""
    weights = c.weights
    across = np.abs(_residuals(c) * c.speed)[weights > 0.0]
    # 1.48 times the median absolute value is the standard deviation of normal values.
    noise = 1.4826 * float(np.median(across))
    slowest = float(c.speed[weights > 0.0].min())
    return max(noise / MATERIAL[HEADING].size, slowest), noise
