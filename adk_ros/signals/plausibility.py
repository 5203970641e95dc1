# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Consistency checks between streams: find wrong units and signs, and channels that are missing.

Two relations hold for any car on any road: the gyro measures the odometry's yaw rate, and in a
bend the lateral specific force is about v_x times yaw rate. The slope of each, by least squares
with exponential forgetting, should be 1. A gyro in deg/s gives 57.3, an accelerometer in g
0.102, a flipped axis a negative slope. `longitudinal_force` adds the third axis,
`odometry_checks` what odometry alone shows, and `constant_commands` commands that never change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.running_slope import Slope
from adk_ros.signals.channels import Flag, Reading, Sample, Source
from adk_ros.signals.constant_commands import ConstantCommands
from adk_ros.signals.longitudinal_force import LongitudinalForce
from adk_ros.signals.moving_speed import moving_speed
from adk_ros.signals.odometry_checks import OdometryChecks

_FORGETTING = 0.9995
"""Forgetting factor per sample: a memory of 2000 samples, 50 s."""
_MIN_YAW_INFORMATION = 0.5
"""(rad/s)²; weighted sum of squared yaw rates that a warning requires: 50 times 0.1 rad/s."""
_MIN_FORCE_INFORMATION = 200.0
"""(m/s²)²; weighted sum of squared v_x times yaw rate that a warning requires: 50 times 2 m/s²."""
_MIN_CORRELATION = 0.8
"""Correlation that a warning requires: below, noise or other effects dominate."""
_DEGREES_SLOPE = 20.0
"""Slope above which the gyro is reported in deg/s: between 1 and 57.3."""
_FLIPPED_SLOPE = -0.3
"""Slope below which an axis is reported as flipped: between 0 and -1."""
_G_SLOPE_RANGE = (0.05, 0.2)
"""Slopes for which the accelerometer is reported in g: a factor of two around 0.102."""
_ODOMETRY = Source.ODOMETRY
_UNRELIABLE = int(Flag.NO_IMU | Flag.IMU_STALE | Flag.COASTING | Flag.FROZEN)
_NO_COMMAND = int(Flag.COMMAND_STALE | Flag.COASTING | Flag.ODOMETRY_STALE | Flag.FROZEN)
"""Flags of samples that say nothing about commands: a command that stopped is held."""


class Plausibility:
    """
    Collects samples; `warnings()` describes inconsistent units and signs, and missing channels.

    :param reference_point: (x, y), m, of the readings in odometry's frame.
    :param has_command: whether the commands are measured, not `absent_command`.
    """

    def __init__(
        self, reference_point: tuple[float, float] = (0.0, 0.0), has_command: bool = True
    ) -> None:
        self._reference_point = reference_point
        self._has_command = has_command
        self._top_speed = 0.0
        self._latest = 0, 0.0
        self.reset()

    def see(self, reading: Reading) -> None:
        """Record an odometry reading that goes to the aligner."""
        if reading.source is _ODOMETRY:
            self._odometry_yaw_rate = reading.values[2]
            self._latest = reading.stamp_ns, reading.values[0]
            self._top_speed = max(self._top_speed, abs(reading.values[0]))
            self._odometry.add(reading)

    def watch(self, readings: Iterable[Reading]) -> Iterator[Reading]:
        """Yield the readings unchanged after `see` has recorded them."""
        for reading in readings:
            self.see(reading)
            yield reading

    def add(self, sample: Sample) -> None:
        """Compare a sample with the latest reading of odometry."""
        odometry_yaw_rate = self._odometry_yaw_rate
        (v_x, v_y, gyro), (a_x, a_y) = sample.x, sample.a
        if self._has_command and not sample.flags & _NO_COMMAND:
            self._commands.add(sample.stamp_ns, v_x, gyro, sample.u)
        if sample.flags & _UNRELIABLE or not math.isfinite(a_x):
            self._longitudinal.interrupt()
        else:
            # A gyro in the wrong unit has a separate line.
            rate = odometry_yaw_rate if math.isfinite(odometry_yaw_rate) else gyro
            self._longitudinal.add(*self._latest, rate * v_y, a_x)
        if sample.flags & _UNRELIABLE:
            return
        if not math.isfinite(odometry_yaw_rate):
            return
        if math.isfinite(gyro):
            self._yaw.add(odometry_yaw_rate, gyro)
        # Below, side slip dominates the lateral force.
        if math.isfinite(a_y) and abs(v_x) > moving_speed(self._top_speed):
            self._force.add(v_x * odometry_yaw_rate, a_y)

    def warnings(self) -> list[str]:
        """Return one line per inconsistency; empty until there is enough data."""
        found = []
        yaw, force = self._yaw, self._force
        along = self._longitudinal.warnings()
        if yaw.xx > _MIN_YAW_INFORMATION and abs(yaw.correlation) > _MIN_CORRELATION:
            if yaw.value > _DEGREES_SLOPE:
                found.append(
                    f"the IMU's yaw rate is {yaw.value:.0f} times odometry's: it looks like "
                    "deg/s, the topic must carry rad/s"
                )
            elif yaw.value < _FLIPPED_SLOPE:
                found.append(
                    "the IMU's yaw rate has the opposite sign of odometry's: check imu_rotation "
                    "(z must point up)"
                )
        if force.xx > _MIN_FORCE_INFORMATION and abs(force.correlation) > _MIN_CORRELATION:
            if _G_SLOPE_RANGE[0] < force.value < _G_SLOPE_RANGE[1]:
                found.append(
                    f"the IMU's lateral acceleration is {force.value:.3f} of v_x times yaw rate: "
                    f"it looks like g, the topic must carry m/s² (1 g = {GRAVITY} m/s²)"
                )
                # One line on the unit of the topic.
                along = [] if self._longitudinal.is_in_g else along
            elif force.value < _FLIPPED_SLOPE:
                found.append(
                    "the IMU's lateral acceleration points out of the bend: check imu_rotation "
                    "(y must point left)"
                )
        return found + along + self._odometry.warnings() + self._commands.warnings()

    def reset(self) -> None:
        """Discard all data."""
        self._yaw = Slope(_FORGETTING)
        self._force = Slope(_FORGETTING)
        self._odometry = OdometryChecks(self._reference_point)
        self._longitudinal = LongitudinalForce()
        self._commands = ConstantCommands()
        self._odometry_yaw_rate = math.nan
        self._latest = 0, 0.0
        self._top_speed = 0.0
