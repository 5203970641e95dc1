# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of air, road, tyres and body."""

from __future__ import annotations

from adk_ros.mismatch.library.effect import ALWAYS, PLACE, TIME, Effect, EffectParameter

_EVERYWHERE = (ALWAYS, PLACE, TIME)

_AIR = (
    Effect(
        "aero_drag",
        (EffectParameter("cda", "m^2", -2.0, 6.0, 0.02, 0.03, {"drag_area": 1.0}),),
        ("v_x",),
        "F_x = -rho/2 cda V^2",
        "speeds that differ by a factor of two",
        ("headwind", "rolling_resistance"),
        "coast-down from top speed on a straight, in both directions",
        where="the whole drive, grows with V^2",
    ),
    Effect(
        "headwind",
        (EffectParameter("wind_x", "m/s", -25.0, 25.0, 0.2, 0.7, {"wind_x": 1.0}),),
        ("v_x",),
        "F_x = -rho/2 cda ((V - wind_x)^2 - V^2), wind_x > 0 in driving direction",
        "a wide range of speeds",
        ("aero_drag", "rolling_resistance"),
        "the same straight in both directions",
        _EVERYWHERE,
        where="the whole drive, grows with V",
    ),
    Effect(
        "crosswind",
        (EffectParameter("wind_y", "m/s", -30.0, 30.0, 0.2, 0.7, {"wind_y": 1.0}),),
        ("v_y", "yaw_rate"),
        "F_y = rho/2 V_air^2 area sin(beta_air), M_z likewise",
        "straights at high speed",
        ("road_bank", "steering_offset"),
        "the same straight in both directions",
        _EVERYWHERE,
    ),
    Effect(
        "aero_downforce",
        (EffectParameter("cla", "m^2", -3.0, 8.0, 0.05, 0.15, {"lift_area": 1.0}),),
        ("v_y", "yaw_rate"),
        "F_z += rho/2 cla V^2",
        "cornering near the limit at different speeds",
        ("load_sensitivity",),
        "the same lateral acceleration at low and at high speed",
    ),
)

_ROAD = (
    Effect(
        "road_grade",
        (EffectParameter("grade", "rad", -0.25, 0.25, 0.002, 0.004, {"grade": 1.0}),),
        ("v_x",),
        "dv_x/dt = a_x + r v_y - g sin(grade)",
        "any driving with an accelerometer, which measures specific force",
        ("imu_tilt",),
        "the same road in both directions",
        (PLACE,),
    ),
    Effect(
        "road_bank",
        (EffectParameter("bank", "rad", -0.3, 0.3, 0.002, 0.005, {"bank": 1.0}),),
        ("v_y", "yaw_rate"),
        "dv_y/dt = a_y - r v_x - g sin(bank)",
        "any driving with an accelerometer, which measures specific force",
        ("crosswind", "imu_tilt"),
        "the same road in both directions",
        (PLACE,),
    ),
    Effect(
        "low_friction",
        (
            EffectParameter(
                "mu_scale", "-", 0.1, 1.0, 0.01, 0.03, {"friction": 1.0}, 1.0, starts=(0.85, 0.55)
            ),
        ),
        ("v_y", "yaw_rate"),
        "D = mu_scale mu F_z",
        "cornering near the limit",
        ("front_tyre_stiffness", "rear_tyre_stiffness", "load_sensitivity"),
        "a constant-radius circle with increasing speed, up to the limit",
        _EVERYWHERE,
    ),
    Effect(
        "rolling_resistance",
        (EffectParameter("crr", "-", -0.02, 0.1, 0.0005, 0.001, {"rolling": 1.0}),),
        ("v_x",),
        "F_x = -crr F_z",
        "driving with little torque, over a wide range of speeds",
        ("torque_offset", "aero_drag", "headwind"),
        "coast-down from high speed to 4 m/s separates drag and wind; on a level road not "
        "distinguishable from a torque offset: measure it separately",
    ),
)

_TYRES = (
    Effect(
        "front_tyre_stiffness",
        (EffectParameter("scale", "-", 0.2, 3.0, 0.01, 0.02, {"stiffness_f": 1.0}, 1.0, True),),
        ("v_y", "yaw_rate"),
        "C_alpha,front multiplied by the scale",
        "moderate cornering",
        ("steering_ratio", "compliance_steer"),
        "a step steer at constant speed",
    ),
    Effect(
        "rear_tyre_stiffness",
        (EffectParameter("scale", "-", 0.2, 3.0, 0.01, 0.02, {"stiffness_r": 1.0}, 1.0, True),),
        ("v_y", "yaw_rate"),
        "C_alpha,rear multiplied by the scale",
        "moderate cornering",
        ("cg_shift", "rear_wheel_steer"),
        "steady-state cornering (ISO 4138) at several speeds",
    ),
    Effect(
        "tyre_relaxation",
        (
            EffectParameter(
                "length", "m", 0.0, 4.0, 0.03, 0.1, {"relaxation_length": 1.0}, starts=(0.6,)
            ),
        ),
        ("v_y", "yaw_rate"),
        "d(alpha')/dt = V / length (alpha - alpha')",
        "fast steering",
        ("steering_lag", "yaw_inertia"),
        "step steers at low and at high speed",
    ),
    Effect(
        "load_sensitivity",
        (
            EffectParameter(
                "slope",
                "-",
                -0.3,
                0.6,
                0.01,
                0.03,
                {"load_sensitivity": 1.0, "stiffness_falloff": 1.0},
            ),
        ),
        ("v_y", "yaw_rate"),
        "mu (1 - slope (F_z / F_z0 - 1)), the slip stiffness likewise",
        "cornering near the limit",
        ("low_friction", "aero_downforce"),
        "a small circle up to the limit, at low speed",
    ),
)

_BODY = (
    Effect(
        "payload",
        (
            EffectParameter(
                "mass", "kg", -600.0, 1500.0, 10.0, 30.0, {"mass": 1.0, "yaw_inertia": 1.1}
            ),
        ),
        ("v_x", "v_y", "yaw_rate"),
        "m += mass, I_z += 1.1 m^2 mass",
        "driving torque and fast steering",
        ("drive_torque_gain", "wheel_radius"),
        "step steers, which depend on the inertia only",
    ),
    Effect(
        "cg_shift",
        (
            EffectParameter(
                "shift",
                "m",
                -0.5,
                0.5,
                0.005,
                0.015,
                {"cg_to_front_axle": -1.0, "cg_to_rear_axle": 1.0},
            ),
        ),
        ("v_y", "yaw_rate"),
        "l_f -= shift, l_r += shift",
        "cornering at several speeds",
        ("rear_tyre_stiffness", "front_tyre_stiffness"),
        "steady-state cornering (ISO 4138) at several speeds",
    ),
    Effect(
        "yaw_inertia",
        (EffectParameter("scale", "-", 0.3, 3.0, 0.01, 0.02, {"yaw_inertia": 1.0}, 1.0, True),),
        ("yaw_rate",),
        "I_z multiplied by the scale",
        "fast steering",
        ("tyre_relaxation", "steering_lag", "payload"),
        "swept-sine steering at constant speed",
    ),
    Effect(
        "rotating_inertia",
        (
            EffectParameter(
                "inertia",
                "kg m^2",
                -4.0,
                60.0,
                0.3,
                1.0,
                {"wheel_inertia": 1.0, "spin_up_inertia": 1.0},
            ),
        ),
        ("v_x",),
        "F_x = (T - inertia dv_x/dt / R) / R, with the lag of the wheels' spin-up",
        "driving torque",
        ("drive_torque_gain", "payload", "wheel_radius"),
        "constant speed on a grade or near top speed, where the inertia has no influence",
    ),
)

VEHICLE = (*_AIR, *_ROAD, *_TYRES, *_BODY)
