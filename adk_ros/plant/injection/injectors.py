# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects at full strength, and the changes of vehicle and commands that inject them."""

from __future__ import annotations

from typing import Any

from adk_ros.files.yaml_file import with_replacements
from adk_ros.plant.injection.injected_changes import InjectedChanges
from adk_ros.plant.injection.unlisted_changes import UnlistedChanges
from adk_ros.plant.vehicle.vehicle_parameters import Vehicle

FULL: dict[str, dict[str, float]] = {
    "aero_drag": {"cda": 1.0},
    "rolling_resistance": {"crr": 0.015},
    "headwind": {"wind_x": -9.0},
    "crosswind": {"wind_y": 10.0},
    "road_grade": {"grade": 0.05},
    "road_bank": {"bank": 0.09},
    "low_friction": {"mu_scale": 0.6},
    "front_tyre_stiffness": {"scale": 0.72},
    "rear_tyre_stiffness": {"scale": 0.72},
    "tyre_relaxation": {"length": 0.8},
    "load_sensitivity": {"slope": 0.15},
    "payload": {"mass": 300.0},
    "cg_shift": {"shift": -0.12},
    "yaw_inertia": {"scale": 1.3},
    "steering_offset": {"offset": 0.012},
    "steering_ratio": {"scale": 0.86},
    "steering_delay": {"delay": 0.11},
    "steering_lag": {"tau": 0.16},
    "steering_backlash": {"half_gap": 0.004},
    "compliance_steer": {"rad_per_mps2": 0.0014},
    "drive_torque_gain": {"scale": 0.86},
    "brake_torque_gain": {"scale": 0.75},
    "drive_torque_delay": {"delay": 0.14},
    "drive_torque_lag": {"tau": 0.2},
    "torque_offset": {"offset": -90.0},
    "power_limit": {"power": 24000.0},
    "rotating_inertia": {"inertia": 20.0},
    "wheel_radius": {"scale": 1.12},
    "brake_drag_one_side": {"torque_per_wheel": 70.0},
    "aero_downforce": {"cla": 1.5},
    "rear_wheel_steer": {"ratio": 0.08},
    "imu_bias": {"ax": 0.2, "ay": -0.2, "gyro": 0.008},
    "imu_tilt": {"roll": 0.025, "pitch": -0.02},
    "imu_lever_arm": {"x": 0.8, "y": 0.4},
    "imu_delay": {"delay": 0.06},
    "odometry_scale": {"scale": 1.04},
    "gyro_scale": {"scale": 1.05},
    "odometry_filter": {"tau": 0.25},
    "clock_offset": {"offset": 0.1},
}
"""Each effect of the catalogue, at strength 1."""

SPRUNG_CAR_ONLY = ("aero_downforce", "rear_wheel_steer")
"""
Effects that the plants of seven and fourteen degrees of freedom cannot represent, only the one of
`sprung_car` (brush tyres, sprung roll; `spring_car` in labels).
"""

UNLISTED = {
    "locked_differential": 25.0,
    "torque_steer": 2.5e-4,
    "shimmy": 0.05,
    "yaw_damping": 0.6,
    "scrub_drag": 0.02,
    "torque_vectoring": 1.5e-2,
    "steering_drag": 8.0,
    "torque_cut": 0.8,
    "sloshing_load": 0.08,
    "time_periodic_yaw": 0.15,
    "brake_fade": 0.5,
    "torque_hysteresis": 150.0,
    "brake_judder": 0.6,
    "torque_ripple": 0.4,
    "abs_release": 0.7,
    "speed_limiter": 0.8,
    "low_gear_gain": 0.35,
    "battery_sag": 0.4,
    "torque_locking_differential": 0.03,
    "wheel_imbalance": 0.6,
    "gust_series": 1.2,
    "phantom_braking": 1.0,
    "lap_periodic_yaw": 0.15,
    "warming_tyres": 0.03,
    "fading_front_tyre": 0.3,
    "yaw_limiter": 3.0,
    "trailer_sway": 0.05,
    "variable_steering_ratio": 0.25,
    "brake_pull": 7.0e-5,
    "engine_braking": 0.35,
}
"""Changes that are not in the catalogue: name, a field of `UnlistedChanges`, -> size at strength
1."""


def scale_strength(
    name: str, strength: float, full: dict[str, float] | None = None
) -> dict[str, float]:
    """Return the parameters of an effect at a fraction of full strength, `full` or `FULL`."""
    full = full or FULL[name]
    if name == "power_limit":
        return {"power": full["power"] / strength**0.5}
    out = {}
    for parameter, value in full.items():
        neutral = 1.0 if parameter in {"scale", "mu_scale"} else 0.0
        out[parameter] = neutral + strength * (value - neutral)
    return out


def changed_vehicle(vehicle: Vehicle, effects: dict[str, dict[str, float]]) -> Vehicle:
    """Return the vehicle with all effects that are changes of its parameters."""
    v = vehicle.model_dump()
    front, rear = v["front_tyre"], v["rear_tyre"]
    for name, p in effects.items():
        if name == "aero_drag":
            v["cda"] += p["cda"]
        elif name == "rolling_resistance":
            v["crr"] += p["crr"]
        elif name == "front_tyre_stiffness":
            front["b_y"] *= p["scale"]
        elif name == "rear_tyre_stiffness":
            rear["b_y"] *= p["scale"]
        elif name == "tyre_relaxation":
            front["relaxation_length"] += p["length"]
            rear["relaxation_length"] += p["length"]
        elif name == "load_sensitivity":
            front["load_sensitivity"] += p["slope"]
            rear["load_sensitivity"] += p["slope"]
        elif name == "payload":
            v["mass"] += p["mass"]
            v["yaw_inertia"] += 1.1 * p["mass"]
        elif name == "cg_shift":
            v["cg_to_front_axle"] -= p["shift"]
            v["cg_to_rear_axle"] += p["shift"]
        elif name == "yaw_inertia":
            v["yaw_inertia"] *= p["scale"]
        elif name == "rotating_inertia":
            v["wheel_inertia"] += 0.25 * p["inertia"]
        elif name == "wheel_radius":
            v["wheel_radius"] *= p["scale"]
    return Vehicle.model_validate(with_replacements(vehicle.model_dump(), v))


_CHANGES = {
    # effect: (its parameter, field of `InjectedChanges`)
    "drive_torque_gain": ("scale", "torque_gain"),
    "brake_torque_gain": ("scale", "brake_gain"),
    "torque_offset": ("offset", "torque_offset"),
    "drive_torque_lag": ("tau", "torque_lag"),
    "power_limit": ("power", "power"),
    "steering_ratio": ("scale", "steer_gain"),
    "steering_offset": ("offset", "steer_offset"),
    "steering_lag": ("tau", "steer_lag"),
    "steering_backlash": ("half_gap", "half_backlash"),
    "compliance_steer": ("rad_per_mps2", "compliance"),
    "brake_drag_one_side": ("torque_per_wheel", "one_side_brake_torque"),
    "headwind": ("wind_x", "wind_x"),
    "crosswind": ("wind_y", "wind_y"),
    "aero_downforce": ("cla", "lift_area"),
    "rear_wheel_steer": ("ratio", "rear_steer"),
}


def plant_changes(
    effects: dict[str, dict[str, float]], unlisted: dict[str, float], onset: float
) -> InjectedChanges:
    """Return the changes of a simulated run for effects and unlisted changes, from `onset` s."""
    known = {name: size for name, size in unlisted.items() if name in UnlistedChanges._fields}
    values: dict[str, Any] = {"unlisted": UnlistedChanges(**known)}
    for name, p in effects.items():
        if name in _CHANGES:
            values[_CHANGES[name][1]] = p[_CHANGES[name][0]]
    delays = {"torque_delay_ms": 0.0, "steer_delay_ms": 0.0}
    delays["torque_delay_ms"] += effects.get("drive_torque_delay", {}).get("delay", 0.0)
    delays["steer_delay_ms"] += effects.get("steering_delay", {}).get("delay", 0.0)
    for key in delays:
        delays[key] += effects.get("clock_offset", {}).get("offset", 0.0)
        values[key] = round(1000.0 * delays[key])
    return InjectedChanges(onset=onset)._replace(**values)
