# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects that are changes of the multi-body model's parameters.

Their sizes are exact but for the tyres': their force jumps with the sign of the camber, which the
slip stiffness leaves as it is, so that an axle's stiffness changes by more than the coefficient
(0.66 and 0.67 instead of 0.72, `test/bench/mismatch/test_multibody_cases.py`).
"""

from __future__ import annotations

from dataclasses import replace

from adk_ros.bench.vehicles.multibody import MultibodyVehicle

EFFECTS = (
    "aero_drag",
    "rolling_resistance",
    "low_friction",
    "front_tyre_stiffness",
    "rear_tyre_stiffness",
    "payload",
    "cg_shift",
    "yaw_inertia",
    "steering_offset",
    "steering_ratio",
    "steering_delay",
    "steering_lag",
    "steering_backlash",
    "compliance_steer",
    "drive_torque_gain",
    "brake_torque_gain",
    "drive_torque_delay",
    "drive_torque_lag",
    "torque_offset",
    "power_limit",
    "rotating_inertia",
    "wheel_radius",
    "brake_drag_one_side",
    "imu_bias",
    "imu_tilt",
    "imu_lever_arm",
    "imu_delay",
    "odometry_scale",
    "gyro_scale",
    "odometry_filter",
    "clock_offset",
)
"""
Effects with an exact meaning for this model.

It has no slope, no wind, no lift, no rear steering, and tyres without relaxation and load
sensitivity.
"""
SIZES = {
    # A car of 1.1 t instead of 2.1 t: the same relative change.
    "payload": {"mass": 160.0},
    "torque_offset": {"offset": -50.0},
    "power_limit": {"power": 14000.0},
    "rotating_inertia": {"inertia": 12.0},
    "brake_drag_one_side": {"torque_per_wheel": 40.0},
}
"""Sizes at strength 1 that differ from `injectors.FULL`."""
_FRICTION = ("p_dx1", "p_dy1", "p_vx1", "p_vy1", "p_vy3")
"""
Tyre coefficients of the largest force. The slip stiffness p_kx1, p_ky1 is that of the tread, which
a wet road leaves as it is: so does the catalogue's effect.
"""


def changed_multibody(
    vehicle: MultibodyVehicle, effects: dict[str, dict[str, float]]
) -> MultibodyVehicle:
    """Return the vehicle with all effects that are changes of its parameters."""
    v = vehicle
    for name, p in effects.items():
        body = v.body
        if name == "aero_drag":
            v = replace(v, cda=v.cda + p["cda"])
        elif name == "rolling_resistance":
            v = replace(v, crr=v.crr + p["crr"])
        elif name == "front_tyre_stiffness":
            v = v.changed(front={"p_ky1": v.front["p_ky1"] * p["scale"]})
        elif name == "rear_tyre_stiffness":
            v = v.changed(rear={"p_ky1": v.rear["p_ky1"] * p["scale"]})
        elif name == "low_friction":
            front, rear = ({x: t[x] * p["mu_scale"] for x in _FRICTION} for t in (v.front, v.rear))
            v = v.changed(front=front, rear=rear)
        elif name == "payload":
            v = v.changed(
                {
                    "m": body["m"] + p["mass"],
                    "m_s": body["m_s"] + p["mass"],
                    "I_z": body["I_z"] + 1.1 * p["mass"],
                }
            )
        elif name == "cg_shift":
            v = v.changed({"a": body["a"] - p["shift"], "b": body["b"] + p["shift"]})
        elif name == "yaw_inertia":
            v = v.changed({"I_z": body["I_z"] * p["scale"]})
        elif name == "rotating_inertia":
            v = v.changed({"I_y_w": body["I_y_w"] + 0.25 * p["inertia"]})
        elif name == "wheel_radius":
            v = v.changed({"R_w": body["R_w"] * p["scale"]})
    return v
