# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of a message as a row of numbers, as they stand: nothing is refused or corrected."""

from __future__ import annotations

import math
from typing import Any

from adk_ros.signals.decode import MAX_VARIANCE, NOT_MEASURED, SensorConfig
from adk_ros.signals.velocity_messages import ODOMETRY_TYPES


def stamp_s(msg: Any) -> float:
    """Return the stamp of a message in s; Autoware messages have no header."""
    stamp = msg.header.stamp if hasattr(msg, "header") else msg.stamp
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def imu_row(msg: Any) -> list[float]:
    """Return stamp, acceleration and angular velocity (7,); NaN where it is not reported."""
    force, rate = msg.linear_acceleration, msg.angular_velocity
    a = [float(force.x), float(force.y), float(force.z)]
    w = [float(rate.x), float(rate.y), float(rate.z)]
    # REP-145: a first covariance element of -1 marks a field that is not reported.
    if msg.linear_acceleration_covariance[0] == -1.0:
        a = [math.nan] * 3
    if msg.angular_velocity_covariance[0] == -1.0:
        w = [math.nan] * 3
    return [stamp_s(msg), *a, *w]


def odometry_row(msg: Any) -> list[float]:
    """
    Return stamp, v_x, v_y, yaw rate, x, y and heading (7,).

    NaN for a v_y that the covariance marks as not measured and that is an estimate, and for a
    position or heading so marked, as `adk import` writes it in gaps.
    """
    twist, pose = msg.twist.twist, msg.pose.pose
    q = pose.orientation
    heading = math.atan2(
        2.0 * (float(q.w) * float(q.z) + float(q.x) * float(q.y)),
        1.0 - 2.0 * (float(q.y) ** 2 + float(q.z) ** 2),
    )
    v_y = float(twist.linear.y)
    if v_y != 0.0 and float(msg.twist.covariance[7]) >= MAX_VARIANCE:
        v_y = math.nan
    variance, point = msg.pose.covariance, pose.position
    return [
        stamp_s(msg),
        float(twist.linear.x),
        v_y,
        float(twist.angular.z),
        _unless_in_gap(float(point.x), float(variance[0])),
        _unless_in_gap(float(point.y), float(variance[7])),
        _unless_in_gap(heading, float(variance[35])),
    ]


def _unless_in_gap(value: float, variance: float) -> float:
    # What is never measured is zero, and marked as well. The variance of a dead-reckoned position
    # grows beyond that of velocities, but hardly to that of the mark.
    return math.nan if value != 0.0 and variance >= NOT_MEASURED else value


def height_row(msg: Any) -> list[float]:
    """Return stamp and height z of the pose, m (2,), of an Odometry; NaN in gaps of its x."""
    # Planar odometry marks its z whatever that is, so only x tells a gap.
    x = _unless_in_gap(float(msg.pose.pose.position.x), float(msg.pose.covariance[0]))
    return [stamp_s(msg), math.nan if math.isnan(x) else float(msg.pose.pose.position.z)]


def velocity_row(msg: Any, sensors: SensorConfig) -> list[float]:
    """Return a row as `odometry_row` of wheel speeds or a velocity over ground (7,)."""
    v_x, v_y, yaw_rate = ODOMETRY_TYPES[sensors.odometry_type].decode(msg, sensors)
    return [stamp_s(msg), v_x, v_y, yaw_rate, math.nan, math.nan, math.nan]


def request_row(msg: Any) -> list[float]:
    """Return stamp, acceleration and road-wheel angle of an Ackermann or Autoware command (3,)."""
    at = stamp_s(msg)
    if hasattr(msg, "drive"):
        return [at, float(msg.drive.acceleration), float(msg.drive.steering_angle)]
    return [at, float(msg.longitudinal.acceleration), float(msg.lateral.steering_tire_angle)]
