# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor faults: identified and named, but never corrected by a change of the vehicle."""

from __future__ import annotations

from adk_ros.mismatch.library.effect import ALWAYS, TIME, Effect, EffectParameter
from adk_ros.numerics.constants import GRAVITY

SENSORS = (
    Effect(
        "imu_bias",
        (
            EffectParameter("ax", "m/s^2", -3.0, 3.0, 0.01, 0.02, {"bias_a_x": 1.0}),
            EffectParameter("ay", "m/s^2", -3.0, 3.0, 0.01, 0.02, {"bias_a_y": 1.0}),
            EffectParameter("gyro", "rad/s", -0.2, 0.2, 5e-4, 8e-4, {"bias_gyro": 1.0}),
        ),
        ("imu",),
        "reading = truth + bias",
        "any driving",
        ("imu_tilt",),
        "bias and tilt are distinguishable only if the yaw-rate bias is significant; otherwise "
        "measure at standstill in two opposite headings",
        (ALWAYS, TIME),
        True,
    ),
    Effect(
        "imu_tilt",
        (
            EffectParameter("roll", "rad", -0.3, 0.3, 0.001, 0.002, {"bias_a_y": GRAVITY}),
            EffectParameter("pitch", "rad", -0.3, 0.3, 0.001, 0.002, {"bias_a_x": -GRAVITY}),
        ),
        ("imu",),
        "a_y += g sin(roll), a_x -= g sin(pitch)",
        "any driving",
        ("imu_bias",),
        "bias and tilt are distinguishable only if the yaw-rate bias is significant; otherwise "
        "measure the mounting angles of the IMU",
        (ALWAYS, TIME),
        True,
    ),
    Effect(
        "imu_lever_arm",
        (
            EffectParameter("x", "m", -3.0, 3.0, 0.02, 0.06, {"arm_x": 1.0}),
            EffectParameter("y", "m", -3.0, 3.0, 0.05, 0.15, {"arm_y": 1.0}),
        ),
        ("imu",),
        "a = a_cg + dr/dt x arm - r^2 arm",
        "fast steering, tight corners",
        ("imu_delay",),
        "tight slaloms",
        (ALWAYS,),
        True,
    ),
    Effect(
        "imu_delay",
        (
            EffectParameter(
                "delay", "s", -0.1, 0.4, 0.004, 0.008, {"imu_delay": 1.0}, starts=(0.03, 0.1)
            ),
        ),
        ("imu",),
        "reading(t) = truth(t - delay)",
        "fast steering",
        ("clock_offset",),
        "torque steps and step steers",
        (ALWAYS, TIME),
        True,
    ),
    Effect(
        "odometry_scale",
        (EffectParameter("scale", "-", 0.7, 1.4, 0.002, 0.005, {"odometry_gain": 1.0}, 1.0),),
        ("odometry",),
        "reading = scale v_x",
        "any driving, if the pose is independent of the velocity",
        ("drive_torque_gain",),
        "a known distance",
        (ALWAYS, TIME),
        True,
    ),
    Effect(
        "gyro_scale",
        (EffectParameter("scale", "-", 0.6, 1.6, 0.002, 0.005, {"gyro_gain": 1.0}, 1.0),),
        ("imu",),
        "reading = scale yaw rate",
        "cornering",
        (),
        "a full circle",
        (ALWAYS, TIME),
        True,
    ),
    Effect(
        "odometry_filter",
        (
            EffectParameter(
                "tau", "s", 0.0, 1.0, 0.004, 0.015, {"odometry_lag": 1.0}, starts=(0.05, 0.2, 0.45)
            ),
        ),
        ("odometry",),
        "tau d(reading)/dt = yaw rate - reading",
        "fast steering",
        (),
        "step steers",
        (ALWAYS, TIME),
        True,
    ),
)
