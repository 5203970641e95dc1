# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters for known errors of sensors and steering, which `adk check` proposes."""

from __future__ import annotations

import math

from adk_ros.ros.parameter_spec import ParameterSpec
from adk_ros.signals.corrections import MAX_DELAY_S

CORRECTION_TABLE: tuple[ParameterSpec, ...] = (
    ParameterSpec(
        "accelerometer_scale",
        1.0,
        "Accelerations of the IMU over those in m/s²; 0.102 for readings in g.",
        -1000.0,
        1000.0,
    ),
    ParameterSpec(
        "accelerometer_bias",
        [0.0, 0.0],
        "Bias of the accelerations (a_x, a_y) in vehicle axes, m/s².",
        -50.0,
        50.0,
    ),
    ParameterSpec(
        "gyro_scale",
        1.0,
        "Yaw rate of the gyro over that in rad/s; 57.3 for readings in deg/s.",
        -1000.0,
        1000.0,
    ),
    ParameterSpec("gyro_bias", 0.0, "Bias of the gyro's yaw rate, rad/s.", -20.0, 20.0),
    ParameterSpec(
        "odometry_scale",
        1.0,
        "Velocities of odometry over those in m/s; 3.6 for readings in km/h.",
        -1000.0,
        1000.0,
    ),
    ParameterSpec(
        "odometry_rotation",
        0.0,
        "Axes of odometry against those of the vehicle, rad, positive to the left.",
        -math.pi,
        math.pi,
    ),
    ParameterSpec(
        "yaw_rate_scale",
        1.0,
        "Yaw rate of odometry over that in rad/s; -1: positive to the right.",
        -1000.0,
        1000.0,
    ),
    ParameterSpec("yaw_rate_bias", 0.0, "Bias of odometry's yaw rate, rad/s.", -20.0, 20.0),
    ParameterSpec(
        "torque_scale",
        1.0,
        "Commanded torque over that in N·m; 0.001 for commands in kN m; -1: positive slows down.",
        -1e6,
        1e6,
    ),
    ParameterSpec(
        "steering_offset",
        0.0,
        "Steering angle of straight driving, rad at the road wheels; it is subtracted.",
        -1.0,
        1.0,
    ),
    ParameterSpec(
        "imu_delay",
        0.0,
        "By how much the stamps of the IMU are late, s.",
        0.0,
        MAX_DELAY_S,
    ),
    ParameterSpec(
        "odometry_delay",
        0.0,
        "By how much the stamps of odometry are late, s.",
        0.0,
        MAX_DELAY_S,
    ),
    ParameterSpec(
        "command_delay",
        0.0,
        "By how much the stamps of the command, and of plans, are late, s; not a lag of the "
        "actuators, which the model learns.",
        0.0,
        MAX_DELAY_S,
    ),
)
