# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Faults of sensors and steering by which two recordings of one vehicle may differ.

A fault is its inverse: how the signals of a recording that has it become those without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.calibration.criteria import MATERIAL, PERIOD_S
from adk_ros.calibration.grid import Signals, shifted
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.signals.frames import rotation

Corrected = Callable[[Signals, float], Signals]


@dataclass(frozen=True)
class Fault:
    """
    A fault with one size.

    `name` as in the effect catalogue, `component`: which of its sizes, "" if it has one. `unit`,
    `material`: smallest size of a claim, that of a car of `REFERENCE_WHEELBASE` if `is_length`;
    `nominal`: size without a fault. `remove(s, size)`: signals without a fault of that size.
    `needs`: relations that show it, one of which the recordings must have. `excitation`: driving
    that would decide it. `is_of_road`: slope or bank of another course looks the same.
    """

    name: str
    component: str
    unit: str
    material: float
    remove: Corrected
    needs: tuple[str, ...]
    excitation: str
    nominal: float = 0.0
    is_length: bool = False
    is_of_road: bool = False

    @property
    def label(self) -> str:
        """Name with the component, as "imu_bias.a_x"."""
        return f"{self.name}.{self.component}" if self.component else self.name


def _accelerometer(axis: int) -> Corrected:
    def remove(s: Signals, size: float) -> Signals:
        assert s.a is not None
        a = s.a.copy()
        a[axis] -= size
        return replace(s, a=a)

    return remove


def _gyro_bias(s: Signals, size: float) -> Signals:
    assert s.w is not None
    return replace(s, w=np.vstack([s.w[:2], s.w[2:] - size]))


def _gyro_scale(s: Signals, size: float) -> Signals:
    assert s.w is not None
    return replace(s, w=np.vstack([s.w[:2], s.w[2:] / size]))


def _tilt(axis: int) -> Corrected:
    """Return the removal of a mounting angle: roll (0) or pitch (1)."""

    def remove(s: Signals, size: float) -> Signals:
        angles = [0.0, 0.0, 0.0]
        angles[axis] = size
        matrix = rotation(*angles)
        a = s.a
        if a is not None and abs(float(a[2].mean())) < 0.5 * GRAVITY:
            # Not recorded, or without gravity: the axes of a_x and a_y have felt it all the same.
            a = np.vstack([a[:2], a[2:] + GRAVITY])
        turned = None if a is None else matrix @ a
        if turned is not None and a is not s.a:
            turned[2] -= GRAVITY
        w = s.w
        if w is not None and float(np.ptp(w[:2])) > 0.0:
            w = matrix @ w
        return replace(s, a=turned, w=w)

    return remove


def _lever_arm(axis: int) -> Corrected:
    def remove(s: Signals, size: float) -> Signals:
        assert s.a is not None
        assert s.turning is not None
        rate, square = np.gradient(s.turning, PERIOD_S), s.turning**2
        felt = (-square, rate) if axis == 0 else (-rate, -square)
        return replace(s, a=np.vstack([s.a[:2] - size * np.vstack(felt), s.a[2:]]))

    return remove


def _axes_earlier(values: FloatArray | None, by_s: float) -> FloatArray | None:
    return None if values is None else np.vstack([shifted(axis, -by_s) for axis in values])


def _earlier(values: FloatArray | None, by_s: float) -> FloatArray | None:
    return None if values is None else shifted(values, -by_s)


def _imu_delay(s: Signals, size: float) -> Signals:
    return replace(s, a=_axes_earlier(s.a, size), w=_axes_earlier(s.w, size))


def _odometry_scale(s: Signals, size: float) -> Signals:
    assert s.v_x is not None
    return replace(s, v_x=s.v_x / size, v_y=None if s.v_y is None else s.v_y / size)


def _odometry_filter(s: Signals, size: float) -> Signals:
    assert s.yaw_rate is not None
    return replace(s, yaw_rate=s.yaw_rate + size * np.gradient(s.yaw_rate, PERIOD_S))


def _steering_offset(s: Signals, size: float) -> Signals:
    assert s.steering is not None
    return replace(s, steering=s.steering - size)


def _steering_ratio(s: Signals, size: float) -> Signals:
    assert s.steering is not None
    return replace(s, steering=s.steering / size)


def _steering_delay(s: Signals, size: float) -> Signals:
    return replace(s, steering=_earlier(s.steering, -size))


def _clock_offset(s: Signals, size: float) -> Signals:
    return replace(s, steering=_earlier(s.steering, -size), torque=_earlier(s.torque, -size))


REFERENCE_WHEELBASE = 2.8
"""m, of a passenger car."""
_LATENCY = MATERIAL["time_offset"].size
_STEERING = ("steering", "fast_steering")
_ACCELERATIONS = ("a_x", "a_y")
_STEPS = "step steers and changes of torque"

FAULTS = (
    Fault("imu_bias", "a_x", "m/s²", MATERIAL["a_x_offset"].size, _accelerometer(0), ("a_x",),
          "the same closed course, in both directions", is_of_road=True),
    Fault("imu_bias", "a_y", "m/s²", MATERIAL["a_y_offset"].size, _accelerometer(1), ("a_y",),
          "the same closed course, in both directions", is_of_road=True),
    Fault("imu_bias", "gyro", "rad/s", MATERIAL["gyro_bias"].size, _gyro_bias,
          ("gyro", "a_y", *_STEERING),
          "straights or a standstill, with a pose or a second yaw rate"),
    Fault("imu_tilt", "roll", "rad", MATERIAL["tilt"].size, _tilt(0), ("a_y", "gyro_y"),
          "the same closed course, and a gyro of three axes", is_of_road=True),
    Fault("imu_tilt", "pitch", "rad", MATERIAL["tilt"].size, _tilt(1), ("a_x", "gyro_x"),
          "the same closed course, and a gyro of three axes", is_of_road=True),
    Fault("imu_lever_arm", "x", "m", MATERIAL["imu_position"].size, _lever_arm(0),
          _ACCELERATIONS, "fast steering and tight bends", is_length=True),
    Fault("imu_lever_arm", "y", "m", MATERIAL["imu_position"].size, _lever_arm(1),
          _ACCELERATIONS, "fast steering and tight bends", is_length=True),
    Fault("imu_delay", "", "s", _LATENCY, _imu_delay, ("gyro", *_ACCELERATIONS), _STEPS),
    Fault("odometry_scale", "", "1", MATERIAL["odometry_scale"].size, _odometry_scale,
          ("velocity", *_ACCELERATIONS), "a known distance, or changes of speed", 1.0),
    Fault("gyro_scale", "", "1", MATERIAL["gyro_scale"].size, _gyro_scale,
          ("gyro", "a_y", *_STEERING), "a full circle, with a pose or a second yaw rate", 1.0),
    Fault("odometry_filter", "", "s", MATERIAL["filter"].size, _odometry_filter,
          ("yaw_rate", "gyro"), "fast steering"),
    Fault("clock_offset", "", "s", _LATENCY, _clock_offset, (*_STEERING, "drive"), _STEPS),
    Fault("steering_delay", "", "s", _LATENCY, _steering_delay, _STEERING, "step steers"),
    Fault("steering_offset", "", "rad", MATERIAL["steering_offset"].size, _steering_offset,
          _STEERING, "straights of the same course", is_of_road=True),
    Fault("steering_ratio", "", "1", MATERIAL["steering_ratio"].size, _steering_ratio,
          _STEERING, "bends below 4 m/s²", 1.0),
)  # fmt: skip
"""The faults in the order in which they are named. Signs as in the effect catalogue."""
