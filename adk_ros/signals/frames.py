# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Transform velocities and specific forces from a sensor's position to the reference point.

Axes are REP-103 (x forward, y left, z up), frames REP-105. Planar rigid-body relations for a
point P at r from O: v_P = v_O + w x r and a_P = a_O + dw/dt x r - w^2 r.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from adk_ros.numerics.arrays import FloatArray

CENTRE_OF_GRAVITY = "centre_of_gravity"
"""Frame of the published twist where the centre of gravity is not the origin of odometry's frame;
its axes are those of the vehicle."""

_RATE_FILTER_S = 0.05
"""s; time constant of the low-pass on the angular acceleration: two samples of the grid."""
_MAX_YAW_ACCELERATION = 100.0
"""
rad/s^2 between two gyro values that count: about ten times that of a car (9 in
`uncertainty.motion_limits`), as of a model at a scale of 1:10. One wrong value must not last.
"""
_MAX_GAP_S = 0.2
"""s between two gyro values above which no angular acceleration is computed: an IMU below 5 Hz."""


def published_frame(frame_id: str, reference_point: tuple[float, float]) -> str:
    """
    Return the frame of the predicted twist, which is that of the reference point (x, y), m.

    :param frame_id: the parameter of that name; empty: `base_link`, if that is the point.
    """
    return frame_id or (CENTRE_OF_GRAVITY if any(reference_point) else "base_link")


def rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the (3, 3) matrix from sensor to body axes (fixed-axis roll, pitch, yaw)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(msg: Any, axes: float = 0.0) -> tuple[float, float, float]:
    """
    Return x, y (m) and heading (rad) of an odometry message; zeros of one without a pose.

    :param axes: angle of odometry's axes against those whose heading is wanted, rad.
    """
    if not hasattr(msg, "pose"):
        return 0.0, 0.0, 0.0
    position, q = msg.pose.pose.position, msg.pose.pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return float(position.x), float(position.y), heading - axes


def shift_velocity(
    v_x: float, v_y: float, yaw_rate: float, x: float, y: float
) -> tuple[float, float]:
    """Return the velocity (m/s) of the point at (x, y) m from the point with (v_x, v_y)."""
    return v_x - yaw_rate * y, v_y + yaw_rate * x


def odometry_velocity(
    velocities: FloatArray, reference_point: tuple[float, float], axes: float
) -> FloatArray:
    """
    Return the velocities (n, 3) of odometry's child frame from those of the reference point.

    :param velocities: v_x, v_y, yaw rate in the axes of the vehicle.
    :param reference_point: from the origin of the child frame, in the axes of the vehicle, m.
    :param axes: angle of the child frame's axes against those of the vehicle, rad.
    """
    x, y = reference_point
    rate = velocities[:, 2]
    shifted = velocities + np.column_stack([rate * y, -rate * x, np.zeros_like(rate)])
    return shifted @ rotation(0.0, 0.0, axes)


def odometry_covariance(
    covariance: FloatArray, reference_point: tuple[float, float], axes: float
) -> FloatArray:
    """Return the covariances (n, 3, 3) of what `odometry_velocity` returns, from those given."""
    moved = odometry_velocity(np.eye(3), reference_point, axes).T
    return np.asarray(moved @ covariance @ moved.T)


class LeverArm:
    """
    Transforms specific force from an IMU at (x, y) m from the reference point to that point.

    a_ref = a_imu - dw/dt x r + w^2 r. The angular acceleration is the difference quotient of the
    gyro, passed through a first-order low-pass of 50 ms; only this part has memory.
    """

    def __init__(self, x: float, y: float) -> None:
        self._x = x
        self._y = y
        self._stamp_ns: int | None = None
        self._yaw_rate = 0.0
        self._yaw_acceleration = 0.0

    def compensate(
        self, stamp_ns: int, a_x: float, a_y: float, yaw_rate: float
    ) -> tuple[float, float]:
        """Return (a_x, a_y) in m/s² at the reference point; unchanged if the arm is zero."""
        if self._x == 0.0 and self._y == 0.0:
            return a_x, a_y
        elapsed_s = math.inf if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * 1e-9
        if abs(elapsed_s) > _MAX_GAP_S:
            # The first value, or one with an implausible stamp: its effect must not persist.
            self._yaw_acceleration = 0.0
            self._stamp_ns, self._yaw_rate = stamp_ns, yaw_rate
        elif elapsed_s > 0.0:
            raw = (yaw_rate - self._yaw_rate) / elapsed_s
            raw = min(max(raw, -_MAX_YAW_ACCELERATION), _MAX_YAW_ACCELERATION)
            gain = elapsed_s / (elapsed_s + _RATE_FILTER_S)
            self._yaw_acceleration += gain * (raw - self._yaw_acceleration)
            self._stamp_ns, self._yaw_rate = stamp_ns, yaw_rate
        squared = yaw_rate * yaw_rate
        return (
            a_x + self._yaw_acceleration * self._y + squared * self._x,
            a_y - self._yaw_acceleration * self._x + squared * self._y,
        )

    def reset(self) -> None:
        """Discard the previous gyro value, after a clock jump."""
        self._stamp_ns = None
        self._yaw_acceleration = 0.0
