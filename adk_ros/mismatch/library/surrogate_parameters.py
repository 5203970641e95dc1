# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameters of the surrogate model: one flat vector for vehicle, tyres, effects and sensors.

Each number that the equations of motion use has a name here, a default (typical, or without
influence) and bounds. An effect adds an amount to one or two entries: always, at a place or from a
time on. SI units and radians.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adk_ros.numerics.arrays import FloatArray


class SurrogateParameter(NamedTuple):
    """One entry of the parameter vector."""

    default: float
    low: float
    high: float
    unit: str
    description: str


SURROGATE_PARAMETERS: dict[str, SurrogateParameter] = {
    # The vehicle.
    "mass": SurrogateParameter(1500.0, 0.05, 1e5, "kg", "mass"),
    "yaw_inertia": SurrogateParameter(2500.0, 1e-5, 1e6, "kg m^2", "yaw inertia"),
    "cg_to_front_axle": SurrogateParameter(
        1.3, 0.01, 10.0, "m", "centre of gravity to front axle"
    ),
    "cg_to_rear_axle": SurrogateParameter(1.3, 0.01, 10.0, "m", "centre of gravity to rear axle"),
    "track_width": SurrogateParameter(1.6, 0.02, 5.0, "m", "track width"),
    "cg_height": SurrogateParameter(0.53, 0.0, 4.0, "m", "height of the centre of gravity"),
    "wheel_radius": SurrogateParameter(0.325, 0.005, 1.5, "m", "wheel radius"),
    "wheel_inertia": SurrogateParameter(
        5.2, 0.0, 500.0, "kg m^2", "spin inertia of all four wheels"
    ),
    "spin_up_inertia": SurrogateParameter(
        0.0, -50.0, 500.0, "kg m^2", "part of it whose spin-up the torque's lag does not contain"
    ),
    "slip_compliance": SurrogateParameter(
        1.0 / 21.5, 0.0, 0.3, "-", "wheel load over the longitudinal slip stiffness of the tyres"
    ),
    "side_force_area": SurrogateParameter(3.2, 0.0, 100.0, "m^2", "side force area of the wind"),
    "yaw_moment_volume": SurrogateParameter(
        1.1, -100.0, 100.0, "m^3", "yaw moment volume of the wind"
    ),
    # Tyres, by axle: lateral Magic Formula; stiffness is slip stiffness over wheel load.
    "stiffness_f": SurrogateParameter(
        18.0, 3.0, 80.0, "1/rad", "front slip stiffness over wheel load"
    ),
    "stiffness_r": SurrogateParameter(
        20.0, 3.0, 80.0, "1/rad", "rear slip stiffness over wheel load"
    ),
    "shape_f": SurrogateParameter(1.4, 0.7, 1.98, "-", "front Magic Formula C"),
    "shape_r": SurrogateParameter(1.4, 0.7, 1.98, "-", "rear Magic Formula C"),
    "curvature_f": SurrogateParameter(-0.3, -6.0, 1.8, "-", "front Magic Formula E"),
    "curvature_r": SurrogateParameter(-0.3, -6.0, 1.8, "-", "rear Magic Formula E"),
    "grip_f": SurrogateParameter(1.0, 0.05, 3.0, "-", "front peak force over wheel load"),
    "grip_r": SurrogateParameter(1.0, 0.05, 3.0, "-", "rear peak force over wheel load"),
    "brush_share": SurrogateParameter(
        0.0, -0.5, 1.5, "-", "share of the brush model in the tyre curve"
    ),
    "load_sensitivity": SurrogateParameter(
        0.0, -0.5, 0.9, "-", "share of grip lost when the load doubles"
    ),
    "stiffness_falloff": SurrogateParameter(
        0.0, -0.5, 0.9, "-", "share of stiffness over load lost when the load doubles"
    ),
    "combined_slip": SurrogateParameter(
        1.0, 0.0, 3.0, "-", "reduction of lateral by longitudinal force (1: circle)"
    ),
    "relaxation_length": SurrogateParameter(0.0, 0.0, 5.0, "m", "relaxation length"),
    "roll_share_front": SurrogateParameter(
        0.55, 0.0, 1.0, "-", "front share of the lateral load transfer"
    ),
    # Sprung mass: its angle to the road gives an accelerometer a share of gravity.
    "roll_gradient": SurrogateParameter(
        0.0, -0.03, 0.03, "rad s^2/m", "roll per lateral acceleration"
    ),
    "roll_frequency": SurrogateParameter(10.0, 2.0, 40.0, "rad/s", "natural frequency of roll"),
    "roll_damping": SurrogateParameter(0.5, 0.05, 3.0, "-", "damping ratio of roll"),
    "roll_arm": SurrogateParameter(
        0.0, -2.0, 2.0, "m", "height of the roll axis above the contact, in slip angles"
    ),
    "pitch_gradient": SurrogateParameter(
        0.0, -0.03, 0.03, "rad s^2/m", "pitch per longitudinal acceleration"
    ),
    "pitch_frequency": SurrogateParameter(10.0, 2.0, 40.0, "rad/s", "natural frequency of pitch"),
    "pitch_damping": SurrogateParameter(0.5, 0.05, 3.0, "-", "damping ratio of pitch"),
    "load_springs": SurrogateParameter(
        0.0, -0.5, 1.5, "-", "share of the load transfer that follows the sprung mass"
    ),
    "load_lag": SurrogateParameter(
        0.0, 0.0, 1.0, "s", "lag of the wheel loads behind the accelerations"
    ),
    "torque_split_front": SurrogateParameter(0.5, 0.0, 1.0, "-", "front share of the torque"),
    "drag_area": SurrogateParameter(0.0, -5.0, 20.0, "m^2", "drag area"),
    "lift_area": SurrogateParameter(0.0, -20.0, 20.0, "m^2", "downforce area, both axles"),
    "rolling": SurrogateParameter(0.0, -0.1, 0.3, "-", "rolling resistance over wheel load"),
    # Command response.
    "steer_gain": SurrogateParameter(1.0, 0.2, 3.0, "-", "road-wheel angle over the command"),
    "steer_offset": SurrogateParameter(0.0, -0.3, 0.3, "rad", "road-wheel angle at zero command"),
    "steer_delay": SurrogateParameter(0.0, -0.2, 1.0, "s", "dead time of the steering"),
    "steer_lag": SurrogateParameter(0.0, 0.0, 2.0, "s", "first-order lag of the steering"),
    "steer_lag_more": SurrogateParameter(0.0, 0.0, 2.0, "s", "a second lag in series"),
    "steer_half_gap": SurrogateParameter(
        0.0, 0.0, 0.1, "rad", "half the backlash of the steering"
    ),
    "steer_compliance": SurrogateParameter(
        0.0, -0.05, 0.05, "rad s^2/m", "steering angle lost per lateral acceleration"
    ),
    "rear_steer": SurrogateParameter(0.0, -1.0, 1.0, "-", "rear over front road-wheel angle"),
    "torque_gain": SurrogateParameter(1.0, 0.05, 3.0, "-", "wheel torque over the command"),
    "brake_gain": SurrogateParameter(1.0, 0.05, 3.0, "-", "braking torque over the command"),
    "torque_offset": SurrogateParameter(0.0, -5e3, 5e3, "N m", "wheel torque at zero command"),
    "torque_delay": SurrogateParameter(0.0, -0.2, 1.0, "s", "dead time of the torque"),
    "torque_lag": SurrogateParameter(0.0, 0.0, 3.0, "s", "first-order lag of the torque"),
    "torque_lag_more": SurrogateParameter(0.0, 0.0, 3.0, "s", "a second lag in series"),
    "power_inverse": SurrogateParameter(0.0, 0.0, 1e-3, "1/W", "inverse of the maximum power"),
    "side_drag": SurrogateParameter(
        0.0, -3e3, 3e3, "N m", "brake torque of each wheel on one side, left +"
    ),
    "drive_yaw_moment": SurrogateParameter(
        0.0, -2.0, 2.0, "-", "yaw moment over the driving torque, left +"
    ),
    "command_delay": SurrogateParameter(
        0.0, -1.0, 1.0, "s", "delay of all commands after their stamps"
    ),
    # The road and the air.
    "grade": SurrogateParameter(0.0, -0.4, 0.4, "rad", "grade, climb +"),
    "bank": SurrogateParameter(0.0, -0.4, 0.4, "rad", "bank, left side up +"),
    "friction": SurrogateParameter(1.0, 0.05, 2.0, "-", "friction of the road, relative"),
    "wind_x": SurrogateParameter(0.0, -60.0, 60.0, "m/s", "wind along the x axis of the vehicle"),
    "wind_y": SurrogateParameter(0.0, -60.0, 60.0, "m/s", "wind along the y axis of the vehicle"),
    # Forces beyond the catalogue, as accelerations, and a further steering angle.
    "extra_x": SurrogateParameter(
        0.0, -20.0, 20.0, "m/s^2", "further longitudinal specific force"
    ),
    "extra_y": SurrogateParameter(0.0, -20.0, 20.0, "m/s^2", "further lateral specific force"),
    "extra_yaw": SurrogateParameter(0.0, -20.0, 20.0, "rad/s^2", "further yaw acceleration"),
    "extra_steer": SurrogateParameter(0.0, -0.5, 0.5, "rad", "further road-wheel angle"),
    # The sensors.
    "bias_a_x": SurrogateParameter(0.0, -5.0, 5.0, "m/s^2", "bias of the accelerometer, x"),
    "bias_a_y": SurrogateParameter(0.0, -5.0, 5.0, "m/s^2", "bias of the accelerometer, y"),
    "bias_gyro": SurrogateParameter(0.0, -1.0, 1.0, "rad/s", "bias of the gyro"),
    "arm_x": SurrogateParameter(0.0, -5.0, 5.0, "m", "IMU ahead of the centre of gravity"),
    "arm_y": SurrogateParameter(0.0, -5.0, 5.0, "m", "IMU left of the centre of gravity"),
    "imu_delay": SurrogateParameter(0.0, -0.5, 0.5, "s", "delay of the IMU against the odometry"),
    "gyro_gain": SurrogateParameter(1.0, 0.2, 3.0, "-", "gyro reading over yaw rate"),
    "odometry_gain": SurrogateParameter(1.0, 0.2, 3.0, "-", "odometry reading over v_x"),
    "odometry_lag": SurrogateParameter(
        0.0, 0.0, 2.0, "s", "time constant of the odometry's yaw-rate filter"
    ),
}

NAMES = tuple(SURROGATE_PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
SIZE = len(NAMES)
LOW: FloatArray = np.array([entry.low for entry in SURROGATE_PARAMETERS.values()])
HIGH: FloatArray = np.array([entry.high for entry in SURROGATE_PARAMETERS.values()])


def default_parameters() -> FloatArray:
    """Return the parameters (SIZE,) of a typical car without any effect."""
    return np.array([entry.default for entry in SURROGATE_PARAMETERS.values()])
