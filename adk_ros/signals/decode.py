# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Decode ROS messages to `Reading` at the vehicle's reference point.

Duck-typed on purpose: messages of rclpy and messages deserialised by rosbags have the same
attributes, so the live node, replay and training use the same decoder.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from adk_ros.errors import UsageError
from adk_ros.signals.channels import Reading, Source
from adk_ros.signals.commands import (
    COMMAND_TYPES,
    RefusedMessage,
    checked_command,
    steering_report,
)
from adk_ros.signals.corrections import SensorCorrections, differs
from adk_ros.signals.frames import LeverArm, rotation, shift_velocity
from adk_ros.signals.velocity_messages import (
    ODOMETRY,
    ODOMETRY_TYPES,
    estimated_lateral_velocity,
)

MAX_SPEED = 150.0
"""m/s; a larger velocity is a faulty message: above the top speed of road and race cars."""
MAX_YAW_RATE = 20.0
"""rad/s; a larger yaw rate is a faulty message: three turns per second."""
MAX_FORCE = 500.0
"""m/s²; a larger specific force is a faulty message: beyond the range of automotive IMUs."""
_MAX_GYRO_RATE = MAX_YAW_RATE * 57.3
"""rad/s for the gyro: a gyro in deg/s is accepted, so that `plausibility` can name the fault."""
_MAX_GYRO_AGE_NS = 200_000_000
"""ns between a velocity and the yaw rate used where odometry has none. By choice: the period of a
5 Hz IMU, in which a yaw acceleration of 0.5 rad/s² changes the yaw rate by 0.1 rad/s."""

_MAX_STAMP_NS = (2**31 - 10) * 1_000_000_000
"""ns from which stamps are refused: builtin_interfaces/Time ends at 2^31 s, the longest horizon is
10 s."""

# Looked up once: an attribute of an enum takes as long as a comparison.
_IMU, _ODOMETRY = Source.IMU, Source.ODOMETRY
MAX_VARIANCE = 1e4
"""SI units squared; a larger variance, of 100 m/s, marks a value that is not measured."""
NOT_MEASURED = 1e6
"""SI units squared; the variance that `adk import` writes for a value that is not measured."""

__all__ = ["Decoder", "RefusedMessage", "SensorConfig"]


@dataclass(frozen=True)
class SensorConfig(SensorCorrections):
    """
    How to read the messages of a vehicle, and known errors of its sensors.

    Lengths in m, angles in rad. `reference_point` is the centre of gravity (x, y) in odometry's
    child frame (`base_link`), `imu_position` the IMU (x, y) in the same frame, `imu_rotation` its
    roll, pitch, yaw; with `use_tf` these come from `/tf_static` where both are zero
    (`signals.extrinsics`). `steering_ratio` is the angle of the steer joint divided by the
    road-wheel angle: 1 if the joint is the road wheel. `mass` (kg) and `wheel_radius` (m) are
    required if the command is an acceleration instead of a torque.

    `odometry_type`: key of `velocity_messages.ODOMETRY_TYPES`; wheel speeds need `wheel_radius`,
    joints of wheels also their names, `wheel_joints`. `sideslip`: where v_y is not measured, the
    distance from the centre of gravity to the rear axle (m) and the rear slip angle per lateral
    acceleration (rad s²/m), with which it is estimated; both zero: it is not.

    :raises UsageError: a value is not usable, or values contradict each other.
    """

    command_type: str = "joint_state"
    drive_joints: tuple[str, ...] = ("drive",)
    steer_joint: str = "steer"
    steering_ratio: float = 1.0
    reference_point: tuple[float, float] = (0.0, 0.0)
    imu_position: tuple[float, float] = (0.0, 0.0)
    imu_rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    use_tf: bool = True
    mass: float = 0.0
    wheel_radius: float = 0.0
    odometry_type: str = ODOMETRY
    wheel_joints: tuple[str, ...] = ("rear_left", "rear_right")
    sideslip: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.command_type not in COMMAND_TYPES:
            raise UsageError(
                f"command_type '{self.command_type}' is unknown: choose one of "
                f"{', '.join(COMMAND_TYPES)}"
            )
        numbers = (
            self.steering_ratio,
            *self.reference_point,
            *self.imu_position,
            *self.imu_rotation,
            *self.sideslip,
            self.mass,
            self.wheel_radius,
        )
        if not all(math.isfinite(value) for value in numbers):
            raise UsageError("the sensor configuration has a value that is not finite")
        self.check_corrections()
        if not self.drive_joints:
            raise UsageError("drive_joints is empty: name the joints that drive the vehicle")
        if len(set(self.drive_joints)) < len(self.drive_joints):
            raise UsageError("drive_joints names a joint twice: its effort would count double")
        if self.steering_ratio == 0.0:
            raise UsageError("steering_ratio is 0: give hand-wheel angle over road-wheel angle")
        kind = COMMAND_TYPES[self.command_type]
        if kind.inferred_torque and not (self.mass > 0.0 and self.wheel_radius > 0.0):
            raise UsageError(
                f"command_type '{self.command_type}' carries an acceleration: "
                "set mass and wheel_radius so that a torque can be inferred from it"
            )
        self._check_odometry()

    def _check_odometry(self) -> None:
        name = self.odometry_type
        if name not in ODOMETRY_TYPES:
            raise UsageError(
                f"odometry_type '{name}' is unknown: choose one of {', '.join(ODOMETRY_TYPES)}"
            )
        if ODOMETRY_TYPES[name].needs_radius and not self.wheel_radius > 0.0:
            raise UsageError(f"odometry_type '{name}' carries wheel speeds: set wheel_radius")
        if name != ODOMETRY and self.odometry_rotation:
            raise UsageError(f"odometry_type '{name}' has no v_y: set no odometry_rotation")
        if name == "wheel_joints" and not self.wheel_joints:
            raise UsageError(
                f"odometry_type '{name}': name the joints of the wheels in wheel_joints"
            )


class Decoder:
    """
    Decodes the messages of all streams; counts refused messages by stream and reason.

    `refused` maps (source, reason) to the number of messages. The lever-arm compensation of the
    IMU keeps the previous gyro value, so each sequence of messages needs its own instance.
    """

    def __init__(self, config: SensorConfig | None = None) -> None:
        self.config = config or SensorConfig()
        self.refused: Counter[tuple[Source, str]] = Counter()
        self.latest_ns: int | None = None
        """Stamp of the latest message, refused or not; None if it has none."""
        self.unmeasured_v_y = self.odometry_count = 0
        """Readings of odometry in which v_y is marked as not measured or estimated; all."""
        self._decode_command = COMMAND_TYPES[self.config.command_type].decode
        self._velocity = ODOMETRY_TYPES[self.config.odometry_type].decode
        self._is_odometry = self.config.odometry_type == ODOMETRY
        self._estimates_v_y = any(self.config.sideslip)
        self._gyro = 0.0
        self._gyro_ns: int | None = None
        self._values: tuple[Callable[[int, Any], tuple[float, ...]], ...] = (
            self._imu,
            self._odometry,
            self._command,
            lambda _, msg: (steering_report(msg) - self.config.steering_offset,),
        )
        position, reference = self.config.imu_position, self.config.reference_point
        self._arm = LeverArm(position[0] - reference[0], position[1] - reference[1])
        # Evaluated once, since every message needs them.
        self._has_lever_arm, self._is_shifted = position != reference, any(reference)
        self._is_rotated = any(self.config.imu_rotation)
        self._rotation = rotation(*self.config.imu_rotation)
        self._delays_ns = self.config.delays_ns
        self._has_imu_errors = differs(
            self.config, "accelerometer_scale", "accelerometer_bias", "gyro_scale", "gyro_bias"
        )
        self._has_odometry_errors = differs(
            self.config, "odometry_scale", "odometry_rotation", "yaw_rate_scale", "yaw_rate_bias"
        )

    def decode(self, source: Source, msg: Any) -> Reading:
        """
        Return the reading in `msg`.

        :raises RefusedMessage: it cannot be used; the reason is also counted in `refused`.
        """
        self.latest_ns = None
        try:
            try:
                stamp = msg.header.stamp
            except AttributeError:
                # Autoware messages have no header.
                stamp = msg.stamp
            stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
            self.latest_ns = stamp_ns
            if stamp_ns <= 0:
                raise RefusedMessage("no time stamp")
            if stamp_ns >= _MAX_STAMP_NS:
                raise RefusedMessage("the time stamp is beyond the range of ROS time (2^31 s)")
            stamp_ns -= self._delays_ns[source]
            values = self._values[source](stamp_ns, msg)
            variances = self._variances(source, msg)
        except RefusedMessage as refusal:
            self.refused[(source, str(refusal))] += 1
            raise
        except (AttributeError, TypeError, ValueError, IndexError, OverflowError) as error:
            reason = f"not the expected message type ({type(msg).__name__})"
            self.refused[(source, reason)] += 1
            raise RefusedMessage(reason) from error
        return Reading(source, stamp_ns, values, variances)

    @property
    def measures_v_y(self) -> bool:
        """Whether a message of odometry measured v_y, as far as the messages say so."""
        return self.unmeasured_v_y < self.odometry_count or not self.odometry_count

    def _variances(self, source: Source, msg: Any) -> tuple[float, ...] | None:
        """Return the variances (3,) that a message of IMU or odometry reports, if any."""
        # All zero means unknown, and so do the large values that mark an axis as not measured.
        if source is _ODOMETRY:
            self.odometry_count += 1
            if not self._is_odometry:
                self.unmeasured_v_y += 1
                return None
            covariance = msg.twist.covariance
            x = float(covariance[0])
            if self._estimates_v_y or float(covariance[7]) >= MAX_VARIANCE:
                self.unmeasured_v_y += 1
            if not 0.0 < x < MAX_VARIANCE:
                return None
            y, z = float(covariance[7]), float(covariance[35])
        elif source is _IMU and not self._is_rotated:
            force = msg.linear_acceleration_covariance
            x = float(force[0])
            if not 0.0 < x < MAX_VARIANCE:
                return None
            y, z = float(force[4]), float(msg.angular_velocity_covariance[8])
        else:
            return None
        if not (0.0 < y < MAX_VARIANCE and 0.0 < z < MAX_VARIANCE):
            return None
        if self._has_imu_errors or self._has_odometry_errors:
            s, of_yaw_rate = self.config.variance_scales(source)
            x, y, z = x / s, y / s, z / of_yaw_rate
        return x, y, z

    def reset(self) -> None:
        """Discard the previous gyro value, after a clock jump."""
        self._arm.reset()
        self._gyro_ns = None

    def _imu(self, stamp_ns: int, msg: Any) -> tuple[float, float, float]:
        force, rate = msg.linear_acceleration, msg.angular_velocity
        a_x, a_y, yaw_rate = float(force.x), float(force.y), float(rate.z)
        if self._is_rotated:
            a_x, a_y, _ = (self._rotation @ (a_x, a_y, float(force.z))).tolist()
            yaw_rate = float(self._rotation[2] @ (float(rate.x), float(rate.y), yaw_rate))
        if self._has_imu_errors:
            a_x, a_y, yaw_rate = self.config.imu(a_x, a_y, yaw_rate)
        # REP-145: a first covariance element of -1 marks a field that is not reported.
        if msg.angular_velocity_covariance[0] == -1.0:
            raise RefusedMessage("the IMU reports no angular velocity")
        if not abs(yaw_rate) <= _MAX_GYRO_RATE:
            raise RefusedMessage(f"yaw rate is not finite or above {_MAX_GYRO_RATE:g} rad/s")
        self._gyro, self._gyro_ns = yaw_rate, stamp_ns
        if msg.linear_acceleration_covariance[0] == -1.0:
            return math.nan, math.nan, yaw_rate
        if not (abs(a_x) <= MAX_FORCE and abs(a_y) <= MAX_FORCE):
            raise RefusedMessage(f"acceleration is not finite or above {MAX_FORCE:g} m/s²")
        if self._has_lever_arm:
            a_x, a_y = self._arm.compensate(stamp_ns, a_x, a_y, yaw_rate)
        return a_x, a_y, yaw_rate

    def _odometry(self, stamp_ns: int, msg: Any) -> tuple[float, float, float]:
        v_x, v_y, yaw_rate = self._velocity(msg, self.config)
        if self._has_odometry_errors:
            v_x, v_y, yaw_rate = self.config.velocity(v_x, v_y, yaw_rate)
        if not self._is_odometry:
            # The yaw rate is that of the gyro's latest message; at the reference point.
            if self._gyro_ns is None or abs(stamp_ns - self._gyro_ns) > _MAX_GYRO_AGE_NS:
                raise RefusedMessage("no yaw rate: no IMU message within 0.2 s")
            yaw_rate = self._gyro
            v_x, v_y = v_x - yaw_rate * self.config.reference_point[1], 0.0
        if not (abs(v_x) <= MAX_SPEED and abs(v_y) <= MAX_SPEED):
            raise RefusedMessage(f"velocity is not finite or above {MAX_SPEED:g} m/s")
        if not abs(yaw_rate) <= MAX_YAW_RATE:
            raise RefusedMessage(f"yaw rate is not finite or above {MAX_YAW_RATE:g} rad/s")
        if self._is_shifted and self._is_odometry:
            v_x, v_y = shift_velocity(v_x, v_y, yaw_rate, *self.config.reference_point)
        if self._estimates_v_y:
            v_y = estimated_lateral_velocity(v_x, yaw_rate, *self.config.sideslip)
        return v_x, v_y, yaw_rate

    def _command(self, _: int, msg: Any) -> tuple[float, float]:
        return checked_command(*self.config.command(*self._decode_command(msg, self.config)))
