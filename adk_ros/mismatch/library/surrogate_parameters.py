# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The stand-in's parameters: one flat vector that vehicle, tyres, effects and sensors share.

Every number that the kernels use has a name here, its value where nothing is known or nothing acts
(`usual`), and bounds. An effect is an amount added to one or two of these entries, always, at a
place or from a time on. SI units and radians.
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
    "mass": SurrogateParameter(1500.0, 50.0, 1e5, "kg", "mass"),
    "yaw_inertia": SurrogateParameter(2500.0, 10.0, 1e6, "kg m^2", "yaw inertia"),
    "cg_to_front_axle": SurrogateParameter(1.3, 0.2, 10.0, "m", "centre of gravity to front axle"),
    "cg_to_rear_axle": SurrogateParameter(1.3, 0.2, 10.0, "m", "centre of gravity to rear axle"),
    "track_width": SurrogateParameter(1.6, 0.3, 5.0, "m", "track width"),
    "cg_height": SurrogateParameter(0.53, 0.0, 4.0, "m", "height of the centre of gravity"),
    "wheel_radius": SurrogateParameter(0.325, 0.1, 1.5, "m", "wheel radius"),
    "wheel_inertia": SurrogateParameter(
        5.2, 0.0, 500.0, "kg m^2", "spin inertia of all wheels together"
    ),
    "side_force_area": SurrogateParameter(3.2, 0.0, 100.0, "m^2", "side force of the wind"),
    "yaw_moment_volume": SurrogateParameter(1.1, -100.0, 100.0, "m^3", "yaw moment of the wind"),
    # Tyres, by axle: lateral Magic Formula; stiffness is slip stiffness over wheel load.
    "stiffness_f": SurrogateParameter(18.0, 3.0, 80.0, "1/rad", "front slip stiffness over load"),
    "stiffness_r": SurrogateParameter(20.0, 3.0, 80.0, "1/rad", "rear slip stiffness over load"),
    "shape_f": SurrogateParameter(1.4, 0.7, 1.98, "-", "front Magic Formula C"),
    "shape_r": SurrogateParameter(1.4, 0.7, 1.98, "-", "rear Magic Formula C"),
    "curvature_f": SurrogateParameter(-0.3, -6.0, 1.8, "-", "front Magic Formula E"),
    "curvature_r": SurrogateParameter(-0.3, -6.0, 1.8, "-", "rear Magic Formula E"),
    "grip_f": SurrogateParameter(1.0, 0.05, 3.0, "-", "front peak force over load"),
    "grip_r": SurrogateParameter(1.0, 0.05, 3.0, "-", "rear peak force over load"),
    "brush_share": SurrogateParameter(
        0.0, -0.5, 1.5, "-", "share of the brush model in the tyres' curve"
    ),
    "load_sensitivity": SurrogateParameter(
        0.0, -0.5, 0.9, "-", "share of grip lost as the load doubles"
    ),
    "stiffness_falloff": SurrogateParameter(
        0.0, -0.5, 0.9, "-", "the same of the slip stiffness over load"
    ),
    "combined_slip": SurrogateParameter(
        1.0, 0.0, 3.0, "-", "how much longitudinal force takes of lateral"
    ),
    "relaxation_length": SurrogateParameter(
        0.0, 0.0, 5.0, "m", "rolling distance of the slip's build-up"
    ),
    "roll_share_front": SurrogateParameter(
        0.55, 0.0, 1.0, "-", "front share of the lateral load transfer"
    ),
    # The body on its springs: what an accelerometer strapped to it makes of gravity.
    "roll_gradient": SurrogateParameter(
        0.0, -0.03, 0.03, "rad s^2/m", "roll per lateral acceleration"
    ),
    "roll_frequency": SurrogateParameter(10.0, 2.0, 40.0, "rad/s", "the roll's natural frequency"),
    "roll_damping": SurrogateParameter(0.5, 0.05, 3.0, "-", "the roll's damping ratio"),
    "roll_arm": SurrogateParameter(
        0.0, -2.0, 2.0, "m", "contact below the roll axis, as slips feel it"
    ),
    "pitch_gradient": SurrogateParameter(0.0, -0.03, 0.03, "rad s^2/m", "pitch per acceleration"),
    "pitch_frequency": SurrogateParameter(
        10.0, 2.0, 40.0, "rad/s", "the pitch's natural frequency"
    ),
    "pitch_damping": SurrogateParameter(0.5, 0.05, 3.0, "-", "the pitch's damping ratio"),
    "load_springs": SurrogateParameter(
        0.0, -0.5, 1.5, "-", "share of the load transfer that follows the body"
    ),
    "load_lag": SurrogateParameter(
        0.0, 0.0, 1.0, "s", "lag of the wheel loads behind the accelerations"
    ),
    "torque_split_front": SurrogateParameter(0.5, 0.0, 1.0, "-", "front share of the torque"),
    "drag_area": SurrogateParameter(0.0, -5.0, 20.0, "m^2", "drag area"),
    "lift_area": SurrogateParameter(
        0.0, -20.0, 20.0, "m^2", "downforce area, both axles together"
    ),
    "rolling": SurrogateParameter(0.0, -0.1, 0.3, "-", "rolling resistance over load"),
    # What is commanded, on its way to the wheels.
    "steer_gain": SurrogateParameter(
        1.0, 0.2, 3.0, "-", "road-wheel angle over the commanded one"
    ),
    "steer_offset": SurrogateParameter(0.0, -0.3, 0.3, "rad", "road-wheel angle at zero command"),
    "steer_delay": SurrogateParameter(0.0, -0.2, 1.0, "s", "dead time of the steering"),
    "steer_lag": SurrogateParameter(0.0, 0.0, 2.0, "s", "first-order lag of the steering"),
    "steer_lag_more": SurrogateParameter(0.0, 0.0, 2.0, "s", "a second lag in series"),
    "steer_half_gap": SurrogateParameter(0.0, 0.0, 0.1, "rad", "half the play of the steering"),
    "steer_compliance": SurrogateParameter(
        0.0, -0.05, 0.05, "rad s^2/m", "steer angle lost per side force"
    ),
    "rear_steer": SurrogateParameter(0.0, -1.0, 1.0, "-", "rear wheel angle over the front's"),
    "torque_gain": SurrogateParameter(1.0, 0.05, 3.0, "-", "wheel torque over the commanded one"),
    "brake_gain": SurrogateParameter(1.0, 0.05, 3.0, "-", "the same of braking torque alone"),
    "torque_offset": SurrogateParameter(0.0, -5e3, 5e3, "N m", "wheel torque at zero command"),
    "torque_delay": SurrogateParameter(0.0, -0.2, 1.0, "s", "dead time of the torque"),
    "torque_lag": SurrogateParameter(0.0, 0.0, 3.0, "s", "first-order lag of the torque"),
    "torque_lag_more": SurrogateParameter(0.0, 0.0, 3.0, "s", "a second lag in series"),
    "power_inverse": SurrogateParameter(
        0.0, 0.0, 1e-3, "1/W", "one over the most power of the drive"
    ),
    "side_drag": SurrogateParameter(
        0.0, -3e3, 3e3, "N m", "brake torque of each wheel of one side, left +"
    ),
    "command_delay": SurrogateParameter(
        0.0, -1.0, 1.0, "s", "all commands act this much after their stamps"
    ),
    # The road and the air.
    "grade": SurrogateParameter(0.0, -0.4, 0.4, "rad", "slope, climb +"),
    "bank": SurrogateParameter(0.0, -0.4, 0.4, "rad", "cross slope, left side up +"),
    "friction": SurrogateParameter(1.0, 0.05, 2.0, "-", "grip of the road"),
    "wind_x": SurrogateParameter(
        0.0, -60.0, 60.0, "m/s", "the air's motion along the car's x axis"
    ),
    "wind_y": SurrogateParameter(
        0.0, -60.0, 60.0, "m/s", "the air's motion along the car's y axis"
    ),
    # Forces that are not in the catalogue, as accelerations.
    "extra_x": SurrogateParameter(
        0.0, -20.0, 20.0, "m/s^2", "further specific force along the car"
    ),
    "extra_y": SurrogateParameter(
        0.0, -20.0, 20.0, "m/s^2", "further specific force across the car"
    ),
    "extra_yaw": SurrogateParameter(0.0, -20.0, 20.0, "rad/s^2", "further yaw acceleration"),
    # The sensors.
    "bias_a_x": SurrogateParameter(0.0, -5.0, 5.0, "m/s^2", "accelerometer's x at rest"),
    "bias_a_y": SurrogateParameter(0.0, -5.0, 5.0, "m/s^2", "accelerometer's y at rest"),
    "bias_gyro": SurrogateParameter(0.0, -1.0, 1.0, "rad/s", "gyro at rest"),
    "arm_x": SurrogateParameter(0.0, -5.0, 5.0, "m", "IMU ahead of the centre of gravity"),
    "arm_y": SurrogateParameter(0.0, -5.0, 5.0, "m", "IMU left of the centre of gravity"),
    "imu_delay": SurrogateParameter(0.0, -0.5, 0.5, "s", "IMU behind odometry"),
    "gyro_gain": SurrogateParameter(1.0, 0.2, 3.0, "-", "gyro over yaw rate"),
    "odometry_gain": SurrogateParameter(1.0, 0.2, 3.0, "-", "odometry's v_x over the car's"),
    "odometry_lag": SurrogateParameter(0.0, 0.0, 2.0, "s", "low-pass of odometry's yaw rate"),
}

NAMES = tuple(SURROGATE_PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
SIZE = len(NAMES)
LOW: FloatArray = np.array([entry.low for entry in SURROGATE_PARAMETERS.values()])
HIGH: FloatArray = np.array([entry.high for entry in SURROGATE_PARAMETERS.values()])


def default_parameters() -> FloatArray:
    """Return the vector (SIZE,) of a middling car on which nothing acts."""
    return np.array([entry.default for entry in SURROGATE_PARAMETERS.values()])
