# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Quantities of one recording that need no vehicle model, by regression.

- Lateral: v_x delta(t - delay) = b_0 r + b_1 v_x a + b_2 v_x + b_3 v_x dr/dt, with a = v_x r +
  dv_y/dt: the linear single-track model without its side-slip angle. b_0 is the wheelbase over the
  steering gain, b_1 the understeer gradient, b_2 the steering offset, b_3 the yaw inertia times
  the compliance of both axles. The products of r and a with dv_x/dt follow the load transfer.
- Longitudinal: T(t - delay) = b_0 a_x + b_1 v_x^2 + b_2 + b_3 v_x r delta + b_4 (v_x r)^2:
  accelerated mass times wheel radius, air drag, resistance at zero speed, and cornering drag.
- Sensors: gyro against odometry, IMU against the change of velocity, odometry against the pose.

ISO 4138 and ISO 7401 define the lateral quantities, ISO 10521-1 those of a coast-down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.recording.common_driving import (
    PERIOD_S,
    DrivingSignals,
    delayed,
    smooth,
)
from adk_ros.mismatch.recording.delayed_regression import (
    Regression,
    regress,
    regress_delayed,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY


@dataclass(frozen=True)
class Quantity:
    """A quantity of one recording: its value and resampled values (r,)."""

    value: float
    resampled: FloatArray


def quantities(
    s: DrivingSignals, weights: FloatArray, speed: float, wheel_radius: float
) -> Iterator[tuple[str, Quantity]]:
    """
    Yield the quantities that a recording allows, by name.

    `weights` (n,) of the samples; the steering gain is that at `speed`.
    """
    yield from _lateral(s, weights, speed)
    if np.ptp(s.pose_speed) > 0.0:
        yield from _named(regress(s.pose_speed[:, None], s.v_x, weights), ("odometry_scale",))
    if not s.has_imu:
        return
    yield from _longitudinal(s, weights, wheel_radius)
    yield from _sensors(s, weights)


def _lateral(
    s: DrivingSignals, weights: FloatArray, speed: float
) -> Iterator[tuple[str, Quantity]]:
    sideways = s.lateral + np.gradient(s.v_y, PERIOD_S)
    columns = _turning_columns(s, s.yaw_rate, sideways)
    instruments = _turning_columns(s, s.gyro, s.a_y) if s.has_imu else columns

    def target(delay_s: float) -> FloatArray:
        return np.asarray(s.v_x * smooth(delayed(s.steering, delay_s)))

    found = regress_delayed(columns, target, weights, instruments)
    if found is None:
        return
    names = ("", "understeer_gradient", "steering_offset", "yaw_compliance")
    yield from _named(found, (*names, "", "", "steering_delay"))
    per_curvature = found.values[0] + found.values[1] * speed**2
    resampled = found.resampled[:, 0] + found.resampled[:, 1] * speed**2
    yield "steering_gain", Quantity(1.0 / per_curvature, 1.0 / resampled)


def _turning_columns(s: DrivingSignals, yaw_rate: FloatArray, sideways: FloatArray) -> FloatArray:
    """Return the columns (n, 6) of the lateral equation from a yaw rate and an acceleration."""
    forward = np.gradient(s.v_x, PERIOD_S)
    turning = [yaw_rate, s.v_x * sideways]
    # The wheel loads, and with them the cornering stiffnesses, follow the acceleration.
    transfer = [each * forward for each in turning]
    return np.column_stack([*turning, s.v_x, s.v_x * np.gradient(yaw_rate, PERIOD_S), *transfer])


def _longitudinal(
    s: DrivingSignals, weights: FloatArray, wheel_radius: float
) -> Iterator[tuple[str, Quantity]]:
    drag = 0.5 * AIR_DENSITY * wheel_radius * s.v_x**2
    cornering = [s.lateral * smooth(s.steering), s.lateral**2]
    columns = np.column_stack([s.a_x, drag, np.ones_like(drag), *cornering])

    def target(delay_s: float) -> FloatArray:
        return smooth(delayed(s.torque, delay_s))

    names = ("torque_per_acceleration", "drag_area", "resistance", "", "", "torque_response")
    yield from _named(regress_delayed(columns, target, weights), names)


def _sensors(s: DrivingSignals, weights: FloatArray) -> Iterator[tuple[str, Quantity]]:
    ones = np.ones_like(s.v_x)

    def target(delay_s: float) -> FloatArray:
        return delayed(s.gyro, delay_s)

    names = ("gyro_scale", "gyro_offset", "gyro_response")
    columns = np.column_stack([s.yaw_rate, ones])
    yield from _named(regress_delayed(columns, target, weights), names)
    forward = np.gradient(s.v_x, PERIOD_S) - s.v_y * s.yaw_rate
    yield from _named(regress(ones[:, None], s.a_x - forward, weights), ("longitudinal_offset",))
    sideways = np.gradient(s.v_y, PERIOD_S) + s.lateral
    columns = np.column_stack([sideways, ones])
    yield from _named(regress(columns, s.a_y, weights), ("", "lateral_offset"))


def _named(found: Regression | None, names: tuple[str, ...]) -> Iterator[tuple[str, Quantity]]:
    """Yield the coefficients that have a name."""
    if found is None:
        return
    for i, name in enumerate(names):
        if name:
            yield name, Quantity(float(found.values[i]), found.resampled[:, i])
