# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Equations of motion with seven degrees of freedom: v_x, v_y, yaw rate and four wheel spins.

Body axes (REP-103), origin at the centre of gravity; wheels in the order front left, front right,
rear left, rear right.

    m (dv_x/dt - v_y r) = F_x + m g_x           a_x = F_x / m   (specific force: no gravity in it)
    m (dv_y/dt + v_x r) = F_y + m g_y           a_y = F_y / m
    I_z dr/dt           = sum(x_i F_yi - y_i F_xi) + aerodynamic yaw moment
    I_w domega_i/dt     = T_i - R f_xi
    dn_xi/dt            = V_i / length_x (steady n_x(kappa_i, alpha_i) - n_xi)
    dn_yi/dt            = V_i / length (steady n_y(kappa_i, alpha_i) - n_yi)
    kappa_i             = (omega_i R - v_i) / |v_i|,   tan(alpha_i) = -v_ti / |v_i|

where F is the sum over the wheels of tyre force and rolling resistance in body axes plus the
aerodynamic force, g_x = -g sin(grade) and g_y = -g sin(bank) are gravity along the road, v_i and
v_ti the velocity of the wheel's hub along and across the wheel, V_i its magnitude, and n the force
utilisation (see `tyre`).

Wheel loads follow a_x, a_y with the time constant `load_lag`: without an algebraic loop the
integrator keeps its order. Torque and road-wheel angle follow their commands with first-order
lags. A negative torque brakes a vehicle that rolls forward and, like in-wheel motors, reverses one
at standstill.

Finite for any finite input: commands are clamped to the actuators' limits, slips use a rolling
speed of at least 2 m/s (less of a scale model), and the state is clamped to `STATE_LIMIT`, far
beyond all driving.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.numerics.runge_kutta import axpy, clip, take_step
from adk_ros.plant.vehicle.tyre import (
    axle_tyre,
    combined_slip_utilisation,
    friction,
    relaxation_rate,
)
from adk_ros.plant.vehicle.vehicle_forces import (
    aerodynamic_forces,
    road_normal_weight,
    rolling_resistance,
    to_body_axes,
    wheel_hub,
    wheel_loads,
)
from adk_ros.plant.vehicle.vehicle_parameters import Constants

STEP = 1e-3
"""Integration step of both plants, s; stable for rates up to about 2800 1/s (RK4)."""

V_X, V_Y, YAW_RATE = 0, 1, 2
OMEGA = 3
F_X_UTIL = 7
F_Y_UTIL = 11
LOAD_A_X, LOAD_A_Y = 15, 16
TORQUE, DELTA = 17, 18
X, Y, HEADING = 19, 20, 21
STATE_SIZE = 22
"""State index: four entries, one per wheel, from each of OMEGA, F_X_UTIL and F_Y_UTIL on."""

STATE_LIMIT = np.array(
    [150.0, 150.0, 30.0] + [2000.0] * 4 + [1.0] * 8 + [100.0, 100.0, 1e6, 1.5, 1e9, 1e9, 1e9]
)
"""Largest magnitude of each state entry, SI: far beyond driving, keeps the integration finite."""


@strict_kernel
def drive_torque(c: Constants, torque: float) -> float:
    """Clamp the commanded total torque to the limits of motors and brakes, N·m."""
    return min(max(torque, -c.max_brake_torque), c.max_drive_torque)


@strict_kernel
def derivative(
    c: Constants,
    state: FloatArray,
    command: FloatArray,
    road: FloatArray,
    step: float,
    out: FloatArray,
) -> tuple[float, float]:
    """
    Write d(state)/dt to `out`; return the specific force (a_x, a_y) at the CG, m/s².

    `command` = (torque, delta); `road` = (mu, grade, bank, wind towards map +x, +y); `step`:
    integration step, s, which bounds the rates of lags.
    """
    v_x, v_y, yaw_rate = state[V_X], state[V_Y], state[YAW_RATE]
    mu = min(max(road[0], 0.01), 2.0)
    grade, bank = road[1], road[2]
    cos_h, sin_h = math.cos(state[HEADING]), math.sin(state[HEADING])
    f_x, f_y, m_z = aerodynamic_forces(
        c, v_x, v_y, road[3] * cos_h + road[4] * sin_h, -road[3] * sin_h + road[4] * cos_h
    )
    weight = road_normal_weight(c.mass, grade, bank, v_x, yaw_rate)
    loads = wheel_loads(c, state[LOAD_A_X], state[LOAD_A_Y], weight)
    cos_d, sin_d = math.cos(state[DELTA]), math.sin(state[DELTA])
    for i in range(4):
        front = i < 2
        tyre = axle_tyre(c, front)
        hub = wheel_hub(c, i, cos_d, sin_d, v_x, v_y, yaw_rate)
        contact = math.hypot(hub.along, hub.across)
        rolling = max(abs(hub.along), c.slip_speed_min)
        kappa = (state[OMEGA + i] * c.wheel_radius - hub.along) / rolling
        tan_alpha = -hub.across / rolling
        n_steady_x, n_steady_y = combined_slip_utilisation(
            tyre, tyre.b_x / mu * kappa, tyre.b_y / mu * tan_alpha
        )
        rate_x = relaxation_rate(contact, tyre.relaxation_length_x, c.slip_speed_min, step)
        rate_y = relaxation_rate(contact, tyre.relaxation_length, c.slip_speed_min, step)
        out[F_X_UTIL + i] = rate_x * (n_steady_x - state[F_X_UTIL + i])
        out[F_Y_UTIL + i] = rate_y * (n_steady_y - state[F_Y_UTIL + i])
        peak = mu * loads[i] * friction(tyre, loads[i])
        t_x = peak * state[F_X_UTIL + i]
        share = 0.5 * (c.torque_split_front if front else 1.0 - c.torque_split_front)
        out[OMEGA + i] = (share * state[TORQUE] - c.wheel_radius * t_x) / c.wheel_inertia
        t_x += rolling_resistance(c.crr, loads[i], hub.along)
        b_x, b_y, b_m = to_body_axes(hub, t_x, peak * state[F_Y_UTIL + i])
        f_x += b_x
        f_y += b_y
        m_z += b_m
    a_x = f_x / c.mass
    a_y = f_y / c.mass
    out[V_X] = a_x + v_y * yaw_rate - GRAVITY * math.sin(grade)
    out[V_Y] = a_y - v_x * yaw_rate - GRAVITY * math.sin(bank)
    out[YAW_RATE] = m_z / c.yaw_inertia
    load_rate = 1.0 / max(c.load_lag, step)
    out[LOAD_A_X] = load_rate * (a_x - state[LOAD_A_X])
    out[LOAD_A_Y] = load_rate * (a_y - state[LOAD_A_Y])
    out[TORQUE] = (drive_torque(c, command[0]) - state[TORQUE]) / max(c.torque_lag, step)
    out[DELTA] = (clip(command[1], c.max_steer) - state[DELTA]) / max(c.steer_lag, step)
    out[X] = v_x * cos_h - v_y * sin_h
    out[Y] = v_x * sin_h + v_y * cos_h
    out[HEADING] = yaw_rate
    return a_x, a_y


@strict_kernel
def rk4_step(
    c: Constants,
    state: FloatArray,
    command: FloatArray,
    road: FloatArray,
    step: float,
    work: FloatArray,
) -> tuple[float, float]:
    """
    Advance `state` in place by one classical Runge-Kutta step with constant inputs.

    `work` (5, STATE_SIZE) is scratch. Returns the specific force at the start of the step.
    """
    a_x, a_y = derivative(c, state, command, road, step, work[0])
    axpy(state, 0.5 * step, work[0], work[4])
    derivative(c, work[4], command, road, step, work[1])
    axpy(state, 0.5 * step, work[1], work[4])
    derivative(c, work[4], command, road, step, work[2])
    axpy(state, step, work[2], work[4])
    derivative(c, work[4], command, road, step, work[3])
    take_step(state, step, work, STATE_LIMIT)
    return a_x, a_y


@strict_kernel
def advance(
    c: Constants,
    state: FloatArray,
    commands: FloatArray,
    road: FloatArray,
    step: float,
    substeps: int,
    states: FloatArray,
    forces: FloatArray,
) -> None:
    """
    Advance `state` (STATE_SIZE,) in place under `commands` (n, 2), `substeps` steps for each.

    Row k of `states` (n + 1, STATE_SIZE) and of `forces` (n + 1, 2) applies at the start of
    command k, the last row at the end. The road, as in `derivative`, is constant.
    """
    work = np.empty((5, state.shape[0]))
    n = commands.shape[0]
    for j in range(state.shape[0]):
        state[j] = clip(state[j], STATE_LIMIT[j])
    for k in range(n):
        states[k] = state
        for i in range(substeps):
            a_x, a_y = rk4_step(c, state, commands[k], road, step, work)
            if i == 0:
                forces[k, 0] = a_x
                forces[k, 1] = a_y
    states[n] = state
    last = commands[n - 1]
    forces[n, 0], forces[n, 1] = derivative(c, state, last, road, step, work[0])


def rolling_state(
    c: Constants, v_x: float, x: float = 0.0, y: float = 0.0, heading: float = 0.0
) -> FloatArray:
    """Return the state (STATE_SIZE,) of a vehicle that rolls straight ahead without slip."""
    state = np.zeros(STATE_SIZE)
    state[V_X] = v_x
    state[OMEGA : OMEGA + 4] = v_x / c.wheel_radius
    state[X], state[Y], state[HEADING] = x, y, heading
    return state
