# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Titles and phrases of effects, and how their parameters are written.

A phrase contains `{size}` if its effect has one parameter. A phrase that ends in "than" compares
with the simulation ("0.92 m² more drag area (C_dA) than the simulation").
"""

from __future__ import annotations

from typing import NamedTuple

from adk_ros.mismatch.report.quantities import (
    Quantity,
    angle,
    change,
    kilowatts,
    percent_change,
    slope,
)

THAN = " than"


class EffectVocabulary(NamedTuple):
    """
    How an effect is written: title, phrase, parameters.

    `phrase` is for a first parameter above its neutral value, `opposite` for one below.
    """

    title: str
    phrase: str
    opposite: str
    quantities: dict[str, Quantity]


DIRECT_MEASUREMENTS = {
    "wheel_radius": "measure the distance travelled in ten wheel revolutions",
    "drive_torque_gain": "measure the wheel torque on a dynamometer",
    "rolling_resistance": "coast down with the drive disengaged",
    "torque_offset": "measure the wheel torque on a dynamometer at zero command",
    "payload": "weigh the car",
    "rotating_inertia": "spin the wheels up on a lift",
    "steering_ratio": "measure the road-wheel angle on turn plates",
    "steering_offset": "measure the road-wheel angle on turn plates, steering straight ahead",
    "front_tyre_stiffness": "measure the tyres on a test bench",
    "rear_tyre_stiffness": "measure the tyres on a test bench",
}
"""Effect -> measurement that identifies it where no manoeuvre does."""

_ROAD_AND_AIR = {
    "aero_drag": EffectVocabulary(
        "air drag",
        "{size} more drag area (C_dA) than",
        "{size} less drag area (C_dA) than",
        {"cda": Quantity("drag area C_dA", "m²")},
    ),
    "rolling_resistance": EffectVocabulary(
        "rolling resistance",
        "a rolling resistance coefficient that is {size} higher than",
        "a rolling resistance coefficient that is {size} lower than",
        {"crr": Quantity("coefficient", "")},
    ),
    "headwind": EffectVocabulary(
        "longitudinal wind",
        "a tailwind of {size}",
        "a headwind of {size}",
        {"wind_x": Quantity("wind speed (+ tailwind)", "m/s")},
    ),
    "crosswind": EffectVocabulary(
        "crosswind",
        "a crosswind of {size} from the right",
        "a crosswind of {size} from the left",
        {"wind_y": Quantity("wind speed (+ to the left)", "m/s")},
    ),
    "aero_downforce": EffectVocabulary(
        "aerodynamic downforce",
        "{size} more downforce area (C_lA) than",
        "{size} less downforce area (C_lA) than",
        {"cla": Quantity("downforce area C_lA", "m²")},
    ),
    "road_grade": EffectVocabulary(
        "road grade",
        "an uphill grade of {size}",
        "a downhill grade of {size}",
        {"grade": slope("grade (+ uphill)")},
    ),
    "road_bank": EffectVocabulary(
        "road bank (cross slope)",
        "a road bank (cross slope) of {size}, left side higher,",
        "a road bank (cross slope) of {size}, right side higher,",
        {"bank": slope("cross slope (+ left side higher)")},
    ),
    "low_friction": EffectVocabulary(
        "road friction",
        "{size} higher road friction than",
        "{size} lower road friction than",
        {"mu_scale": change("friction coefficient")},
    ),
}

_TYRES_AND_BODY = {
    "front_tyre_stiffness": EffectVocabulary(
        "front tyre stiffness",
        "{size} stiffer front tyres (cornering stiffness) than",
        "{size} softer front tyres (cornering stiffness) than",
        {"scale": change("cornering stiffness")},
    ),
    "rear_tyre_stiffness": EffectVocabulary(
        "rear tyre stiffness",
        "{size} stiffer rear tyres (cornering stiffness) than",
        "{size} softer rear tyres (cornering stiffness) than",
        {"scale": change("cornering stiffness")},
    ),
    "tyre_relaxation": EffectVocabulary(
        "tyre relaxation length",
        "a tyre relaxation length that is {size} longer than",
        "a tyre relaxation length that is {size} shorter than",
        {"length": Quantity("relaxation length", "m")},
    ),
    "load_sensitivity": EffectVocabulary(
        "tyre load sensitivity",
        "a tyre load sensitivity that is {size} higher than",
        "a tyre load sensitivity that is {size} lower than",
        {"slope": Quantity("loss of friction per relative load", "")},
    ),
    "payload": EffectVocabulary(
        "payload",
        "{size} more mass than",
        "{size} less mass than",
        {"mass": Quantity("mass", "kg")},
    ),
    "cg_shift": EffectVocabulary(
        "centre of gravity position",
        "a centre of gravity {size} further forward than",
        "a centre of gravity {size} further back than",
        {"shift": Quantity("shift (+ forward)", "m")},
    ),
    "yaw_inertia": EffectVocabulary(
        "yaw inertia",
        "{size} more yaw inertia than",
        "{size} less yaw inertia than",
        {"scale": change("yaw inertia")},
    ),
    "rotating_inertia": EffectVocabulary(
        "rotating inertia",
        "{size} more rotating inertia of wheels and driveline than",
        "{size} less rotating inertia of wheels and driveline than",
        {"inertia": Quantity("inertia at the wheels", "kg·m²")},
    ),
}

_STEERING = {
    "steering_offset": EffectVocabulary(
        "steering offset",
        "a steering offset of {size} to the left",
        "a steering offset of {size} to the right",
        {"offset": angle("road-wheel angle (+ left)")},
    ),
    "steering_ratio": EffectVocabulary(
        "steering ratio",
        "{size} more road-wheel angle per command than",
        "{size} less road-wheel angle per command than",
        {"scale": change("road-wheel angle per command")},
    ),
    "steering_delay": EffectVocabulary(
        "steering delay",
        "{size} more steering delay than",
        "{size} less steering delay than",
        {"delay": Quantity("delay", "s")},
    ),
    "steering_lag": EffectVocabulary(
        "steering lag",
        "a steering lag (first-order time constant) that is {size} longer than",
        "a steering lag (first-order time constant) that is {size} shorter than",
        {"tau": Quantity("time constant", "s")},
    ),
    "steering_backlash": EffectVocabulary(
        "steering backlash",
        "±{size} more steering backlash than",
        "±{size} less steering backlash than",
        {"half_gap": angle("half the backlash, at the road wheel")},
    ),
    "compliance_steer": EffectVocabulary(
        "steering compliance",
        "{size} more steering compliance than",
        "a negative steering compliance of {size}",
        {"rad_per_mps2": Quantity("angle per lateral acceleration", "rad·s²/m")},
    ),
    "rear_wheel_steer": EffectVocabulary(
        "rear-wheel steering",
        "rear-wheel steering in phase with the front wheels, by {size} of their angle,",
        "rear-wheel steering opposite to the front wheels, by {size} of their angle,",
        {"ratio": Quantity("ratio to the front angle", "")},
    ),
}

_DRIVE = {
    "drive_torque_gain": EffectVocabulary(
        "wheel torque gain",
        "{size} more wheel torque than",
        "{size} less wheel torque than",
        {"scale": change("wheel torque per command")},
    ),
    "brake_torque_gain": EffectVocabulary(
        "brake torque gain",
        "{size} more brake torque than",
        "{size} less brake torque than",
        {"scale": change("brake torque per command")},
    ),
    "drive_torque_delay": EffectVocabulary(
        "drive delay",
        "{size} more drive delay than",
        "{size} less drive delay than",
        {"delay": Quantity("delay", "s")},
    ),
    "drive_torque_lag": EffectVocabulary(
        "drive lag",
        "a drive lag (first-order time constant) that is {size} longer than",
        "a drive lag (first-order time constant) that is {size} shorter than",
        {"tau": Quantity("time constant", "s")},
    ),
    "torque_offset": EffectVocabulary(
        "torque offset",
        "a constant driving torque of {size} at the wheels, in addition to the command,",
        "a constant braking torque of {size} at the wheels, in addition to the command,",
        {"offset": Quantity("wheel torque (+ driving)", "N·m")},
    ),
    "power_limit": EffectVocabulary(
        "power limit",
        "a drive power limit of {size}",
        "a drive power limit of {size}",
        {"power": Quantity("power limit", "kW", kilowatts)},
    ),
    "wheel_radius": EffectVocabulary(
        "wheel radius",
        "{size} larger wheels than",
        "{size} smaller wheels than",
        {"scale": change("wheel radius")},
    ),
    "brake_drag_one_side": EffectVocabulary(
        "one-sided brake drag",
        "brake drag of {size} per wheel on the left side",
        "brake drag of {size} per wheel on the right side",
        {"torque_per_wheel": Quantity("torque per wheel (+ left side)", "N·m")},
    ),
}

_SENSORS = {
    "clock_offset": EffectVocabulary(
        "command clock offset",
        "commands that act {size} later than their time stamps",
        "commands that act {size} earlier than their time stamps",
        {"offset": Quantity("delay", "s")},
    ),
    "imu_bias": EffectVocabulary(
        "IMU bias",
        "IMU bias",
        "IMU bias",
        {
            "ax": Quantity("longitudinal", "m/s²"),
            "ay": Quantity("lateral", "m/s²"),
            "gyro": Quantity("yaw rate", "rad/s"),
        },
    ),
    "imu_tilt": EffectVocabulary(
        "tilted IMU",
        "a tilted IMU",
        "a tilted IMU",
        {"roll": angle("roll"), "pitch": angle("pitch")},
    ),
    "imu_lever_arm": EffectVocabulary(
        "IMU lever arm",
        "an IMU away from the centre of gravity",
        "an IMU away from the centre of gravity",
        {"x": Quantity("forward", "m"), "y": Quantity("to the left", "m")},
    ),
    "imu_delay": EffectVocabulary(
        "IMU delay",
        "IMU readings that are {size} late",
        "IMU readings that are {size} early",
        {"delay": Quantity("delay", "s")},
    ),
    "odometry_scale": EffectVocabulary(
        "odometry speed scale",
        "an odometry speed that reads {size} too high",
        "an odometry speed that reads {size} too low",
        {"scale": Quantity("error of the reading", "%", percent_change)},
    ),
    "gyro_scale": EffectVocabulary(
        "gyro scale",
        "an IMU yaw rate that reads {size} too high",
        "an IMU yaw rate that reads {size} too low",
        {"scale": Quantity("error of the reading", "%", percent_change)},
    ),
    "odometry_filter": EffectVocabulary(
        "odometry yaw-rate filter",
        "an odometry yaw-rate filter with a time constant that is {size} longer than",
        "an odometry yaw-rate filter with a time constant that is {size} shorter than",
        {"tau": Quantity("time constant", "s")},
    ),
}

EFFECT_VOCABULARY: dict[str, EffectVocabulary] = {
    **_ROAD_AND_AIR,
    **_TYRES_AND_BODY,
    **_STEERING,
    **_DRIVE,
    **_SENSORS,
}
