# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Equations of motion with fourteen degrees of freedom on a three-dimensional road.

Degrees of freedom: six of the body, the travel of four unsprung masses along the body's vertical,
four wheel spins. Body axes (REP-103), origin P at the centre of gravity of the vehicle at rest;
attitude: heading, pitch, roll about z, y, x in that order; wheels: front left, front right, rear
left, rear right.

    m (du/dt + q w - r v) = sum(F_xi) + air + m g_x - 2 q sum(m_i dzeta_i/dt)
    m (dv/dt + r u - p w) = sum(F_yi) + air + m g_y + 2 p sum(m_i dzeta_i/dt)
    m_s a_sz              = sum(S_i) + lift + m_s g_z
    I_x dp/dt - I_xz dr/dt     = M_x
    I_y dq/dt - m_s x_s a_Pz   = M_y
    I_z dr/dt - I_xz dp/dt     = M_z
    m_i a_iz              = F_zi - S_i + m_i g_z        (S_i with its links: `suspension`)
    I_w domega_i/dt       = T_i - R f_xi                (T_i acts back on the body)

where (u, v, w) and (p, q, r) are velocity and rates in body axes, g is gravity in body axes, F_i
the force of the road on tyre i (load along the road's normal, longitudinal and lateral force in
its plane), S_i the suspension force and M the moments about P; masses and inertias as in
`sprung_mass`.

The accelerometer is fixed to the body at P: it senses (du/dt, dv/dt, ...) + omega x v - g. Tyre
model: `tyre`, with slips in the road plane at the contact. Limits of commands, speed and friction
and the first entries of the state are those of `seven_dof`.

RK4 at 1 ms: the fastest modes are the wheel spins (about 230 1/s) and wheel hop (about 60 1/s);
vehicles with modes above 2000 1/s are refused. Finite for any finite input: see `seven_dof`.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.numerics.runge_kutta import axpy, clip, take_step
from adk_ros.plant.environment.surface import PLANE_MU, PLANE_OFFSET, PLANE_X, PLANE_Y, PLANE_Z
from adk_ros.plant.vehicle.actuators import brake_torque, torque_requests
from adk_ros.plant.vehicle.sprung_mass import SprungMass
from adk_ros.plant.vehicle.suspension import corner, suspension_force, tyre_load
from adk_ros.plant.vehicle.tyre import (
    axle_tyre,
    combined_slip_utilisation,
    friction,
    relaxation_rate,
)
from adk_ros.plant.vehicle.vehicle_forces import aerodynamic_forces, rolling_resistance
from adk_ros.plant.vehicle.vehicle_parameters import Constants

V_X, V_Y, YAW_RATE = 0, 1, 2
OMEGA = 3
F_X_UTIL = 7
F_Y_UTIL = 11
V_Z, ROLL_RATE, PITCH_RATE = 15, 16, 17
DELTA = 18
X, Y, HEADING = 19, 20, 21
Z, ROLL, PITCH = 22, 23, 24
TRAVEL = 25
TRAVEL_RATE = 29
MOTOR = 33
BRAKE = 37
STATE_SIZE = 41
"""State index: four entries, one per wheel, from each of OMEGA, F_X_UTIL, F_Y_UTIL, TRAVEL,
TRAVEL_RATE, MOTOR and BRAKE on. The first 15 entries and DELTA to HEADING are those of
`seven_dof`."""

STATE_LIMIT = np.array(
    [150.0, 150.0, 30.0] + [2000.0] * 4 + [1.0] * 8 + [100.0, 30.0, 30.0, 1.5]
    + [1e9, 1e9, 1e9, 1e5, 1.2, 1.2] + [1.0] * 4 + [100.0] * 4 + [1e6] * 8
)  # fmt: skip
"""Largest magnitude of each state entry, SI: far beyond driving, keeps the integration finite."""


@strict_kernel
def derivative(
    c: Constants,
    b: SprungMass,
    state: FloatArray,
    command: FloatArray,
    planes: FloatArray,
    wind: tuple[float, float],
    step: float,
    out: FloatArray,
) -> tuple[float, float]:
    """
    Write d(state)/dt to `out`; return the specific force (a_x, a_y) at P, m/s².

    `command` = (torque, delta); `planes` (4, 5): road plane under each wheel, see `surface`;
    `wind` towards map +x, +y, m/s; `step`: integration step, s, which bounds the rates of lags.
    """
    v_x, v_y, v_z = state[V_X], state[V_Y], state[V_Z]
    p, q, r = state[ROLL_RATE], state[PITCH_RATE], state[YAW_RATE]
    cos_h, sin_h = math.cos(state[HEADING]), math.sin(state[HEADING])
    cos_p, sin_p = math.cos(state[PITCH]), math.sin(state[PITCH])
    cos_r, sin_r = math.cos(state[ROLL]), math.sin(state[ROLL])
    cos_d, sin_d = math.cos(state[DELTA]), math.sin(state[DELTA])
    # Rotation from body to map: t_xy is the map x component of the body's y axis.
    t_xx, t_xy = cos_p * cos_h, sin_r * sin_p * cos_h - cos_r * sin_h
    t_yx, t_yy = cos_p * sin_h, sin_r * sin_p * sin_h + cos_r * cos_h
    t_xz, t_yz = cos_r * sin_p * cos_h + sin_r * sin_h, cos_r * sin_p * sin_h - sin_r * cos_h
    t_zx, t_zy, t_zz = -sin_p, sin_r * cos_p, cos_r * cos_p
    g_x, g_y, g_z = -GRAVITY * t_zx, -GRAVITY * t_zy, -GRAVITY * t_zz

    wind_x = wind[0] * cos_h + wind[1] * sin_h
    wind_y = -wind[0] * sin_h + wind[1] * cos_h
    f_x, f_y, m_z = aerodynamic_forces(c, v_x, v_y, wind_x, wind_y)
    pressure = 0.5 * AIR_DENSITY * ((wind_x - v_x) ** 2 + (wind_y - v_y) ** 2)
    lift_f, lift_r = pressure * b.lift_area_f, pressure * b.lift_area_r
    f_z = lift_f + lift_r + b.sprung_mass * g_z
    m_x = 0.0
    m_y = lift_r * c.cg_to_rear_axle - lift_f * c.cg_to_front_axle
    m_y -= b.sprung_x * b.sprung_mass * g_z
    unsprung_vertical_momentum = 0.0

    motor_f, motor_r, brake_f, brake_r = torque_requests(c, b, command[0])
    motor_rate = 1.0 / max(c.torque_lag, step)
    brake_rate = 1.0 / max(b.brake_lag, step)
    for i in range(4):
        front = i < 2
        at = corner(b, front)
        tyre = axle_tyre(c, front)
        plane = planes[i]
        mu = min(max(plane[PLANE_MU], 0.01), 2.0)
        x = c.cg_to_front_axle if front else -c.cg_to_rear_axle
        y = 0.5 * c.track_width if i % 2 == 0 else -0.5 * c.track_width
        travel, rate = state[TRAVEL + i], state[TRAVEL_RATE + i]
        z = b.wheel_z + travel
        # The road's normal n in body axes, the camber against it, and the wheel's longitudinal (l)
        # and lateral (s) direction in the road plane.
        n_x = t_xx * plane[PLANE_X] + t_yx * plane[PLANE_Y] + t_zx * plane[PLANE_Z]
        n_y = t_xy * plane[PLANE_X] + t_yy * plane[PLANE_Y] + t_zy * plane[PLANE_Z]
        n_z = t_xz * plane[PLANE_X] + t_yz * plane[PLANE_Y] + t_zz * plane[PLANE_Z]
        cos, sin = (cos_d, sin_d) if front else (1.0, 0.0)
        sin_camber = cos * n_y - sin * n_x
        cos_camber = math.sqrt(max(1.0 - sin_camber * sin_camber, 1e-6))
        l_x, l_y = cos * n_z / cos_camber, sin * n_z / cos_camber
        l_z = -(sin * n_y + cos * n_x) / cos_camber
        s_x, s_y, s_z = n_y * l_z - n_z * l_y, n_z * l_x - n_x * l_z, n_x * l_y - n_y * l_x
        height = (
            plane[PLANE_X] * state[X] + plane[PLANE_Y] * state[Y] + plane[PLANE_Z] * state[Z]
            - plane[PLANE_OFFSET] + n_x * x + n_y * y + n_z * z
        )  # fmt: skip
        hub_x = v_x - r * y + q * z
        hub_y = v_y + r * x - p * z
        hub_z = v_z + p * y - q * x + rate
        # Contact point of a thin disc: camber offsets it laterally from below the hub.
        camber_rate = p * l_x + q * l_y + r * l_z
        offset = c.wheel_radius * sin_camber
        deflection_rate = -(n_x * hub_x + n_y * hub_y + n_z * hub_z + offset * camber_rate)
        load = tyre_load(at, c.wheel_radius * cos_camber - height, deflection_rate)
        along = l_x * hub_x + l_y * hub_y + l_z * hub_z
        across = s_x * hub_x + s_y * hub_y + s_z * hub_z
        across += height * camber_rate + rate * at.roll_centre / y

        contact = math.hypot(along, across)
        rolling = max(abs(along), c.slip_speed_min)
        kappa = (state[OMEGA + i] * c.wheel_radius - along) / rolling
        tan_alpha = -across / rolling
        n_steady_x, n_steady_y = combined_slip_utilisation(
            tyre, tyre.b_x / mu * kappa, tyre.b_y / mu * tan_alpha
        )
        rate_x = relaxation_rate(contact, tyre.relaxation_length_x, c.slip_speed_min, step)
        rate_y = relaxation_rate(contact, tyre.relaxation_length, c.slip_speed_min, step)
        out[F_X_UTIL + i] = rate_x * (n_steady_x - state[F_X_UTIL + i])
        out[F_Y_UTIL + i] = rate_y * (n_steady_y - state[F_Y_UTIL + i])
        peak = mu * load * friction(tyre, load)
        drive = peak * state[F_X_UTIL + i]
        side = peak * state[F_Y_UTIL + i]
        torque = state[MOTOR + i]
        torque += brake_torque(state[BRAKE + i], state[OMEGA + i], c.wheel_inertia, step)
        out[OMEGA + i] = (torque - c.wheel_radius * drive) / c.wheel_inertia
        drive += rolling_resistance(c.crr, load, along)
        b_x = drive * l_x + side * s_x + load * n_x
        b_y = drive * l_y + side * s_y + load * n_y
        b_z = drive * l_z + side * s_z + load * n_z
        opposite = state[TRAVEL + (i ^ 1)]
        force = suspension_force(at, b.stop_stiffness, b.travel, travel, rate, opposite)
        force -= side * at.roll_centre / y
        f_x += b_x
        f_y += b_y
        f_z += force
        overturning_moment = height * side + offset * load
        m_x += y * force - z * b_y + overturning_moment * l_x + torque * sin
        m_y += z * b_x - x * force + overturning_moment * l_y - torque * cos
        m_z += x * b_y - y * b_x + overturning_moment * l_z
        out[TRAVEL + i] = rate
        # Completed below, once the acceleration of the body is known.
        out[TRAVEL_RATE + i] = (b_z - force) / at.unsprung + g_z
        unsprung_vertical_momentum += at.unsprung * rate
        out[MOTOR + i] = motor_rate * ((motor_f if front else motor_r) - state[MOTOR + i])
        out[BRAKE + i] = brake_rate * ((brake_f if front else brake_r) - state[BRAKE + i])

    f_x -= 2.0 * q * unsprung_vertical_momentum
    f_y += 2.0 * p * unsprung_vertical_momentum
    a_x, a_y = f_x / c.mass, f_y / c.mass
    out[V_X] = a_x + g_x + r * v_y - q * v_z
    out[V_Y] = a_y + g_y - r * v_x + p * v_z
    m_x -= q * r * (b.sprung_inertia_zz - b.sprung_inertia_yy - b.unsprung_m_zz) - p * q * (
        b.sprung_inertia_xz + b.unsprung_m_xz
    )
    m_y -= r * p * (
        b.sprung_inertia_xx - b.sprung_inertia_zz + b.unsprung_m_zz
    ) + b.sprung_inertia_xz * (p * p - r * r)
    m_y += (q * q + r * r) * b.unsprung_m_xz
    m_z -= p * q * (b.sprung_inertia_yy - b.sprung_inertia_xx + b.unsprung_m_xx - b.unsprung_m_yy)
    m_z -= q * r * (b.sprung_inertia_xz + b.unsprung_m_xz)
    lateral = b.inertia_x * b.inertia_z - b.inertia_xz * b.inertia_xz
    p_rate = (b.inertia_z * m_x + b.inertia_xz * m_z) / lateral
    r_rate = (b.inertia_x * m_z + b.inertia_xz * m_x) / lateral
    # m_s (a_z - x_s q') = f_z' and I_y q' - m_s x_s a_z = m_y, a_z = acceleration of P.
    f_z -= b.sprung_mass * (r * p * b.sprung_x - b.sprung_z * (p * p + q * q))
    q_rate = (m_y + b.sprung_x * f_z) / (b.inertia_y - b.sprung_mass * b.sprung_x * b.sprung_x)
    a_z = f_z / b.sprung_mass + b.sprung_x * q_rate
    out[V_Z] = a_z - p * v_y + q * v_x
    out[ROLL_RATE], out[PITCH_RATE], out[YAW_RATE] = p_rate, q_rate, r_rate
    for i in range(4):
        x = c.cg_to_front_axle if i < 2 else -c.cg_to_rear_axle
        y = 0.5 * c.track_width if i % 2 == 0 else -0.5 * c.track_width
        z = b.wheel_z + state[TRAVEL + i]
        body_a_z = a_z + p_rate * y - q_rate * x + r * (p * x + q * y) - z * (p * p + q * q)
        out[TRAVEL_RATE + i] -= body_a_z

    out[DELTA] = (clip(command[1], c.max_steer) - state[DELTA]) / max(c.steer_lag, step)
    out[X] = t_xx * v_x + t_xy * v_y + t_xz * v_z
    out[Y] = t_yx * v_x + t_yy * v_y + t_yz * v_z
    out[Z] = t_zx * v_x + t_zy * v_y + t_zz * v_z
    heading_rate = (q * sin_r + r * cos_r) / max(cos_p, 0.1)
    out[HEADING] = heading_rate
    out[PITCH] = q * cos_r - r * sin_r
    out[ROLL] = p + heading_rate * sin_p
    return a_x, a_y


@strict_kernel
def rk4_step(
    c: Constants,
    b: SprungMass,
    state: FloatArray,
    command: FloatArray,
    planes: FloatArray,
    wind: tuple[float, float],
    step: float,
    work: FloatArray,
) -> tuple[float, float]:
    """
    Advance `state` in place by one classical Runge-Kutta step with constant inputs.

    `work` (5, STATE_SIZE) is scratch. Returns the specific force at the start of the step.
    """
    a_x, a_y = derivative(c, b, state, command, planes, wind, step, work[0])
    axpy(state, 0.5 * step, work[0], work[4])
    derivative(c, b, work[4], command, planes, wind, step, work[1])
    axpy(state, 0.5 * step, work[1], work[4])
    derivative(c, b, work[4], command, planes, wind, step, work[2])
    axpy(state, step, work[2], work[4])
    derivative(c, b, work[4], command, planes, wind, step, work[3])
    take_step(state, step, work, STATE_LIMIT)
    return a_x, a_y


@strict_kernel
def advance(
    c: Constants,
    b: SprungMass,
    state: FloatArray,
    commands: FloatArray,
    planes: FloatArray,
    wind: tuple[float, float],
    step: float,
    substeps: int,
    states: FloatArray,
    forces: FloatArray,
) -> None:
    """
    Advance `state` (STATE_SIZE,) in place under `commands` (n, 2) on constant road planes.

    As `seven_dof.advance`: row k of `states` (n + 1, STATE_SIZE) and `forces` (n + 1, 2) applies
    at the start of command k, the last row at the end.
    """
    work = np.empty((5, STATE_SIZE))
    n = commands.shape[0]
    for j in range(STATE_SIZE):
        state[j] = clip(state[j], STATE_LIMIT[j])
    for k in range(n):
        states[k] = state
        for i in range(substeps):
            a_x, a_y = rk4_step(c, b, state, commands[k], planes, wind, step, work)
            if i == 0:
                forces[k, 0] = a_x
                forces[k, 1] = a_y
    states[n] = state
    forces[n, 0], forces[n, 1] = derivative(
        c, b, state, commands[n - 1], planes, wind, step, work[0]
    )


def rolling_state(
    c: Constants,
    v_x: float,
    plane: FloatArray,
    x: float = 0.0,
    y: float = 0.0,
    heading: float = 0.0,
) -> FloatArray:
    """
    Return the state (STATE_SIZE,) of a vehicle that rolls straight ahead on `plane` without slip.

    The body is parallel to the road and the wheel travel is that of a level road.
    """
    state = np.zeros(STATE_SIZE)
    cos, sin = math.cos(heading), math.sin(heading)
    n_x, n_y, n_z = plane[PLANE_X], plane[PLANE_Y], plane[PLANE_Z]
    state[V_X] = v_x
    state[OMEGA : OMEGA + 4] = v_x / c.wheel_radius
    state[X], state[Y], state[HEADING] = x, y, heading
    state[Z] = (plane[PLANE_OFFSET] + c.cg_height - n_x * x - n_y * y) / n_z
    state[ROLL] = -math.asin(n_y * cos - n_x * sin)
    state[PITCH] = math.atan2(n_x * cos + n_y * sin, n_z)
    return state
