# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare the 14-DoF vehicle model with CommonRoad's multi-body model and print the differences.

    .venv/bin/python scripts/compare_multibody.py

The multi-body model has 29 states and comes with `commonroad-vehicle-models` (BSD licence; Althoff
and Wuersching, "CommonRoad: Vehicle Models"). `equivalent` converts its parameter set 2, a BMW
320i, to a vehicle of this package. Both run the same commands, integrated by RK4 at 1 ms. A test
bounds the differences. "Theirs" is the multi-body model, "ours" the 14-DoF model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from adk_ros.plant.environment.surface import even_planes
from adk_ros.plant.vehicle import fourteen_dof as ours
from adk_ros.plant.vehicle.chassis import Chassis
from adk_ros.plant.vehicle.sprung_mass import resolve
from adk_ros.plant.vehicle.vehicle_parameters import Tyre, Vehicle

STEP = 1e-3
SHIFTS = ("p_hx1", "p_vx1", "p_hy1", "p_hy3", "p_vy1", "p_vy3")
"""Camber, conicity and ply-steer shifts of their tyres, which our tyre model lacks."""

V_X, V_Y, YAW_RATE, ROLL, PITCH, STEER = 3, 10, 5, 6, 8, 2
"""Indices of their state; their y axis points right and their z axis down."""


class Track(NamedTuple):
    """Result of one model: arrays of shape (n,), one row per millisecond, our sign conventions."""

    v_x: np.ndarray
    v_y: np.ndarray
    yaw_rate: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray


class Manoeuvre(NamedTuple):
    """Initial speed in m/s, and road-wheel angle in rad and acceleration in m/s² over time."""

    name: str
    speed: float
    seconds: float
    delta: Callable[[np.ndarray], np.ndarray]
    accel: Callable[[np.ndarray], np.ndarray]


class Difference(NamedTuple):
    """A compared quantity: both final values, and the largest difference over time."""

    manoeuvre: str
    quantity: str
    unit: str
    theirs: float
    ours: float
    at_end: float
    """Relative to theirs."""
    on_the_way: float
    """Largest difference over time, relative to the largest of theirs."""


def parameters(shifts: bool = True) -> Any:
    """Return their parameter set 2; without `shifts`, with symmetric and upright tyres."""
    p = parameters_vehicle2()
    if not shifts:
        for name in SHIFTS:
            setattr(p.tire, name, 0.0)
    return p


def equivalent(p: Any) -> Vehicle:
    """
    Convert their vehicle to one of ours.

    Slip stiffness per load (p_ky1, p_kx1) and shape are converted by B = K / (C D). Their static
    loads are those of a sprung mass with its centre at a, b and equal unsprung masses; ours are
    those of the whole car with its centre there, as in their yaw balance. B_y is multiplied by the
    ratio of the loads, so that each axle has their cornering stiffness. Our tyres have one
    friction coefficient, set to the lateral one. The height of the centre of gravity follows from
    that of the sprung mass.
    """
    t, wheelbase = p.tire, p.a + p.b
    ratio = [
        (p.m_s * p.b / wheelbase + p.m_uf) / (p.m * p.b / wheelbase),
        (p.m_s * p.a / wheelbase + p.m_ur) / (p.m * p.a / wheelbase),
    ]
    tyres = [
        Tyre(
            mu=t.p_dy1, b_x=t.p_kx1 / (t.p_cx1 * t.p_dy1), c_x=t.p_cx1, e_x=t.p_ex1,
            b_y=-t.p_ky1 / (t.p_cy1 * t.p_dy1) * share, c_y=t.p_cy1, e_y=t.p_ey1,
            load_sensitivity=0.0, relaxation_length=0.0, relaxation_length_x=0.05,
        )
        for share in ratio
    ]  # fmt: skip
    height = (p.m_s * p.h_s + (p.m - p.m_s) * p.R_w) / p.m
    chassis = Chassis(
        unsprung_mass_front=0.5 * p.m_uf, unsprung_mass_rear=0.5 * p.m_ur,
        roll_inertia=p.I_Phi_s, pitch_inertia=p.I_y_s,
        spring_front=p.K_sf, spring_rear=p.K_sr, damper_front=p.K_sdf, damper_rear=p.K_sdr,
        anti_roll_front=-p.K_tsf, anti_roll_rear=-p.K_tsr,
        tyre_stiffness_front=p.K_zt, tyre_stiffness_rear=p.K_zt,
        tyre_damping_front=0.0, tyre_damping_rear=0.0,
        roll_centre_front=p.h_raf, roll_centre_rear=p.h_rar, travel=0.5,
        lift_area_front=0.0, lift_area_rear=0.0,
        motor_limit_front=1e4, motor_limit_rear=1e4,
    )  # fmt: skip
    return Vehicle(
        name="bmw_320i", mass=p.m, yaw_inertia=p.I_z, cg_to_front_axle=p.a, cg_to_rear_axle=p.b,
        track_width=0.5 * (p.T_f + p.T_r), cg_height=height, wheel_radius=p.R_w,
        wheel_inertia=p.I_y_w, front_tyre=tyres[0], rear_tyre=tyres[1], cda=0.0, crr=0.0,
        side_force_area=0.0, yaw_moment_volume=0.0, max_drive_torque=2e4, max_brake_torque=2e4,
        torque_split_front=p.T_sb, torque_lag=0.0, max_steer=1.0, steer_lag=0.0, chassis=chassis,
    )  # fmt: skip


def drive_theirs(p: Any, m: Manoeuvre) -> Track:
    """Integrate their model; its steering input is a rate, ours is an angle."""
    t = STEP * np.arange(round(m.seconds / STEP) + 1)
    delta, accel = m.delta(t), m.accel(t)
    state = np.array(init_mb([0.0, 0.0, 0.0, m.speed, 0.0, 0.0, 0.0], p))
    rows = np.empty((len(t), len(state)))

    def rates(x: np.ndarray, u: list[float]) -> np.ndarray:
        return np.array(vehicle_dynamics_mb(list(x), u, p))

    for k in range(len(t)):
        rows[k] = state
        after = delta[min(k + 1, len(t) - 1)]
        u = [(after - state[STEER]) / STEP, accel[k]]
        k1 = rates(state, u)
        k2 = rates(state + 0.5 * STEP * k1, u)
        k3 = rates(state + 0.5 * STEP * k2, u)
        k4 = rates(state + STEP * k3, u)
        state = state + STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    # Their y axis is mirrored, which changes the sign of roll. Their pitch is positive nose up,
    # ours nose down.
    return Track(rows[:, V_X], rows[:, V_Y], rows[:, YAW_RATE], -rows[:, ROLL], -rows[:, PITCH])


def drive_ours(vehicle: Vehicle, m: Manoeuvre) -> Track:
    """Integrate our model with the same angle and the torque of the same acceleration."""
    c, body = vehicle.constants(), resolve(vehicle)
    t = STEP * np.arange(round(m.seconds / STEP) + 1)
    torque = m.accel(t) * vehicle.mass * vehicle.wheel_radius
    commands = np.column_stack([torque, m.delta(t)])
    planes = even_planes(1.0)
    states, forces = np.empty((len(t) + 1, ours.STATE_SIZE)), np.empty((len(t) + 1, 2))
    state = ours.rolling_state(c, m.speed, planes[0])
    ours.advance(c, body, state, commands, planes, (0.0, 0.0), STEP, 1, states, forces)
    rows = states[:-1]
    return Track(*(rows[:, i] for i in (ours.V_X, ours.V_Y, ours.YAW_RATE, ours.ROLL, ours.PITCH)))


def _ramp(size: float, seconds: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: size * np.clip(t / seconds, 0.0, 1.0)


MANOEUVRES = (
    Manoeuvre("step steer, 20 m/s, 1.7 deg", 20.0, 3.0, _ramp(0.03, 0.1), _ramp(0.0, 1.0)),
    Manoeuvre("circle, 15 m/s, 2.3 deg", 15.0, 6.0, _ramp(0.04, 3.0), _ramp(0.0, 1.0)),
    Manoeuvre("circle, 20 m/s, 2.3 deg", 20.0, 6.0, _ramp(0.04, 3.0), _ramp(0.0, 1.0)),
    Manoeuvre("braking, 30 m/s, 3 m/s^2", 30.0, 3.0, _ramp(0.0, 1.0), _ramp(-3.0, 0.1)),
    Manoeuvre("braking, 30 m/s, 6 m/s^2", 30.0, 3.0, _ramp(0.0, 1.0), _ramp(-6.0, 0.1)),
)
TURNING = ("yaw_rate", "a_y", "v_y", "roll")
BRAKING = ("v_x", "pitch")
UNITS = {
    "v_x": ("m/s", 1.0), "v_y": ("m/s", 1.0), "yaw_rate": ("deg/s", np.degrees(1.0)),
    "a_y": ("m/s^2", 1.0), "roll": ("deg", np.degrees(1.0)), "pitch": ("deg", np.degrees(1.0)),
}  # fmt: skip


def _quantity(track: Track, name: str) -> np.ndarray:
    """Return a quantity over time; `a_y` is the kinematic acceleration dv_y/dt + r v_x."""
    if name == "a_y":
        return np.asarray(np.gradient(track.v_y, STEP) + track.yaw_rate * track.v_x)
    return np.asarray(getattr(track, name))


def compare(shifts: bool = True) -> list[Difference]:
    """Run every manoeuvre with both models."""
    p = parameters(shifts)
    vehicle = equivalent(p)
    found = []
    for m in MANOEUVRES:
        theirs, mine = drive_theirs(p, m), drive_ours(vehicle, m)
        for name in BRAKING if m.name.startswith("braking") else TURNING:
            a, b = _quantity(theirs, name), _quantity(mine, name)
            unit, scale = UNITS[name]
            # Both start at the same speed: compare the change of speed.
            origin = a[0] if name == "v_x" else 0.0
            end = (b[-1] - a[-1]) / (a[-1] - origin)
            most = float(np.abs(b - a).max() / np.abs(a - origin).max())
            found.append(
                Difference(m.name, name, unit, a[-1] * scale, b[-1] * scale, float(end), most)
            )
    return found


def table(shifts: bool = True) -> str:
    """Return the comparison as a Markdown table."""
    lines = [
        "| manoeuvre | | theirs, at the end | ours | difference | largest on the way |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    lines += [
        f"| {d.manoeuvre} | {d.quantity}, {d.unit} | {d.theirs:.3f} | {d.ours:.3f} "
        f"| {100.0 * d.at_end:+.1f} % | {100.0 * d.on_the_way:.1f} % |"
        for d in compare(shifts)
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print("Their tyres upright and symmetric:\n\n" + table(shifts=False))
    print("\nTheir tyres as published, with camber, conicity and ply-steer:\n\n" + table())
