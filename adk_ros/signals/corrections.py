# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Known errors of sensors and steering, which decoding removes.

A reading is scale * value + bias, in the axes of the vehicle, and its stamp is late by a delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

from adk_ros.errors import UsageError
from adk_ros.numerics.arrays import FloatArray
from adk_ros.signals.channels import Source

Values = TypeVar("Values", float, FloatArray)
"""One reading, or those of a stream."""

MAX_DELAY_S = 1.0
"""s; by choice: by default, odometry that is half a second old gives no state any more."""


@dataclass(frozen=True)
class SensorCorrections:
    """
    Scales, biases and delays of the readings.

    Biases in the unit of the reading, in vehicle axes: `accelerometer_bias` (a_x, a_y) in m/s²,
    `gyro_bias` and `yaw_rate_bias` (of odometry) in rad/s, `steering_offset` in rad at the road
    wheels. Scales are reading over value: 3.6 for a speed in km/h, 0.001 for a torque in kN m, -1
    for a flipped sign. `odometry_scale` is that of v_x and v_y. `odometry_rotation`: the axes of
    odometry against those of the vehicle, rad, positive to the left. Delays in s.
    """

    accelerometer_scale: float = 1.0
    accelerometer_bias: tuple[float, float] = (0.0, 0.0)
    gyro_scale: float = 1.0
    gyro_bias: float = 0.0
    odometry_scale: float = 1.0
    odometry_rotation: float = 0.0
    yaw_rate_scale: float = 1.0
    yaw_rate_bias: float = 0.0
    torque_scale: float = 1.0
    steering_offset: float = 0.0
    imu_delay: float = 0.0
    odometry_delay: float = 0.0
    command_delay: float = 0.0

    def check_corrections(self) -> None:
        """Check the values. :raises UsageError: one cannot be used."""
        for name in CORRECTIONS:
            value = getattr(self, name)
            if not all(
                math.isfinite(x) for x in (value if isinstance(value, tuple) else (value,))
            ):
                raise UsageError(f"{name} is not finite")
            if name.endswith("_scale") and value == 0.0:
                raise UsageError(f"{name} is 0: give the reading over the value, 1 for none")
            if name.endswith("_delay") and not 0.0 <= value <= MAX_DELAY_S:
                raise UsageError(f"{name} is {value:g} s: give 0 to {MAX_DELAY_S:g} s")

    @property
    def delays_ns(self) -> tuple[int, int, int, int]:
        """Delays by `channels.Source`: IMU, odometry, command, measured steering angle."""
        imu, odometry, command = (
            round(1e9 * x) for x in (self.imu_delay, self.odometry_delay, self.command_delay)
        )
        return imu, odometry, command, command

    def variance_scales(self, source: Source) -> tuple[float, float]:
        """Return by what to divide variances of IMU or odometry: of x and y, of the yaw rate."""
        if source is Source.IMU:
            return self.accelerometer_scale**2, self.gyro_scale**2
        return self.odometry_scale**2, self.yaw_rate_scale**2

    def imu(self, a_x: Values, a_y: Values, yaw_rate: Values) -> tuple[Values, Values, Values]:
        """Return the values of a reading of the IMU, SI."""
        (bias_x, bias_y), scale = self.accelerometer_bias, self.accelerometer_scale
        yaw_rate = (yaw_rate - self.gyro_bias) / self.gyro_scale
        return (a_x - bias_x) / scale, (a_y - bias_y) / scale, yaw_rate

    def velocity(
        self, v_x: Values, v_y: Values, yaw_rate: Values
    ) -> tuple[Values, Values, Values]:
        """Return the values of a reading of odometry, SI."""
        scale = self.odometry_scale
        if self.odometry_rotation:
            c, s = math.cos(self.odometry_rotation), math.sin(self.odometry_rotation)
            v_x, v_y = c * v_x - s * v_y, s * v_x + c * v_y
        return v_x / scale, v_y / scale, (yaw_rate - self.yaw_rate_bias) / self.yaw_rate_scale

    def command(self, torque: Values, delta: Values) -> tuple[Values, Values]:
        """Return torque (N·m) and road-wheel angle (rad) of a command."""
        return torque / self.torque_scale, delta - self.steering_offset


CORRECTIONS = tuple(SensorCorrections.__dataclass_fields__)
"""Names of the corrections, as fields and as parameters."""
NO_CORRECTION = SensorCorrections()


def differs(corrections: SensorCorrections, *names: str) -> bool:
    """Whether one of these corrections does anything."""
    return any(getattr(corrections, name) != getattr(NO_CORRECTION, name) for name in names)
