# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Find commands that never change although the motion that they cause does.

A model that is trained on a constant torque predicts v_x from its past and the IMU alone; one that
is trained on a constant steering angle does so for v_y and the yaw rate.
"""

from __future__ import annotations

from adk_ros.signals.moving_speed import speed_varies
from adk_ros.signals.odometry_checks import MIN_CONSTANT_NS

_MIN_YAW_RATE_RANGE = 0.2
"""rad/s; a smaller range of the yaw rate needs no other steering angle: a noise of 0.02 rad/s of
an odometry reaches 0.16 rad/s (four standard deviations to either side)."""


class ConstantCommands:
    """Tracks the range of commands and motion until both commands have changed."""

    def __init__(self) -> None:
        self._begin_ns: int | None = None
        self._duration_ns = 0
        self._first = (0.0, 0.0)
        self._varies = [False, False]
        self._low = [0.0, 0.0]
        self._high = [0.0, 0.0]

    def add(self, stamp_ns: int, v_x: float, yaw_rate: float, u: tuple[float, float]) -> None:
        """Take over a sample: m/s, rad/s, `u` = (torque, N·m or a pedal, steering angle, rad)."""
        if self._varies[0] and self._varies[1]:
            return
        if self._begin_ns is None:
            self._begin_ns = stamp_ns
            self._first = u
            self._low, self._high = [v_x, yaw_rate], [v_x, yaw_rate]
            return
        self._duration_ns = max(self._duration_ns, stamp_ns - self._begin_ns)
        self._varies = [
            varies or value != first
            for varies, value, first in zip(self._varies, u, self._first, strict=True)
        ]
        self._low = [min(self._low[0], v_x), min(self._low[1], yaw_rate)]
        self._high = [max(self._high[0], v_x), max(self._high[1], yaw_rate)]

    def warnings(self) -> list[str]:
        """Return a line per constant command."""
        if self._duration_ns < MIN_CONSTANT_NS:
            return []
        found = []
        speeds, rates = (high - low for low, high in zip(self._low, self._high, strict=True))
        if not self._varies[0] and speed_varies(self._low[0], self._high[0]):
            found.append(
                f"the command's torque is {self._first[0]:.4g} throughout while v_x varies by "
                f"{speeds:.2g} m/s: v_x can only be predicted in reduced scope, from its past and "
                "the IMU; record the wheel torque or a pedal position"
            )
        if not self._varies[1] and rates >= _MIN_YAW_RATE_RANGE:
            found.append(
                f"the steering angle is {self._first[1]:.4g} rad throughout while the yaw rate "
                f"varies by {rates:.2g} rad/s: v_y and yaw rate can only be predicted in reduced "
                "scope, from their past and the IMU; record the steering angle"
            )
        return found
