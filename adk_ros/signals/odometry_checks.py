# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check odometry by itself: channels that are not measured, and velocities in the wrong axes.

In the axes of the vehicle the direction of the velocity is the side-slip angle, which stays small
while the heading turns by full circles. In the axes of `odom` it turns with the heading: the slope
of the change of the direction on the change of the heading is 1 instead of about 0. A sliding car
turns without its velocity: slope -1.
"""

from __future__ import annotations

import math

from adk_ros.numerics.running_slope import Slope
from adk_ros.signals.channels import Reading
from adk_ros.signals.moving_speed import moving_speed, speed_varies

_BLOCK_NS = 1_000_000_000
"""ns over which changes of direction and heading are compared: long against the noise of single
readings, short against a bend."""
_MAX_GAP_NS = 500_000_000
"""ns between readings above which the heading in between is unknown: the odometry timeout."""
_FORGETTING = 0.98
"""Forgetting factor per block: a memory of 50 s, as in `plausibility`."""
_MIN_INFORMATION = 1.0
"""rad²; weighted sum of squared changes of heading that a warning requires: 11 times 0.3 rad."""
_MIN_CORRELATION = 0.8
"""Correlation that a warning requires, as in `plausibility`."""
_MIN_SLOPE = 0.5
"""Slope above which the axes are reported: half way between vehicle axes and fixed ones."""

MIN_CONSTANT_NS = 10_000_000_000
"""ns below which a constant channel is not reported: it may be driving straight ahead."""
_ROUNDING = 1e-9
"""SI units; differences that arise from the transformation to the reference point and back."""


class VelocityAxes:
    """Tells velocities in fixed axes from those in vehicle axes."""

    def __init__(self) -> None:
        self._slope = Slope(_FORGETTING)
        self._last: tuple[int, float] | None = None
        self._begin_ns = 0
        self._heading = self._direction = 0.0
        self._top_speed = 0.0

    def add(self, stamp_ns: int, v_x: float, v_y: float, yaw_rate: float) -> None:
        """Compare a reading, SI, with the one before."""
        last, self._last = self._last, None
        speed = math.hypot(v_x, v_y)
        self._top_speed = max(self._top_speed, speed)
        # Below, noise dominates the direction of the velocity.
        if speed < moving_speed(self._top_speed):
            return
        direction = math.atan2(v_y, v_x)
        self._last = stamp_ns, direction
        if last is None or not 0 < stamp_ns - last[0] <= _MAX_GAP_NS:
            self._begin_ns = stamp_ns
            self._heading = self._direction = 0.0
            return
        self._heading += yaw_rate * (stamp_ns - last[0]) * 1e-9
        self._direction += math.remainder(direction - last[1], math.tau)
        if stamp_ns - self._begin_ns >= _BLOCK_NS:
            self._slope.add(self._heading, self._direction)
            self._begin_ns = stamp_ns
            self._heading = self._direction = 0.0

    def warnings(self) -> list[str]:
        """Return a line if the axes are fixed ones."""
        slope = self._slope
        if (
            slope.xx > _MIN_INFORMATION
            and slope.correlation > _MIN_CORRELATION
            and slope.value > _MIN_SLOPE
        ):
            return [
                "odometry's velocity turns with the heading: it looks like axes of odom, the "
                "twist must be in those of the vehicle (x forward)"
            ]
        return []


class ConstantChannels:
    """Finds odometry channels that have never changed while v_x has."""

    def __init__(self) -> None:
        self._begin_ns: int | None = None
        self._duration_ns = 0
        self._low: list[float] = []
        self._high: list[float] = []

    def add(self, stamp_ns: int, *values: float) -> None:
        """Take over (v_x, v_y, yaw rate), SI."""
        if self._begin_ns is None:
            self._begin_ns = stamp_ns
            self._low, self._high = list(values), list(values)
            return
        self._duration_ns = max(self._duration_ns, stamp_ns - self._begin_ns)
        self._low = list(map(min, self._low, values))
        self._high = list(map(max, self._high, values))

    def warnings(self) -> list[str]:
        """Return a line per channel."""
        if self._duration_ns < MIN_CONSTANT_NS:
            return []
        spans = [high - low for low, high in zip(self._low, self._high, strict=True)]
        # At a standstill constant channels are normal.
        if not speed_varies(self._low[0], self._high[0]):
            return []
        return [
            f"odometry's {name} is {self._low[i]:.4g} throughout: it is not measured, and "
            "predictions of it are meaningless"
            for i, name in ((1, "v_y"), (2, "yaw rate"))
            if spans[i] < _ROUNDING
        ]


class OdometryChecks:
    """
    Both checks for the readings of one stream.

    :param reference_point: (x, y), m, to which the readings are transformed; the checks are of
        what the messages contain.
    """

    def __init__(self, reference_point: tuple[float, float] = (0.0, 0.0)) -> None:
        self._x, self._y = reference_point
        self._axes = VelocityAxes()
        self._constant = ConstantChannels()

    def add(self, reading: Reading) -> None:
        """Take over a reading of odometry."""
        v_x, v_y, yaw_rate = reading.values
        v_x, v_y = v_x + yaw_rate * self._y, v_y - yaw_rate * self._x
        self._axes.add(reading.stamp_ns, v_x, v_y, yaw_rate)
        self._constant.add(reading.stamp_ns, v_x, v_y, yaw_rate)

    def warnings(self) -> list[str]:
        """Return one line per fault."""
        return self._axes.warnings() + self._constant.warnings()
