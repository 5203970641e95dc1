# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What effects and channels are called when a person reads, by the catalogue's names.

A phrase that ends in "than" compares with the simulation ("softer front tyres than the
simulation"); any other is something that the simulation lacks ("air drag that the simulation
lacks").
"""

from __future__ import annotations

from typing import NamedTuple

THAN = " than"


class Quantity(NamedTuple):
    """How a parameter is said: its name, its unit, and `factor` from SI to that unit."""

    label: str
    unit: str
    factor: float = 1.0


class EffectVocabulary(NamedTuple):
    """
    How an effect is said: its title, a phrase, and its parameters.

    `phrase` is for a first parameter above its neutral value, `opposite` for one below.
    """

    title: str
    phrase: str
    opposite: str
    quantities: dict[str, Quantity]


def _scaled(label: str) -> dict[str, Quantity]:
    return {"scale": Quantity(label, "of the simulation's")}


CHANNEL_TEXTS = {
    "wheel_radius": "the way rolled in ten turns of the wheel",
    "drive_torque_gain": "the wheels' torque on a dynamometer",
    "rolling_resistance": "a coast-down with the drive uncoupled",
    "torque_offset": "the wheels' torque on a dynamometer, at a command of none",
    "payload": "the car on a scale",
    "rotating_inertia": "the wheels spun up on a lift",
    "steering_ratio": "the wheels' angle on turn plates",
    "steering_offset": "the wheels' angle on turn plates, steering straight ahead",
    "front_tyre_stiffness": "the tyres on a test bench",
    "rear_tyre_stiffness": "the tyres on a test bench",
}
"""What tells effects that no drive tells apart."""

_ROAD_AND_AIR = {
    "aero_drag": EffectVocabulary(
        "air drag", "air drag", "less air drag than", {"cda": Quantity("CdA", "m2")}
    ),
    "rolling_resistance": EffectVocabulary(
        "rolling resistance",
        "rolling resistance",
        "less rolling resistance than",
        {"crr": Quantity("coefficient", "of the wheel load")},
    ),
    "headwind": EffectVocabulary(
        "wind along the road",
        "a tailwind",
        "a headwind",
        {"wind_x": Quantity("air moving along the road at", "m/s")},
    ),
    "crosswind": EffectVocabulary(
        "crosswind",
        "a crosswind from the right",
        "a crosswind from the left",
        {"wind_y": Quantity("air moving to the left at", "m/s")},
    ),
    "aero_downforce": EffectVocabulary(
        "downforce",
        "aerodynamic downforce",
        "less downforce than",
        {"cla": Quantity("ClA", "m2")},
    ),
    "road_grade": EffectVocabulary(
        "slope of the road",
        "an uphill slope",
        "a downhill slope",
        {"grade": Quantity("climb", "rad")},
    ),
    "road_bank": EffectVocabulary(
        "bank of the road",
        "a banked road",
        "a banked road",
        {"bank": Quantity("left side up by", "rad")},
    ),
    "low_friction": EffectVocabulary(
        "grip of the road",
        "more grip than",
        "less grip than",
        {"mu_scale": Quantity("friction", "of the simulation's")},
    ),
}

_TYRES_AND_BODY = {
    "front_tyre_stiffness": EffectVocabulary(
        "stiffness of the front tyres",
        "stiffer front tyres than",
        "softer front tyres than",
        _scaled("slip stiffness"),
    ),
    "rear_tyre_stiffness": EffectVocabulary(
        "stiffness of the rear tyres",
        "stiffer rear tyres than",
        "softer rear tyres than",
        _scaled("slip stiffness"),
    ),
    "tyre_relaxation": EffectVocabulary(
        "relaxation of the tyres",
        "tyres whose slip builds up late",
        "tyres whose slip builds up sooner than",
        {"length": Quantity("relaxation length", "m")},
    ),
    "load_sensitivity": EffectVocabulary(
        "load sensitivity of the tyres",
        "grip that falls with wheel load",
        "grip that falls less with wheel load than",
        {"slope": Quantity("loss of friction per relative load", "")},
    ),
    "payload": EffectVocabulary(
        "payload", "a payload", "less mass than", {"mass": Quantity("mass", "kg")}
    ),
    "cg_shift": EffectVocabulary(
        "place of the centre of gravity",
        "a centre of gravity further forward than",
        "a centre of gravity further back than",
        {"shift": Quantity("forward", "m")},
    ),
    "yaw_inertia": EffectVocabulary(
        "yaw inertia", "more yaw inertia than", "less yaw inertia than", _scaled("inertia")
    ),
    "rotating_inertia": EffectVocabulary(
        "inertia of what rotates",
        "rotating inertia in the drive",
        "less rotating inertia than",
        {"inertia": Quantity("inertia at the wheels", "kg m2")},
    ),
}

_STEERING = {
    "steering_offset": EffectVocabulary(
        "steering offset",
        "wheels that stand to the left of the command",
        "wheels that stand to the right of the command",
        {"offset": Quantity("angle", "rad")},
    ),
    "steering_ratio": EffectVocabulary(
        "steering ratio",
        "a more direct steering than",
        "a less direct steering than",
        _scaled("angle at the wheels"),
    ),
    "steering_delay": EffectVocabulary(
        "dead time of the steering",
        "a dead time in the steering",
        "a steering that acts sooner than",
        {"delay": Quantity("delay", "s")},
    ),
    "steering_lag": EffectVocabulary(
        "lag of the steering",
        "a steering that lags (first order)",
        "a steering that lags less than",
        {"tau": Quantity("time constant", "s")},
    ),
    "steering_backlash": EffectVocabulary(
        "play in the steering",
        "play in the steering",
        "less play in the steering than",
        {"half_gap": Quantity("half the gap", "rad")},
    ),
    "compliance_steer": EffectVocabulary(
        "steering that gives way",
        "a steering that gives way under side force",
        "wheels that side force turns into the bend",
        {"rad_per_mps2": Quantity("angle per lateral acceleration", "rad s2/m")},
    ),
    "rear_wheel_steer": EffectVocabulary(
        "rear-wheel steering",
        "rear wheels that turn with the front ones",
        "rear wheels that turn against the front ones",
        {"ratio": Quantity("ratio to the front", "")},
    ),
}

_DRIVE = {
    "drive_torque_gain": EffectVocabulary(
        "gain of the wheel torque",
        "more torque at the wheels than",
        "less torque at the wheels than",
        {"scale": Quantity("share of the command", "")},
    ),
    "brake_torque_gain": EffectVocabulary(
        "gain of the brakes",
        "stronger brakes than",
        "weaker brakes than",
        {"scale": Quantity("share of the command", "")},
    ),
    "drive_torque_delay": EffectVocabulary(
        "dead time of the drive",
        "a dead time in the drive",
        "a drive that acts sooner than",
        {"delay": Quantity("delay", "s")},
    ),
    "drive_torque_lag": EffectVocabulary(
        "lag of the drive",
        "a drive that lags (first order)",
        "a drive that lags less than",
        {"tau": Quantity("time constant", "s")},
    ),
    "torque_offset": EffectVocabulary(
        "torque offset",
        "a constant torque on top of the command",
        "a constant torque against the command",
        {"offset": Quantity("torque", "N m")},
    ),
    "power_limit": EffectVocabulary(
        "power limit",
        "a limit of the drive's power",
        "a limit of the drive's power",
        {"power": Quantity("power", "kW", 1e-3)},
    ),
    "wheel_radius": EffectVocabulary(
        "wheel radius", "larger wheels than", "smaller wheels than", _scaled("radius")
    ),
    "brake_drag_one_side": EffectVocabulary(
        "brake that drags on one side",
        "brakes that drag on the left",
        "brakes that drag on the right",
        {"torque_per_wheel": Quantity("torque at each wheel", "N m")},
    ),
}

_SENSORS = {
    "clock_offset": EffectVocabulary(
        "clock of the commands",
        "commands that act later than their stamps say",
        "commands that act sooner than their stamps say",
        {"offset": Quantity("delay", "s")},
    ),
    "imu_bias": EffectVocabulary(
        "constant errors of the IMU",
        "constant errors of the IMU",
        "constant errors of the IMU",
        {
            "ax": Quantity("a_x", "m/s2"),
            "ay": Quantity("a_y", "m/s2"),
            "gyro": Quantity("yaw rate", "rad/s"),
        },
    ),
    "imu_tilt": EffectVocabulary(
        "IMU mounted askew",
        "an IMU mounted askew",
        "an IMU mounted askew",
        {"roll": Quantity("roll", "rad"), "pitch": Quantity("pitch", "rad")},
    ),
    "imu_lever_arm": EffectVocabulary(
        "IMU away from the centre of gravity",
        "an IMU away from the centre of gravity",
        "an IMU away from the centre of gravity",
        {"x": Quantity("forward", "m"), "y": Quantity("to the left", "m")},
    ),
    "imu_delay": EffectVocabulary(
        "delay of the IMU",
        "an IMU that is late",
        "an IMU that is early",
        {"delay": Quantity("delay", "s")},
    ),
    "odometry_scale": EffectVocabulary(
        "scale of the odometry's speed",
        "an odometry that reads too fast",
        "an odometry that reads too slow",
        {"scale": Quantity("reading", "of the speed")},
    ),
    "gyro_scale": EffectVocabulary(
        "scale of the gyro",
        "a gyro that reads too much",
        "a gyro that reads too little",
        {"scale": Quantity("reading", "of the yaw rate")},
    ),
    "odometry_filter": EffectVocabulary(
        "filter of the odometry's yaw rate",
        "an odometry whose yaw rate is low-passed",
        "an odometry whose yaw rate is less low-passed than",
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

CHANNELS = {
    "imu_a_x": "a_x, IMU",
    "imu_a_y": "a_y, IMU",
    "imu_yaw_rate": "yaw rate, IMU",
    "v_x": "v_x, odometry",
    "v_y": "v_y, odometry",
    "yaw_rate": "yaw rate, odometry",
}
"""The residuals' channels."""

STATES = {
    "v_x": ("speed", "m/s"),
    "v_y": ("lateral velocity", "m/s"),
    "yaw_rate": ("yaw rate", "rad/s"),
}
"""What is predicted, with its unit."""


def title(name: str) -> str:
    """Return what an effect is called; a name that has no words is taken apart."""
    return EFFECT_VOCABULARY[name].title if name in EFFECT_VOCABULARY else name.replace("_", " ")


def quantity(effect: str, parameter: str, unit: str) -> Quantity:
    """Return how a parameter is said; `unit` is the catalogue's, for what has no words."""
    words = EFFECT_VOCABULARY.get(effect)
    if words is not None and parameter in words.quantities:
        return words.quantities[parameter]
    return Quantity(parameter.replace("_", " "), "" if unit == "-" else unit.replace("^", ""))


def listed(items: list[str], last: str = "and") -> str:
    """Return "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
