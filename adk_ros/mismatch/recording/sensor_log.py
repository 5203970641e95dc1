# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sensor data of one recording, each stream at its native rate.

Times are seconds from the bag's first message, by header stamps. SI units. Accelerations are
specific force at the IMU, velocities are those of the centre of gravity.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.mismatch.recording.measured_road import MeasuredRoad
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import time_scale
from adk_ros.signals.decode import SensorConfig
from adk_ros.signals.score import white_noise

CHANNELS = ("imu_a_x", "imu_a_y", "imu_yaw_rate", "v_x", "v_y", "yaw_rate")
UNITS = ("m/s^2", "m/s^2", "rad/s", "m/s", "m/s", "rad/s")

MIN_SENSOR_NOISE = np.array([0.01, 0.01, 3e-4, 2e-3, 2e-3, 3e-4])
"""Least noise assumed, by channel: a simulation has none, and a model is never exact."""


@dataclass(frozen=True)
class SensorLog:
    """
    Streams of one bag, ordered by time.

    `imu` (m, 3): a_x, a_y, yaw rate at `imu_s` (m,). `odometry` (k, 3): v_x, v_y, yaw rate, and
    `pose` (k, 3): x, y, heading (unwrapped), at `odometry_s` (k,). `command` (c, 2): torque and
    road-wheel angle at `command_s` (c,), each held until the next.
    """

    name: str
    duration_s: float
    imu_s: FloatArray
    imu: FloatArray
    odometry_s: FloatArray
    odometry: FloatArray
    pose: FloatArray
    command_s: FloatArray
    command: FloatArray
    start_ns: int = 0
    """Log time of the bag's first message, ns: zero of the times in seconds."""
    torque_is_inferred: bool = False
    """Whether the torque is computed from a requested acceleration, not commanded."""
    warnings: tuple[str, ...] = ()
    """Lost and refused messages of the bag, one line each."""
    extrinsics: str = ""
    """The pose of the IMU, in a line, if the bag gave it in `/tf_static`."""
    sensors: SensorConfig = field(default_factory=SensorConfig)
    """How the bag was read, with the pose of the IMU that it gives in `/tf_static`."""
    measures_v_y: bool = True
    """Whether v_y is a measurement; if not, its values are zero and not compared with."""
    has_command: bool = True
    """Whether the bag has a command; if not, its values are zeros at the stamps of odometry."""
    length_scale: float = 1.0
    """Scale of lengths of the vehicle: 1 if it is full-size (`numerics.similarity`)."""
    attitude_s: FloatArray = field(default_factory=lambda: np.empty(0))
    attitude: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """(a, 2) roll and pitch by an inertial navigation system at `attitude_s` (a,), rad."""
    road: MeasuredRoad | None = None
    """Grade and bank by that attitude, where they explain the motion (`mismatch.road_by_ins`)."""

    def similar(self, threshold: float) -> float:
        """Return a speed or a duration that is meant for a full-size car, for this vehicle."""
        return threshold * time_scale(self.length_scale)

    @property
    def odometry_period_s(self) -> float:
        """Median interval between odometry messages, s."""
        return float(np.median(np.diff(self.odometry_s)))

    def noise(self) -> FloatArray:
        """Return the noise of one sample by channel (6,), at least `MIN_SENSOR_NOISE`."""
        found = np.concatenate([white_noise(self.imu), white_noise(self.odometry)])
        # fmax: the noise of an absent sensor is NaN and becomes the minimum.
        return np.asarray(np.fmax(found, MIN_SENSOR_NOISE))

    def between(self, begin_s: float, end_s: float) -> SensorLog:
        """Return the part between two times, in s; the zero of time is unchanged."""
        imu = (self.imu_s >= begin_s) & (self.imu_s < end_s)
        odometry = (self.odometry_s >= begin_s) & (self.odometry_s < end_s)
        # The command that is in force at the beginning has an earlier stamp.
        first = max(int(np.searchsorted(self.command_s, begin_s, side="right")) - 1, 0)
        last = int(np.searchsorted(self.command_s, end_s))
        attitude = (self.attitude_s >= begin_s) & (self.attitude_s < end_s)
        return replace(
            self,
            duration_s=end_s - begin_s,
            imu_s=self.imu_s[imu],
            imu=self.imu[imu],
            odometry_s=self.odometry_s[odometry],
            odometry=self.odometry[odometry],
            pose=self.pose[odometry],
            command_s=self.command_s[first:last],
            command=self.command[first:last],
            attitude_s=self.attitude_s[attitude],
            attitude=self.attitude[attitude],
        )
