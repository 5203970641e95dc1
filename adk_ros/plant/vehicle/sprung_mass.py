# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Masses, inertias and rates of the fourteen-degree-of-freedom car, as its kernels take them.

The reference point P is the centre of gravity of the whole car at rest. The sprung mass is a rigid
body; each unsprung mass is a point on a rail along the body's vertical: across and along it moves
with the body, up and down by itself. With x, z the places against P at rest,

    sum(m x) = 0, sum(m z) = 0
    I_x  = I_roll  + m_s z_s^2 + sum(m_i z_i^2)          (x, y motion of the unsprung alone)
    I_y  = I_pitch + m_s (x_s^2 + z_s^2) + sum(m_i z_i^2)
    I_z  = the car's yaw inertia
    I_xz = m_s x_s z_s + sum(m_i x_i z_i)
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.constants import GRAVITY
from adk_ros.plant.vehicle.chassis import Chassis

MAX_RATE = 2000.0
"""1/s; the fastest mode that steps of 1 ms still integrate stably."""

_HEAVE_HZ = (1.3, 1.45)
_DAMPING = 0.35
_ROLL_BARS = (0.45, 0.15)
_STATIC_TYRE_DEFLECTION_M = 0.02
_TYRE_DAMPING = 0.02
_UNSPRUNG_SHARE = 0.04


class VehicleWithChassis(Protocol):
    """What is needed of a vehicle file, SI."""

    mass: float
    yaw_inertia: float
    cg_to_front_axle: float
    cg_to_rear_axle: float
    cg_height: float
    track_width: float
    wheel_radius: float
    torque_split_front: float
    max_drive_torque: float

    def chassis_or_default(self) -> Chassis:
        """Return what the file says of the chassis."""


class SprungMass(NamedTuple):
    """Parameters for the kernels; `_f`, `_r`: of one wheel of the front, the rear axle. SI."""

    sprung_mass: float
    sprung_x: float
    sprung_z: float
    """Place of the sprung mass's centre of gravity against P, m."""
    wheel_z: float
    """Height of the wheel centres against P at rest, m."""
    inertia_x: float
    inertia_y: float
    inertia_z: float
    inertia_xz: float
    sprung_inertia_xx: float
    sprung_inertia_yy: float
    sprung_inertia_zz: float
    sprung_inertia_xz: float
    """The sprung mass's own share of the inertias about P: what its rotation precesses with."""
    unsprung_m_xx: float
    unsprung_m_yy: float
    unsprung_m_zz: float
    unsprung_m_xz: float
    """Sums of m_i times x_i x_i, y_i y_i, z_i z_i, x_i z_i over the unsprung masses, kg m^2."""
    unsprung_f: float
    unsprung_r: float
    static_f: float
    static_r: float
    """Suspension force at rest, N."""
    load_f: float
    load_r: float
    """Wheel load at rest, N."""
    spring_f: float
    spring_r: float
    damper_f: float
    damper_r: float
    bar_f: float
    bar_r: float
    """Anti-roll bar: force at either wheel over the difference of the travels, N/m."""
    tyre_stiffness_f: float
    tyre_stiffness_r: float
    tyre_damping_f: float
    tyre_damping_r: float
    roll_centre_f: float
    roll_centre_r: float
    travel: float
    stop_stiffness: float
    lift_area_f: float
    lift_area_r: float
    motor_limit_f: float
    motor_limit_r: float
    brake_split_front: float
    brake_lag: float


NO_SPRUNG_MASS = SprungMass(*([0.0] * len(SprungMass._fields)))
"""Stands for the body where the seven-degree-of-freedom car is driven, which has none."""


def resolve(vehicle: VehicleWithChassis) -> SprungMass:
    """
    Return the body of `vehicle`, what its file leaves out derived as a passenger car has it.

    Raises `ValueError`, one line, for masses and inertias that contradict each other and for
    suspensions that the integrator's step cannot resolve.
    """
    v, k = vehicle, vehicle.chassis_or_default()
    wheelbase = v.cg_to_front_axle + v.cg_to_rear_axle
    half = 0.5 * v.track_width
    usual = _UNSPRUNG_SHARE * v.mass
    unsprung = [
        _or_default(k.unsprung_mass_front, usual),
        _or_default(k.unsprung_mass_rear, usual),
    ]
    sprung = v.mass - 2.0 * sum(unsprung)
    if sprung < 0.2 * v.mass:
        raise ValueError("chassis: the unsprung masses leave less than a fifth of the mass sprung")
    place = [v.cg_to_front_axle, -v.cg_to_rear_axle]
    wheel_z = v.wheel_radius - v.cg_height
    sprung_x = -2.0 * (unsprung[0] * place[0] + unsprung[1] * place[1]) / sprung
    sprung_z = -2.0 * sum(unsprung) * wheel_z / sprung
    shares = [(sprung_x - place[1]) / wheelbase, (place[0] - sprung_x) / wheelbase]
    if min(shares) < 0.02:
        raise ValueError("chassis: the sprung mass's centre of gravity is not between the axles")
    corner = [0.5 * sprung * share for share in shares]
    static = [mass * GRAVITY for mass in corner]
    load = [force + mass * GRAVITY for force, mass in zip(static, unsprung, strict=True)]

    carried = {
        "xx": 2.0 * sum(m * x * x for m, x in zip(unsprung, place, strict=True)),
        "yy": 2.0 * sum(unsprung) * half * half,
        "zz": 2.0 * sum(unsprung) * wheel_z * wheel_z,
        "xz": 2.0 * wheel_z * sum(m * x for m, x in zip(unsprung, place, strict=True)),
    }
    gyro_z = v.yaw_inertia - carried["xx"] - carried["yy"]
    if gyro_z < 0.05 * v.yaw_inertia + sprung * sprung_x * sprung_x:
        raise ValueError(
            "chassis: the yaw inertia is less than what the unsprung masses alone have: raise "
            "yaw_inertia or lower chassis.unsprung_mass_front and _rear"
        )
    roll = _or_default(k.roll_inertia, sprung * (0.36 * v.track_width) ** 2)
    pitch = _or_default(k.pitch_inertia, 0.8 * v.yaw_inertia)
    gyro_x = roll + sprung * sprung_z**2
    gyro_y = pitch + sprung * (sprung_x**2 + sprung_z**2)
    gyro_xz = sprung * sprung_x * sprung_z
    inertia_x, inertia_y = gyro_x + carried["zz"], gyro_y + carried["zz"]
    inertia_xz = gyro_xz + carried["xz"]
    if inertia_xz**2 > 0.25 * inertia_x * v.yaw_inertia:
        raise ValueError("chassis: roll and yaw inertia are too small for where the masses are")

    spring = [
        _or_default(given, mass * (2.0 * math.pi * hertz) ** 2)
        for given, mass, hertz in zip(
            (k.spring_front, k.spring_rear), corner, _HEAVE_HZ, strict=True
        )
    ]
    damper = [
        _or_default(given, 2.0 * _DAMPING * math.sqrt(rate * mass))
        for given, rate, mass in zip((k.damper_front, k.damper_rear), spring, corner, strict=True)
    ]
    # Rolling by an angle moves the wheels half a track each way: stiffness k track^2 / 2.
    bars = [
        _or_default(given, share * rate * 2.0 * half * half) / (4.0 * half * half)
        for given, share, rate in zip(
            (k.anti_roll_front, k.anti_roll_rear), _ROLL_BARS, spring, strict=True
        )
    ]
    tyre = [
        _or_default(given, force / _STATIC_TYRE_DEFLECTION_M)
        for given, force in zip((k.tyre_stiffness_front, k.tyre_stiffness_rear), load, strict=True)
    ]
    tyre_damping = [
        _or_default(given, 2.0 * _TYRE_DAMPING * math.sqrt(rate * mass))
        for given, rate, mass in zip(
            (k.tyre_damping_front, k.tyre_damping_rear), tyre, unsprung, strict=True
        )
    ]
    split = v.torque_split_front
    body = SprungMass(
        sprung_mass=sprung, sprung_x=sprung_x, sprung_z=sprung_z, wheel_z=wheel_z,
        inertia_x=inertia_x, inertia_y=inertia_y, inertia_z=v.yaw_inertia, inertia_xz=inertia_xz,
        sprung_inertia_xx=gyro_x, sprung_inertia_yy=gyro_y, sprung_inertia_zz=gyro_z, sprung_inertia_xz=gyro_xz,
        unsprung_m_xx=carried["xx"], unsprung_m_yy=carried["yy"], unsprung_m_zz=carried["zz"],
        unsprung_m_xz=carried["xz"],
        unsprung_f=unsprung[0], unsprung_r=unsprung[1], static_f=static[0], static_r=static[1],
        load_f=load[0], load_r=load[1], spring_f=spring[0], spring_r=spring[1],
        damper_f=damper[0], damper_r=damper[1], bar_f=bars[0], bar_r=bars[1],
        tyre_stiffness_f=tyre[0], tyre_stiffness_r=tyre[1],
        tyre_damping_f=tyre_damping[0], tyre_damping_r=tyre_damping[1],
        roll_centre_f=k.roll_centre_front, roll_centre_r=k.roll_centre_rear,
        travel=k.travel, stop_stiffness=_or_default(k.stop_stiffness, 5.0 * spring[0]),
        lift_area_f=k.lift_area_front, lift_area_r=k.lift_area_rear,
        motor_limit_f=_or_default(k.motor_limit_front, 0.5 * split * v.max_drive_torque),
        motor_limit_r=_or_default(k.motor_limit_rear, 0.5 * (1.0 - split) * v.max_drive_torque),
        brake_split_front=k.brake_split_front, brake_lag=k.brake_lag,
    )  # fmt: skip
    fastest = float(np.abs(vertical_modes(vehicle, body, stopped=True)).max())
    if fastest > MAX_RATE:
        raise ValueError(
            f"chassis: a vertical mode of {fastest:.0f} 1/s is too fast for steps of 1 ms (at "
            f"most {MAX_RATE:.0f}): softer springs, dampers or tyres, or heavier wheels"
        )
    return body


def _or_default(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def vertical_modes(
    vehicle: VehicleWithChassis, body: SprungMass, stopped: bool = False
) -> NDArray[np.complex128]:
    """
    Return the eigenvalues (14,) of heave, roll, pitch and the four wheels' height, 1/s.

    Linear about rest on a level road; complex. `stopped`: as if the wheels were at their stops.
    """
    half = 0.5 * vehicle.track_width
    x = np.array([vehicle.cg_to_front_axle] * 2 + [-vehicle.cg_to_rear_axle] * 2)
    y = np.array([half, -half] * 2)
    masses = np.array([body.unsprung_f] * 2 + [body.unsprung_r] * 2)
    inertia = np.diag([body.sprung_mass, body.inertia_x, body.inertia_y, *masses])
    inertia[0, 2] = inertia[2, 0] = -body.sprung_mass * body.sprung_x
    # How far each wheel comes up in the body: its own height less the body's above it.
    travel = np.column_stack([-np.ones(4), -y, x, np.eye(4)])
    stop = body.stop_stiffness if stopped else 0.0
    spring = np.diag([body.spring_f + stop] * 2 + [body.spring_r + stop] * 2)
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    spring[:2, :2] += body.bar_f * pair
    spring[2:, 2:] += body.bar_r * pair
    damper = np.diag([body.damper_f] * 2 + [body.damper_r] * 2)
    stiffness = travel.T @ spring @ travel
    damping = travel.T @ damper @ travel
    on_road = [body.tyre_stiffness_f] * 2 + [body.tyre_stiffness_r] * 2
    stiffness[3:, 3:] += np.diag(on_road)
    damping[3:, 3:] += np.diag([body.tyre_damping_f] * 2 + [body.tyre_damping_r] * 2)
    lower = np.linalg.solve(inertia, np.hstack([-stiffness, -damping]))
    system = np.vstack([np.hstack([np.zeros((7, 7)), np.eye(7)]), lower])
    return np.asarray(np.linalg.eigvals(system), dtype=np.complex128)
