# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects between the command and the wheels: steering, drive, brakes."""

from __future__ import annotations

from adk_ros.mismatch.library.effect import ALWAYS, TIME, Effect, EffectParameter

_DELAYS = (0.04, 0.1, 0.2)
"""Start values of a dead time, s: one to five periods of the commands, which come at 25 ms."""
_LAGS = (0.05, 0.15, 0.35)
"""Start values of a time constant, s."""

_STEERING = (
    Effect(
        "steering_offset",
        (EffectParameter("offset", "rad", -0.1, 0.1, 5e-4, 1e-3, {"steer_offset": 1.0}),),
        ("v_y", "yaw_rate"),
        "delta = command + offset",
        "driving straight",
        ("crosswind", "brake_drag_one_side"),
        "straights at several speeds",
    ),
    Effect(
        "steering_ratio",
        (EffectParameter("scale", "-", 0.4, 2.0, 0.005, 0.02, {"steer_gain": 1.0}, 1.0),),
        ("v_y", "yaw_rate"),
        "delta = scale command",
        "cornering",
        ("front_tyre_stiffness", "compliance_steer"),
        "tight corners at 4 to 6 m/s",
    ),
    Effect(
        "steering_delay",
        (
            EffectParameter(
                "delay", "s", 0.0, 0.6, 0.004, 0.01, {"steer_delay": 1.0}, starts=_DELAYS
            ),
        ),
        ("v_y", "yaw_rate"),
        "delta(t) = command(t - delay)",
        "fast steering",
        ("steering_lag", "clock_offset"),
        "step steers",
    ),
    Effect(
        "steering_lag",
        (
            EffectParameter(
                "tau", "s", 0.0, 1.0, 0.004, 0.015, {"steer_lag_more": 1.0}, starts=_LAGS
            ),
        ),
        ("v_y", "yaw_rate"),
        "tau d(delta)/dt = command - delta",
        "fast steering",
        ("steering_delay", "tyre_relaxation", "yaw_inertia"),
        "step steers",
    ),
    Effect(
        "steering_backlash",
        (
            EffectParameter(
                "half_gap",
                "rad",
                0.0,
                0.05,
                3e-4,
                8e-4,
                {"steer_half_gap": 1.0},
                starts=(0.002, 0.008),
            ),
        ),
        ("v_y", "yaw_rate"),
        "delta follows the command half_gap behind",
        "alternating steering",
        ("steering_lag", "steering_delay"),
        "slow sine steering of small amplitude",
    ),
    Effect(
        "compliance_steer",
        (
            EffectParameter(
                "rad_per_mps2", "rad s^2/m", -0.01, 0.02, 1e-4, 2.5e-4, {"steer_compliance": 1.0}
            ),
        ),
        ("v_y", "yaw_rate"),
        "delta = command - rad_per_mps2 a_y",
        "cornering at several speeds",
        ("front_tyre_stiffness", "steering_ratio"),
        "tight corners at 4 to 6 m/s, and the same lateral acceleration at high speed",
    ),
    Effect(
        "rear_wheel_steer",
        (EffectParameter("ratio", "-", -0.6, 0.8, 0.005, 0.012, {"rear_steer": 1.0}),),
        ("v_y", "yaw_rate"),
        "rear angle = ratio delta",
        "cornering at several speeds",
        ("steering_ratio", "rear_tyre_stiffness"),
        "tight corners at 4 to 6 m/s",
    ),
)

_DRIVE = (
    Effect(
        "drive_torque_gain",
        (EffectParameter("scale", "-", 0.3, 1.8, 0.005, 0.02, {"torque_gain": 1.0}, 1.0),),
        ("v_x",),
        "T = scale command",
        "accelerating and braking",
        ("wheel_radius", "payload", "rotating_inertia"),
        "step steers separate a payload; not separable from a wheel radius by these signals: "
        "measure the wheel torque separately",
    ),
    Effect(
        "brake_torque_gain",
        (EffectParameter("scale", "-", 0.2, 2.0, 0.005, 0.02, {"brake_gain": 1.0}, 1.0),),
        ("v_x",),
        "T = scale command while braking",
        "braking",
        ("drive_torque_gain",),
        "braking from high speed",
    ),
    Effect(
        "drive_torque_delay",
        (
            EffectParameter(
                "delay", "s", 0.0, 0.8, 0.004, 0.01, {"torque_delay": 1.0}, starts=_DELAYS
            ),
        ),
        ("v_x",),
        "T(t) = command(t - delay)",
        "torque steps",
        ("drive_torque_lag", "clock_offset"),
        "torque steps",
    ),
    Effect(
        "drive_torque_lag",
        (
            EffectParameter(
                "tau", "s", 0.0, 2.0, 0.004, 0.015, {"torque_lag_more": 1.0}, starts=_LAGS
            ),
        ),
        ("v_x",),
        "tau dT/dt = command - T",
        "torque steps",
        ("drive_torque_delay",),
        "torque steps",
    ),
    Effect(
        "torque_offset",
        (EffectParameter("offset", "N m", -800.0, 800.0, 3.0, 8.0, {"torque_offset": 1.0}),),
        ("v_x",),
        "T = command + offset",
        "driving with little torque",
        ("rolling_resistance",),
        "not separable from these signals on a level road: measure the wheel torque at zero "
        "command separately",
    ),
    Effect(
        "power_limit",
        (
            EffectParameter(
                "power",
                "W",
                2e3,
                1e9,
                2e-7,
                1.5e5,
                {"power_inverse": 1.0},
                inverse=True,
                starts=(2.5e4, 4.5e4),
            ),
        ),
        ("v_x",),
        "T V / R <= power",
        "full torque at high speed",
        ("drive_torque_gain",),
        "full torque up to top speed",
    ),
    Effect(
        "wheel_radius",
        (EffectParameter("scale", "-", 0.5, 1.6, 0.005, 0.02, {"wheel_radius": 1.0}, 1.0, True),),
        ("v_x",),
        "F_x = T / (scale R)",
        "driving torque",
        ("drive_torque_gain", "payload", "rotating_inertia"),
        "step steers separate a payload; not separable from a torque gain by these signals: "
        "measure the rolling circumference separately",
    ),
    Effect(
        "brake_drag_one_side",
        (EffectParameter("torque_per_wheel", "N m", -600.0, 600.0, 3.0, 8.0, {"side_drag": 1.0}),),
        ("v_x", "yaw_rate"),
        "T_i -= torque_per_wheel on one side",
        "driving straight",
        ("steering_offset", "rolling_resistance"),
        "coasting on a straight, from high speed down to 4 m/s",
    ),
    Effect(
        "clock_offset",
        (
            EffectParameter(
                "offset",
                "s",
                -0.3,
                0.6,
                0.004,
                0.01,
                {"command_delay": 1.0},
                starts=(0.04, 0.1, 0.2),
            ),
        ),
        ("v_x", "v_y", "yaw_rate"),
        "u(t) = command(t - offset)",
        "torque and steering changes",
        ("steering_delay", "drive_torque_delay"),
        "torque steps and step steers",
        activations=(ALWAYS, TIME),
        sensor=True,
    ),
)

COMMANDS = (*_STEERING, *_DRIVE)
