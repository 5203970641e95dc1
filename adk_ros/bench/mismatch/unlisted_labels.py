# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a right description of each unlisted change states: equation, driving variable and form.

The form is that of `parametric_features.form_of`, or `EPISODES`.
"""

from __future__ import annotations

from typing import Any

from adk_ros.bench.mismatch.sensor_dropouts import DROPOUTS

TIME, DISTANCE = "time", "distance"
"""Driving variables besides the features of `library.features`."""

_PATH = ("yaw_rate_per_speed", "yaw_rate", "delta")
_DRIVE = ("drive_torque", "torque", "torque_size")
_BRAKE = ("brake_torque", "torque", "torque_size", "torque_squared")
_YAW = ("yaw_rate", "yaw_rate_per_speed", "yaw_rate_speed", "yaw_rate_cubed")
_FRONT_SLIP = ("delta", "delta_speed", "delta_speed_squared", "yaw_rate_speed", "lateral_cubed")

UNLISTED_IN: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "locked_differential": (("yaw_rate",), _PATH),
    "torque_steer": (("v_y",), ("torque", "torque_squared")),
    "shimmy": (("yaw_rate",), ("sine_of_speed", "speed", "speed_squared", "speed_cubed")),
    "yaw_damping": (("yaw_rate",), ("yaw_rate", "yaw_rate_per_speed", "yaw_rate_speed")),
    "scrub_drag": (("v_x",), ("lateral_squared", "lateral_size")),
    "torque_vectoring": (("yaw_rate",), ("torque_delta", "torque_yaw_rate", "torque_lateral")),
    "steering_drag": (("v_x",), ("delta_size", "yaw_rate_size")),
    "torque_cut": (("v_x",), ("drive_torque",)),
    "sloshing_load": (("v_y",), ("yaw_rate_speed",)),
    "time_periodic_yaw": (("yaw_rate",), (TIME,)),
    "brake_fade": (("v_x",), (*_BRAKE, "torque_speed", TIME)),
    "torque_hysteresis": (("v_x",), (*_DRIVE, "brake_torque", "torque_squared")),
    "brake_judder": (("v_x",), (*_BRAKE, DISTANCE)),
    "torque_ripple": (("v_x",), (*_DRIVE, TIME)),
    "abs_release": (("v_x",), (*_BRAKE, TIME)),
    "speed_limiter": (("v_x",), (*_DRIVE, "torque_speed", "speed", "speed_squared")),
    "low_gear_gain": (("v_x",), (*_DRIVE, "torque_speed", "speed")),
    "battery_sag": (("v_x",), (*_DRIVE, "torque_speed", TIME)),
    "torque_locking_differential": (
        ("yaw_rate",),
        (*_PATH, "torque_size_curvature", "torque_yaw_rate", "torque_delta"),
    ),
    "wheel_imbalance": (("v_x",), (DISTANCE,)),
    "gust_series": (("v_y", "yaw_rate"), (TIME,)),
    "phantom_braking": (("v_x",), (TIME,)),
    "lap_periodic_yaw": (("yaw_rate",), (DISTANCE,)),
    "warming_tyres": (("v_x",), (TIME,)),
    "fading_front_tyre": (("yaw_rate", "v_y"), (*_FRONT_SLIP, *_YAW, TIME)),
    "yaw_limiter": (("yaw_rate",), _YAW),
    "trailer_sway": (("v_y", "yaw_rate"), ("yaw_rate_speed",)),
    "variable_steering_ratio": (("yaw_rate", "v_y"), ("delta_speed", "delta_speed_squared")),
    "brake_pull": (("yaw_rate",), ("brake_torque", "torque", "torque_size", "torque_squared")),
    "engine_braking": (("v_x",), ("constant", *_BRAKE)),
}
"""
Unlisted change -> equations that it acts in, driving variables any of which identifies its cause.

A variable that contains the cause counts: torque for drive torque, path curvature and steering
angle for the relative difference of the wheel speeds, which differ by the sideslip only.
"""


EPISODES = "episodes"
"""Form of what acts now and then, which no term describes."""
_STATIC, _THRESHOLD = ("static",), ("threshold",)
_RESONANCE, _TIME = ("resonance",), ("change with time",)
_IN_TIME, _IN_DISTANCE = ("oscillation in time",), ("oscillation in distance",)
FORM_OF: dict[str, tuple[str, ...]] = {
    "locked_differential": _STATIC,
    "torque_steer": _STATIC,
    "shimmy": ("oscillation with speed",),
    "yaw_damping": _STATIC,
    "scrub_drag": _STATIC,
    "torque_vectoring": _STATIC,
    "steering_drag": _STATIC,
    "torque_cut": _THRESHOLD,
    "sloshing_load": _RESONANCE,
    "time_periodic_yaw": _IN_TIME,
    # Brakes that heat and cool, and that mostly heat during a recording.
    "brake_fade": ("wear", "change with time"),
    "torque_hysteresis": ("hysteresis",),
    "brake_judder": _IN_DISTANCE,
    "torque_ripple": _IN_TIME,
    # Released in turns, above a deceleration.
    "abs_release": (*_IN_TIME, *_THRESHOLD),
    "speed_limiter": _THRESHOLD,
    "low_gear_gain": _THRESHOLD,
    "battery_sag": _TIME,
    "torque_locking_differential": _STATIC,
    "wheel_imbalance": _IN_DISTANCE,
    "gust_series": (EPISODES,),
    "phantom_braking": (EPISODES,),
    "lap_periodic_yaw": _IN_DISTANCE,
    "warming_tyres": _TIME,
    "fading_front_tyre": _TIME,
    "yaw_limiter": _THRESHOLD,
    "trailer_sway": _RESONANCE,
    "variable_steering_ratio": _STATIC,
    "brake_pull": _STATIC,
    "engine_braking": _THRESHOLD,
}
"""Unlisted change -> forms any of which is that of its equation in `unlisted_changes`."""


def describe_unlisted(label: dict[str, Any], unlisted: dict[str, float]) -> dict[str, Any]:
    """
    Return a label with what a right answer to its unlisted changes states.

    For a dropout of a sensor: `accepts`, the verdicts that are right if no effect is named, and
    `sensor`, since no correction of the vehicle removes it.
    """
    known = [UNLISTED_IN[name] for name in unlisted if name in UNLISTED_IN]
    effects = [dict(effect) for effect in label["effects"]]
    for effect in effects:
        if effect["name"] != "unknown":
            continue
        effect["what"] = list(unlisted)
        if known:
            effect["equations"] = [x for equations, _ in known for x in equations]
            effect["driven_by"] = [x for _, variables in known for x in variables]
            effect["forms"] = [x for name in unlisted for x in FORM_OF.get(name, ())]
        elif set(unlisted) & set(DROPOUTS):
            effect["accepts"] = ["none", "unknown"]
            effect["sensor"] = True
    return {**label, "effects": effects}
