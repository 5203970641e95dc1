# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Category of each effect: missing physics, or a calibration.

A calibration is an error of a sensor, of its mounting, of time stamps or of the conversion of the
command. The simulation lacks nothing because of it: the user sets a parameter of decoding
(`signals.decode.SensorConfig`) for recordings of the car instead. An actuator that is slow, weak
or loose is physics: no parameter describes it, and a model learns it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

PHYSICS, CALIBRATION = "physics", "calibration"

PARAMETERS: dict[str, tuple[str, ...]] = {
    "steering_offset": ("steering_offset",),
    "steering_ratio": ("steering_ratio",),
    "drive_torque_gain": ("torque_scale",),
    "clock_offset": ("imu_delay", "odometry_delay", "command_delay"),
    "imu_bias": ("accelerometer_bias", "gyro_bias"),
    "imu_tilt": ("imu_rotation",),
    "imu_lever_arm": ("imu_position",),
    "imu_delay": ("imu_delay", "odometry_delay", "command_delay"),
    "odometry_scale": ("odometry_scale",),
    "gyro_scale": ("gyro_scale",),
    "odometry_filter": (),
}
"""Calibration -> parameters of which one or more correct it; none corrects a filter."""

_PHYSICS = (
    "aero_drag",
    "headwind",
    "crosswind",
    "aero_downforce",
    "road_grade",
    "road_bank",
    "low_friction",
    "rolling_resistance",
    "front_tyre_stiffness",
    "rear_tyre_stiffness",
    "tyre_relaxation",
    "load_sensitivity",
    "payload",
    "cg_shift",
    "yaw_inertia",
    "rotating_inertia",
    "steering_delay",
    "steering_lag",
    "steering_backlash",
    "compliance_steer",
    "rear_wheel_steer",
    "brake_torque_gain",
    "drive_torque_delay",
    "drive_torque_lag",
    "torque_offset",
    "power_limit",
    "wheel_radius",
    "brake_drag_one_side",
)

CATEGORIES: dict[str, str] = {
    **dict.fromkeys(_PHYSICS, PHYSICS),
    **dict.fromkeys(PARAMETERS, CALIBRATION),
}
"""Effect -> category, for the whole catalogue."""


class Ambiguity(NamedTuple):
    """Two causes with the same equation, as clauses after "if"."""

    calibration: str
    physics: str


AMBIGUOUS = {
    "steering_offset": Ambiguity(
        "the zero of the steering command is wrong",
        "the car pulls to one side (cross slope, asymmetric set-up)",
    ),
    "steering_ratio": Ambiguity(
        "the steering command is scaled wrongly",
        "the steering of the car has another ratio than the simulated one",
    ),
    "drive_torque_gain": Ambiguity(
        "the torque command is scaled wrongly",
        "drive and brakes of the car give another torque than the simulated ones",
    ),
    "clock_offset": Ambiguity(
        "the time stamps are wrong",
        "steering and drive of the car have a common dead time",
    ),
}
"""Calibrations that no recording distinguishes from a difference of the car."""


def category_of(name: str) -> str:
    """Return the category of an effect; an effect outside the catalogue is physics."""
    return CATEGORIES.get(name, PHYSICS)


def is_ambiguous(name: str, alternatives: Sequence[str]) -> bool:
    """
    Whether causes of both categories explain a recording equally well.

    `alternatives`: effects that the recording does not distinguish from it.
    """
    return name in AMBIGUOUS or any(category_of(x) != category_of(name) for x in alternatives)
