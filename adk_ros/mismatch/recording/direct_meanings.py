# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meaning of the quantities of a direct comparison: words, tolerance, effects that change them."""

from __future__ import annotations

from dataclasses import dataclass

from adk_ros.mismatch.library.catalogue import EFFECTS

_TYRES = ("front_tyre_stiffness", "rear_tyre_stiffness", "cg_shift", "low_friction")
_LOADS = ("payload", "aero_downforce", "load_sensitivity", "power_limit")
_YAW_SENSORS = ("odometry_scale", "odometry_filter")
_STEADY = (*_TYRES, *_LOADS, "rear_wheel_steer", *_YAW_SENSORS)
"""Effects that change any steady-state turn."""
_TRANSIENT = ("steering_lag", "tyre_relaxation", "steering_backlash", "clock_offset", *_STEADY)
"""Effects that change the response of the yaw rate to steering."""
_BRAKE = ("brake_torque_gain", "brake_drag_one_side")
_DRIVE = ("payload", "wheel_radius", "rotating_inertia", "power_limit", "brake_torque_gain")
_RESISTANCE = ("torque_offset", "headwind", "aero_drag", "power_limit")
_TURN = "both recordings turn quasi-steadily up to 3.5 m/s² lateral acceleration"
_LEVEL = "the same share of grades; wheels that do not slip"
_KINEMATIC = "none: both signals measure the same motion"


@dataclass(frozen=True)
class Meaning:
    """
    Words, tolerance and effects of a quantity, the most direct effect first.

    A `relative` tolerance is a share of the simulation's value.
    """

    quantity: str
    unit: str
    tolerance: float
    effects: tuple[str, ...]
    assumption: str
    relative: bool = False


def threshold(effect: str, parameter: int = 0) -> float:
    """Return the materiality threshold of an effect: less is within build tolerance."""
    return EFFECTS[effect].parameters[parameter].materiality_threshold


MEANINGS = {
    "steering_gain": Meaning(
        "path curvature per steering angle at the mean speed",
        "1/m",
        threshold("steering_ratio"),
        ("steering_ratio", "compliance_steer", *_STEADY),
        _TURN,
        relative=True,
    ),
    "understeer_gradient": Meaning(
        "understeer gradient",
        "rad s²/m",
        threshold("compliance_steer"),
        ("compliance_steer", "steering_ratio", *_STEADY),
        _TURN,
    ),
    "steering_offset": Meaning(
        "steering angle when driving straight",
        "rad",
        threshold("steering_offset"),
        ("steering_offset", "crosswind", "road_bank", "brake_drag_one_side", "steering_backlash"),
        _TURN,
    ),
    "yaw_compliance": Meaning(
        "steering angle per yaw acceleration",
        "s²",
        threshold("yaw_inertia"),
        ("yaw_inertia", "steering_delay", "steering_ratio", *_TRANSIENT),
        _TURN,
        relative=True,
    ),
    "steering_delay": Meaning(
        "response time of the yaw rate to steering",
        "s",
        threshold("steering_delay"),
        ("steering_delay", "yaw_inertia", *_TRANSIENT),
        "response time in the mean over the common speeds",
    ),
    "torque_per_acceleration": Meaning(
        "wheel torque per acceleration",
        "N m s²/m",
        threshold("drive_torque_gain"),
        ("drive_torque_gain", *_DRIVE, "drive_torque_lag", "imu_tilt"),
        _LEVEL,
        relative=True,
    ),
    "drag_area": Meaning(
        "drag area",
        "m²",
        threshold("aero_drag"),
        ("aero_drag", "rolling_resistance", "torque_offset", "headwind", "power_limit"),
        _LEVEL,
    ),
    "resistance": Meaning(
        "wheel torque at constant speed, without air drag",
        "N m",
        0.0,
        ("rolling_resistance", *_RESISTANCE, "imu_bias", "imu_tilt", *_BRAKE),
        _LEVEL,
    ),
    "torque_response": Meaning(
        "response time of the acceleration to torque",
        "s",
        threshold("drive_torque_delay"),
        ("drive_torque_delay", "drive_torque_lag", "clock_offset", "imu_delay"),
        _LEVEL,
    ),
    "gyro_scale": Meaning(
        "gyro over the yaw rate of odometry",
        "-",
        threshold("gyro_scale"),
        ("gyro_scale", "odometry_filter"),
        _KINEMATIC,
    ),
    "gyro_offset": Meaning(
        "gyro offset", "rad/s", threshold("imu_bias", 2), ("imu_bias",), _KINEMATIC
    ),
    "gyro_response": Meaning(
        "lead of the gyro over the yaw rate of odometry",
        "s",
        threshold("imu_delay"),
        ("imu_delay", "odometry_filter"),
        _KINEMATIC,
    ),
    "longitudinal_offset": Meaning(
        "specific force less the change of v_x",
        "m/s²",
        threshold("imu_bias"),
        ("imu_bias", "imu_tilt", "road_grade", "imu_lever_arm", "odometry_scale"),
        _KINEMATIC,
    ),
    "lateral_offset": Meaning(
        "lateral specific force when driving straight",
        "m/s²",
        threshold("imu_bias", 1),
        ("imu_bias", "imu_tilt", "road_bank", "imu_lever_arm"),
        _KINEMATIC,
    ),
    "odometry_scale": Meaning(
        "speed of odometry over that of the pose",
        "-",
        threshold("odometry_scale"),
        ("odometry_scale",),
        _KINEMATIC,
    ),
}
