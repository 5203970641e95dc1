# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Do the streams agree with each other? Finds units and signs given by mistake.

Two relations hold for any car on any road, whatever its model: the gyro shows the odometry's yaw
rate, and in a bend the lateral specific force is about v_x times yaw rate. The slope of each,
by exponentially forgotten least squares, should be 1. Degrees make it 57.3, g instead of m/s^2
0.102, a flipped axis negative.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.channels import Flag, Reading, Sample, Source

_FORGETTING = 0.9995
_ENOUGH_YAW = 0.5
_ENOUGH_FORCE = 200.0
_ODOMETRY = Source.ODOMETRY
_UNRELIABLE = int(Flag.NO_IMU | Flag.IMU_STALE | Flag.COASTING | Flag.FROZEN)


class _Slope:
    """Slope of y on x through the origin, and how well they go together."""

    def __init__(self) -> None:
        self.xx = self.xy = self.yy = 0.0

    def add(self, x: float, y: float) -> None:
        self.xx = _FORGETTING * self.xx + x * x
        self.xy = _FORGETTING * self.xy + x * y
        self.yy = _FORGETTING * self.yy + y * y

    @property
    def value(self) -> float:
        return self.xy / self.xx if self.xx > 0.0 else math.nan

    @property
    def correlation(self) -> float:
        return self.xy / math.sqrt(self.xx * self.yy) if self.xx > 0.0 < self.yy else 0.0


class Plausibility:
    """Collects samples; `warnings()` says what looks like a mistake, in words for a person."""

    def __init__(self) -> None:
        self.reset()

    def see(self, reading: Reading) -> None:
        """Take note of a reading on its way to the aligner."""
        if reading.source is _ODOMETRY:
            self._odometry_yaw_rate = reading.values[2]

    def watch(self, readings: Iterable[Reading]) -> Iterator[Reading]:
        """Pass readings on, having seen them."""
        for reading in readings:
            self.see(reading)
            yield reading

    def add(self, sample: Sample) -> None:
        """Compare a sample with the yaw rate that odometry reported last."""
        odometry_yaw_rate = self._odometry_yaw_rate
        if sample.flags & _UNRELIABLE:
            return
        gyro, v_x, a_y = sample.x[2], sample.x[0], sample.a[1]
        if not math.isfinite(odometry_yaw_rate):
            return
        if math.isfinite(gyro):
            self._yaw.add(odometry_yaw_rate, gyro)
        if math.isfinite(a_y) and abs(v_x) > 3.0:
            self._force.add(v_x * odometry_yaw_rate, a_y)

    def warnings(self) -> list[str]:
        """What looks wrong, one line each; empty while there is too little to tell."""
        found = []
        yaw, force = self._yaw, self._force
        if yaw.xx > _ENOUGH_YAW and abs(yaw.correlation) > 0.8:
            if yaw.value > 20.0:
                found.append(
                    f"the IMU's yaw rate is {yaw.value:.0f} times odometry's: it looks like "
                    "deg/s, the topic must carry rad/s"
                )
            elif yaw.value < -0.3:
                found.append(
                    "the IMU's yaw rate has the opposite sign of odometry's: check imu_rotation "
                    "(z must point up)"
                )
        if force.xx > _ENOUGH_FORCE and abs(force.correlation) > 0.8:
            if 0.05 < force.value < 0.2:
                found.append(
                    f"the IMU's lateral acceleration is {force.value:.3f} of v_x times yaw rate: "
                    f"it looks like g, the topic must carry m/s^2 (1 g = {GRAVITY})"
                )
            elif force.value < -0.3:
                found.append(
                    "the IMU's lateral acceleration points out of the bend: check imu_rotation "
                    "(y must point left)"
                )
        return found

    def reset(self) -> None:
        """Forget everything."""
        self._yaw = _Slope()
        self._force = _Slope()
        self._odometry_yaw_rate = math.nan
