# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensor models: streams, each with its rate, delay, noise, bias, resolution and dropout.

The IMU is at the centre of gravity and senses specific force: on a slope it includes the reaction
of the road, gravity is not removed. Odometry reports pose, body velocities and yaw rate at the
centre of gravity. Commands are reported as given, by default without noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from adk_ros.files.yaml_file import FileModel
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray


class Timing(FileModel):
    """Stamps and arrival times of a stream."""

    rate_hz: float = Field(gt=0.1, le=1000.0)
    phase_s: float = Field(default=0.0, ge=0.0, le=10.0)
    """Time of the first stamp after the start of the drive, s."""
    delay_s: float = Field(default=0.002, ge=0.0, le=5.0)
    """Constant part of the time from stamp to arrival, s."""
    jitter_s: float = Field(default=0.0005, ge=0.0, le=5.0)
    """Mean of the random part, s: exponentially distributed, truncated at eight times the mean."""
    dropout: float = Field(default=0.0, ge=0.0, le=0.95)
    """Probability that a message is lost."""


class Imu(Timing):
    """
    IMU: a_x, a_y, yaw rate. Noise: standard deviation; bias: reading at rest; SI units.

    With `attitude_noise` it is an inertial navigation system that reports roll and pitch as well.
    """

    rate_hz: float = Field(default=200.0, gt=0.1, le=1000.0)
    phase_s: float = Field(default=0.0013, ge=0.0, le=10.0)
    accel_noise: float = Field(default=0.05, ge=0.0, le=1e3)
    gyro_noise: float = Field(default=0.002, ge=0.0, le=1e2)
    bias_a_x: float = 0.0
    bias_a_y: float = 0.0
    bias_yaw_rate: float = 0.0
    accel_resolution: float = Field(default=2.0**-10, ge=0.0, le=10.0)
    gyro_resolution: float = Field(default=2.0**-14, ge=0.0, le=1.0)
    attitude_noise: float | None = Field(default=None, ge=0.0, le=1.0)
    bias_roll: float = Field(default=0.0, ge=-1.0, le=1.0)
    bias_pitch: float = Field(default=0.0, ge=-1.0, le=1.0)


class Wheels(Timing):
    """Speeds of rotation of the four wheels, rad/s, by the pulses of their sensors."""

    rate_hz: float = Field(default=50.0, gt=0.1, le=1000.0)
    phase_s: float = Field(default=0.0043, ge=0.0, le=10.0)
    speed_noise: float = Field(default=0.02, ge=0.0, le=1e3)
    speed_resolution: float = Field(default=2.0**-8, ge=0.0, le=10.0)


class Odometry(Timing):
    """Odometry: pose (x, y, heading) in the frame of the route, and v_x, v_y, yaw rate; SI."""

    rate_hz: float = Field(default=50.0, gt=0.1, le=1000.0)
    phase_s: float = Field(default=0.0071, ge=0.0, le=10.0)
    delay_s: float = Field(default=0.004, ge=0.0, le=5.0)
    velocity_noise: float = Field(default=0.02, ge=0.0, le=1e2)
    yaw_rate_noise: float = Field(default=0.002, ge=0.0, le=1e2)
    position_noise: float = Field(default=0.02, ge=0.0, le=1e3)
    heading_noise: float = Field(default=0.002, ge=0.0, le=10.0)
    bias_v_x: float = 0.0
    bias_v_y: float = 0.0
    bias_yaw_rate: float = 0.0
    velocity_resolution: float = Field(default=2.0**-12, ge=0.0, le=10.0)
    gyro_resolution: float = Field(default=2.0**-14, ge=0.0, le=1.0)
    position_resolution: float = Field(default=2.0**-10, ge=0.0, le=10.0)


class Command(Timing):
    """Commanded torque (N·m) and road-wheel angle (rad), in force from their stamp to the next."""

    rate_hz: float = Field(default=40.0, ge=1.0, le=1000.0)
    phase_s: float = Field(default=0.022, ge=0.0, le=10.0)
    delay_s: float = Field(default=0.001, ge=0.0, le=5.0)
    torque_noise: float = Field(default=0.0, ge=0.0, le=1e4)
    delta_noise: float = Field(default=0.0, ge=0.0, le=1.0)
    bias_torque: float = 0.0
    bias_delta: float = 0.0
    torque_resolution: float = Field(default=2.0**-4, ge=0.0, le=100.0)
    delta_resolution: float = Field(default=2.0**-16, ge=0.0, le=0.1)


class Sensors(FileModel):
    """The streams of a vehicle; `wheels` only where a scenario names them."""

    imu: Imu | None = Imu()
    odometry: Odometry = Odometry()
    command: Command = Command()
    wheels: Wheels | None = None

    def clean(self) -> Sensors:
        """Return sensors without noise, bias, rounding, dropout and jitter, of the same timing."""
        imu, wheels = self.imu, self.wheels
        if imu is not None:
            attitude = {} if imu.attitude_noise is None else {"attitude_noise": 0.0}
            imu = imu.model_copy(update=_CLEAN_IMU | attitude)
        return Sensors(
            imu=imu,
            odometry=self.odometry.model_copy(update=_CLEAN_ODOMETRY),
            command=self.command.model_copy(update=_CLEAN_COMMAND),
            wheels=None if wheels is None else wheels.model_copy(update=_CLEAN_WHEELS),
        )


def _zeros(model: type[Timing]) -> dict[str, float]:
    keep = {"rate_hz", "phase_s", "delay_s", "attitude_noise"}
    return {name: 0.0 for name in model.model_fields if name not in keep}


_CLEAN_IMU, _CLEAN_ODOMETRY, _CLEAN_COMMAND = _zeros(Imu), _zeros(Odometry), _zeros(Command)
_CLEAN_WHEELS = _zeros(Wheels)


@dataclass(frozen=True)
class Stream:
    """
    Messages of one sensor in the order of their stamps: `stamp_ns`, arrival `log_ns` (m,).

    `values` (m, k): IMU a_x, a_y, yaw rate; odometry v_x, v_y, yaw rate, x, y, heading; command
    torque, delta; attitude roll, pitch; wheels their speeds.
    """

    stamp_ns: IntArray
    log_ns: IntArray
    values: FloatArray


def stamps(timing: Timing, duration_s: float) -> IntArray:
    """Return the stamps of a stream up to `duration_s`, ns from the start of the drive."""
    period = 1.0 / timing.rate_hz
    count = max(0, int(np.floor((duration_s - timing.phase_s) / period + 1e-9)) + 1)
    at = np.rint((timing.phase_s + period * np.arange(count)) * 1e9)
    return np.asarray(at, dtype=np.int64)


def send(
    rng: np.random.Generator,
    timing: Timing,
    stamp_ns: IntArray,
    truth: FloatArray,
    noise: list[float],
    bias: list[float],
    resolution: list[float],
) -> Stream:
    """
    Measure and transmit `truth` (m, k); `noise`, `bias`, `resolution` have one value per column.

    The random numbers do not depend on the settings: with less noise or dropout the same drive is
    measured better.
    """
    m, k = truth.shape
    draws = rng.standard_normal((m, k))
    jitter = np.minimum(rng.standard_exponential(m), 8.0)
    kept: BoolArray = np.asarray(rng.random(m) >= timing.dropout)
    values = truth + np.asarray(bias) + np.asarray(noise) * draws
    step = np.asarray(resolution)
    rounded = step > 0.0
    values[:, rounded] = np.rint(values[:, rounded] / step[rounded]) * step[rounded]
    delay_ns = np.rint((timing.delay_s + timing.jitter_s * jitter) * 1e9).astype(np.int64)
    return Stream(stamp_ns[kept], (stamp_ns + delay_ns)[kept], values[kept])


def imu_stream(rng: np.random.Generator, imu: Imu, at: IntArray, truth: FloatArray) -> Stream:
    """Return the IMU stream; `truth` (m, 3): a_x, a_y, yaw rate at the stamps."""
    return send(
        rng,
        imu,
        at,
        truth,
        [imu.accel_noise] * 2 + [imu.gyro_noise],
        [imu.bias_a_x, imu.bias_a_y, imu.bias_yaw_rate],
        [imu.accel_resolution] * 2 + [imu.gyro_resolution],
    )


def odometry_stream(
    rng: np.random.Generator, odometry: Odometry, at: IntArray, truth: FloatArray
) -> Stream:
    """Return the odometry stream; `truth` (m, 6): v_x, v_y, yaw rate, x, y, heading."""
    o = odometry
    return send(
        rng,
        o,
        at,
        truth,
        [o.velocity_noise] * 2 + [o.yaw_rate_noise] + [o.position_noise] * 2 + [o.heading_noise],
        [o.bias_v_x, o.bias_v_y, o.bias_yaw_rate, 0.0, 0.0, 0.0],
        [o.velocity_resolution] * 2
        + [o.gyro_resolution]
        + [o.position_resolution] * 2
        + [o.gyro_resolution],
    )


def command_stream(
    rng: np.random.Generator, command: Command, at: IntArray, truth: FloatArray
) -> Stream:
    """Return the command stream; `truth` (m, 2): torque, delta."""
    return send(
        rng,
        command,
        at,
        truth,
        [command.torque_noise, command.delta_noise],
        [command.bias_torque, command.bias_delta],
        [command.torque_resolution, command.delta_resolution],
    )
