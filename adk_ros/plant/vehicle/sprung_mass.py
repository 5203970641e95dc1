# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Masses, inertias and stiffnesses of the fourteen-degree-of-freedom vehicle, for the kernels.

The reference point P is the centre of gravity of the whole vehicle at rest. The sprung mass is a
rigid body; each unsprung mass is a point mass that moves with the body along x and y and has its
own degree of freedom along the body's vertical. With x, z the positions relative to P at rest,

    sum(m x) = 0, sum(m z) = 0
    I_x  = I_roll  + m_s z_s^2 + sum(m_i z_i^2)          (only x, y motion of the unsprung masses)
    I_y  = I_pitch + m_s (x_s^2 + z_s^2) + sum(m_i z_i^2)
    I_z  = yaw inertia of the vehicle
    I_xz = m_s x_s z_s + sum(m_i x_i z_i)
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.similarity import length_scale, time_scale
from adk_ros.plant.vehicle.chassis import Chassis

MAX_RATE = 2000.0
"""Fastest admissible mode, 1/s: RK4 with steps of 1 ms is stable up to about 2800 1/s."""

# Defaults for a passenger car, of which a scale model has the similar ones. They are assumptions
# within the usual ranges, not identified.
_HEAVE_HZ = (1.3, 1.45)
"""Heave frequency of the sprung corner, front and rear, Hz; the rear is faster, so that pitch
after a bump settles (flat ride)."""
_DAMPING = 0.35
"""Damping ratio of the sprung corner, between comfort (0.2) and handling (0.5)."""
_ANTI_ROLL_RATIO = (0.45, 0.15)
"""Roll stiffness of the anti-roll bar over that of the springs, front and rear: understeering."""
_STATIC_TYRE_DEFLECTION_M = 0.02
"""Static vertical deflection of the tyre, m: about 250 kN/m at 5 kN."""
_TYRE_DAMPING = 0.02
"""Damping ratio of the unsprung mass on the tyre."""
_UNSPRUNG_SHARE = 0.04
"""Mass of one wheel with its hub over the mass of the vehicle."""
_PITCH_TO_YAW_INERTIA = 0.8
_ROLL_GYRATION_TO_TRACK = 0.36
"""Radius of gyration in roll over the track width."""
_STOP_TO_SPRING = 5.0
"""Stiffness of the stops over that of the front spring."""


class VehicleWithChassis(Protocol):
    """The fields of a vehicle that `resolve` needs, SI."""

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
        """Return the chassis section."""


class SprungMass(NamedTuple):
    """Parameters for the kernels, SI; `_f`, `_r`: of one wheel of the front or the rear axle."""

    sprung_mass: float
    sprung_x: float
    sprung_z: float
    """Position of the sprung mass's centre of gravity relative to P, m."""
    wheel_z: float
    """Height of the wheel centres relative to P at rest, m."""
    inertia_x: float
    inertia_y: float
    inertia_z: float
    inertia_xz: float
    sprung_inertia_xx: float
    sprung_inertia_yy: float
    sprung_inertia_zz: float
    sprung_inertia_xz: float
    """Contribution of the sprung mass to the inertias about P, in its gyroscopic terms."""
    unsprung_m_xx: float
    unsprung_m_yy: float
    unsprung_m_zz: float
    unsprung_m_xz: float
    """Sums of m_i times x_i x_i, y_i y_i, z_i z_i, x_i z_i over the unsprung masses, kg·m²."""
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
    """Anti-roll bar: force at either wheel per difference of the travels, N/m."""
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
"""Placeholder for the seven-degree-of-freedom plant, which has no sprung mass."""


def resolve(vehicle: VehicleWithChassis) -> SprungMass:
    """
    Return the parameters of `vehicle`; missing chassis values get the defaults of a passenger car.

    :raises ValueError: masses and inertias contradict each other, or the integration step cannot
        resolve the suspension; one line.
    """
    v, k = vehicle, vehicle.chassis_or_default()
    wheelbase = v.cg_to_front_axle + v.cg_to_rear_axle
    size, half = length_scale(wheelbase), 0.5 * v.track_width
    default_unsprung = _UNSPRUNG_SHARE * v.mass
    unsprung = [
        _or_default(k.unsprung_mass_front, default_unsprung),
        _or_default(k.unsprung_mass_rear, default_unsprung),
    ]
    sprung = v.mass - 2.0 * sum(unsprung)
    if sprung < 0.2 * v.mass:
        raise ValueError("chassis: the sprung mass is less than a fifth of the mass")
    axle_x = [v.cg_to_front_axle, -v.cg_to_rear_axle]
    wheel_z = v.wheel_radius - v.cg_height
    sprung_x = -2.0 * (unsprung[0] * axle_x[0] + unsprung[1] * axle_x[1]) / sprung
    sprung_z = -2.0 * sum(unsprung) * wheel_z / sprung
    shares = [(sprung_x - axle_x[1]) / wheelbase, (axle_x[0] - sprung_x) / wheelbase]
    if min(shares) < 0.02:
        raise ValueError("chassis: the sprung mass's centre of gravity is not between the axles")
    corner = [0.5 * sprung * share for share in shares]
    static = [mass * GRAVITY for mass in corner]
    load = [force + mass * GRAVITY for force, mass in zip(static, unsprung, strict=True)]

    unsprung_m = {
        "xx": 2.0 * sum(m * x * x for m, x in zip(unsprung, axle_x, strict=True)),
        "yy": 2.0 * sum(unsprung) * half * half,
        "zz": 2.0 * sum(unsprung) * wheel_z * wheel_z,
        "xz": 2.0 * wheel_z * sum(m * x for m, x in zip(unsprung, axle_x, strict=True)),
    }
    sprung_zz = v.yaw_inertia - unsprung_m["xx"] - unsprung_m["yy"]
    if sprung_zz < 0.05 * v.yaw_inertia + sprung * sprung_x * sprung_x:
        raise ValueError(
            "chassis: the yaw inertia is less than that of the unsprung masses alone: raise "
            "yaw_inertia or lower chassis.unsprung_mass_front and _rear"
        )
    roll = _or_default(k.roll_inertia, sprung * (_ROLL_GYRATION_TO_TRACK * v.track_width) ** 2)
    pitch = _or_default(k.pitch_inertia, _PITCH_TO_YAW_INERTIA * v.yaw_inertia)
    sprung_xx = roll + sprung * sprung_z**2
    sprung_yy = pitch + sprung * (sprung_x**2 + sprung_z**2)
    sprung_xz = sprung * sprung_x * sprung_z
    inertia_x, inertia_y = sprung_xx + unsprung_m["zz"], sprung_yy + unsprung_m["zz"]
    inertia_xz = sprung_xz + unsprung_m["xz"]
    if inertia_xz**2 > 0.25 * inertia_x * v.yaw_inertia:
        raise ValueError("chassis: roll and yaw inertia are too small for the mass positions")

    spring = [
        _or_default(given, mass * (2.0 * math.pi * hertz / time_scale(size)) ** 2)
        for given, mass, hertz in zip(
            (k.spring_front, k.spring_rear), corner, _HEAVE_HZ, strict=True
        )
    ]
    damper = [
        _or_default(given, 2.0 * _DAMPING * math.sqrt(rate * mass))
        for given, rate, mass in zip((k.damper_front, k.damper_rear), spring, corner, strict=True)
    ]
    # Roll moves each wheel of the axle by half a track times the angle: stiffness k track^2 / 2.
    bars = [
        _or_default(given, share * rate * 2.0 * half * half) / (4.0 * half * half)
        for given, share, rate in zip(
            (k.anti_roll_front, k.anti_roll_rear), _ANTI_ROLL_RATIO, spring, strict=True
        )
    ]
    tyre = [
        _or_default(given, force / (_STATIC_TYRE_DEFLECTION_M * size))
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
        sprung_inertia_xx=sprung_xx, sprung_inertia_yy=sprung_yy, sprung_inertia_zz=sprung_zz,
        sprung_inertia_xz=sprung_xz,
        unsprung_m_xx=unsprung_m["xx"], unsprung_m_yy=unsprung_m["yy"],
        unsprung_m_zz=unsprung_m["zz"], unsprung_m_xz=unsprung_m["xz"],
        unsprung_f=unsprung[0], unsprung_r=unsprung[1], static_f=static[0], static_r=static[1],
        load_f=load[0], load_r=load[1], spring_f=spring[0], spring_r=spring[1],
        damper_f=damper[0], damper_r=damper[1], bar_f=bars[0], bar_r=bars[1],
        tyre_stiffness_f=tyre[0], tyre_stiffness_r=tyre[1],
        tyre_damping_f=tyre_damping[0], tyre_damping_r=tyre_damping[1],
        roll_centre_f=k.roll_centre_front, roll_centre_r=k.roll_centre_rear,
        travel=k.travel,
        stop_stiffness=_or_default(k.stop_stiffness, _STOP_TO_SPRING * spring[0]),
        lift_area_f=k.lift_area_front, lift_area_r=k.lift_area_rear,
        motor_limit_f=_or_default(k.motor_limit_front, 0.5 * split * v.max_drive_torque),
        motor_limit_r=_or_default(k.motor_limit_rear, 0.5 * (1.0 - split) * v.max_drive_torque),
        brake_split_front=k.brake_split_front, brake_lag=k.brake_lag,
    )  # fmt: skip
    fastest = float(np.abs(vertical_modes(vehicle, body, stopped=True)).max())
    if fastest > MAX_RATE:
        raise ValueError(
            f"chassis: a vertical mode of {fastest:.0f} 1/s is too fast for steps of 1 ms (at "
            f"most {MAX_RATE:.0f}): use softer springs, dampers or tyres, or heavier wheels"
        )
    return body


def _or_default(value: float | None, default: float) -> float:
    return default if value is None else value


def vertical_modes(
    vehicle: VehicleWithChassis, body: SprungMass, stopped: bool = False
) -> NDArray[np.complex128]:
    """
    Return the eigenvalues (14,) of heave, roll, pitch and the height of the four wheels, 1/s.

    Linearised about rest on a level road; complex. `stopped`: with the stops in contact.
    """
    half = 0.5 * vehicle.track_width
    x = np.array([vehicle.cg_to_front_axle] * 2 + [-vehicle.cg_to_rear_axle] * 2)
    y = np.array([half, -half] * 2)
    masses = np.array([body.unsprung_f] * 2 + [body.unsprung_r] * 2)
    inertia = np.diag([body.sprung_mass, body.inertia_x, body.inertia_y, *masses])
    inertia[0, 2] = inertia[2, 0] = -body.sprung_mass * body.sprung_x
    # Travel of each wheel: its height less that of the body above it.
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
