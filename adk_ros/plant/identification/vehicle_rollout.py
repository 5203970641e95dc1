# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Physics model as a predictor: rollouts from measured (v_x, v_y, yaw rate) under known commands.

Tyres, loads, aerodynamics and actuators are those of the plant. Wheel spins are not measured, so
the wheels are quasi-static: f_x is the wheel torque over the radius, and the rotating inertia
counts as mass,

    (m + 4 I_w / R^2) dv_x/dt = F_x + m v_y r + m g_x.

The longitudinal slip is the one at which the combined Magic Formula gives that f_x, limited by
friction. Unmeasured states start at their steady-state values: lateral forces, and wheel loads
(a_y = v_x r, a_x from the torque). Actuator states follow from the past commands, see
`actuator_states`.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.numerics.runge_kutta import axpy, clip, take_step
from adk_ros.plant.vehicle.seven_dof import STEP, drive_torque
from adk_ros.plant.vehicle.tyre import (
    AxleTyre,
    axle_tyre,
    combined_slip_utilisation,
    friction,
    magic_formula,
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
from adk_ros.plant.vehicle.vehicle_parameters import Constants, Vehicle
from adk_ros.signals.channels import TICK_NS

MAX_STEP = 12.5e-3
"""Longest integration step, s: half a tick, without loss of accuracy over 2 s."""

_F_Y_UTIL = 3
_LOAD_A_X, _LOAD_A_Y = 7, 8
_TORQUE, _DELTA = 9, 10
_SIZE = 11
_LIMIT = np.array([150.0, 150.0, 30.0] + [1.0] * 4 + [100.0, 100.0, 1e6, 1.5])

_SLIP_X_MAX = 1.5
"""Largest normalised longitudinal slip, near the peak of the curve: more torque has no effect."""


@strict_kernel
def driven_shares(tyre: AxleTyre, wanted: float, s_y: float) -> tuple[float, float]:
    """
    Return the utilisation (n_x, n_y) for n_x = `wanted` at normalised lateral slip `s_y`.

    Solves wanted = s_x magic_formula(s) / s for s_x by three fixed-point steps, limited to the
    peak.
    """
    s_x = clip(wanted / tyre.c_x, _SLIP_X_MAX)
    for _ in range(3):
        slip = math.hypot(s_x, s_y) + 1e-9
        s_x = clip(wanted * slip / max(magic_formula(slip, tyre.c_x, tyre.e_x), 1e-9), _SLIP_X_MAX)
    return combined_slip_utilisation(tyre, s_x, s_y)


@strict_kernel
def _derivative(
    c: Constants,
    state: FloatArray,
    command: FloatArray,
    road: FloatArray,
    step: float,
    out: FloatArray,
    steady: FloatArray,
) -> None:
    """Write d(state)/dt to `out` and the steady-state lateral utilisation to `steady` (4,)."""
    v_x, v_y, yaw_rate = state[0], state[1], state[2]
    mu = min(max(road[0], 0.01), 2.0)
    grade, bank = road[1], road[2]
    f_x, f_y, m_z = aerodynamic_forces(c, v_x, v_y, 0.0, 0.0)
    weight = road_normal_weight(c.mass, grade, bank, v_x, yaw_rate)
    loads = wheel_loads(c, state[_LOAD_A_X], state[_LOAD_A_Y], weight)
    cos_d, sin_d = math.cos(state[_DELTA]), math.sin(state[_DELTA])
    for i in range(4):
        front = i < 2
        tyre = axle_tyre(c, front)
        hub = wheel_hub(c, i, cos_d, sin_d, v_x, v_y, yaw_rate)
        peak = mu * loads[i] * friction(tyre, loads[i])
        share = 0.5 * (c.torque_split_front if front else 1.0 - c.torque_split_front)
        wanted = share * state[_TORQUE] / (c.wheel_radius * peak)
        tan_alpha = -hub.across / max(abs(hub.along), c.slip_speed_min)
        n_x, steady[i] = driven_shares(tyre, wanted, tyre.b_y / mu * tan_alpha)
        contact = math.hypot(hub.along, hub.across)
        rate = relaxation_rate(contact, tyre.relaxation_length, c.slip_speed_min, step)
        out[_F_Y_UTIL + i] = rate * (steady[i] - state[_F_Y_UTIL + i])
        t_x = peak * n_x + rolling_resistance(c.crr, loads[i], hub.along)
        b_x, b_y, b_m = to_body_axes(hub, t_x, peak * state[_F_Y_UTIL + i])
        f_x += b_x
        f_y += b_y
        m_z += b_m
    spun = c.mass + 4.0 * c.wheel_inertia / (c.wheel_radius * c.wheel_radius)
    g_x = -GRAVITY * math.sin(grade)
    g_y = -GRAVITY * math.sin(bank)
    a_y = f_y / c.mass
    out[0] = (f_x + c.mass * (v_y * yaw_rate + g_x)) / spun
    out[1] = a_y - v_x * yaw_rate + g_y
    out[2] = m_z / c.yaw_inertia
    load_rate = 1.0 / max(c.load_lag, step)
    out[_LOAD_A_X] = load_rate * (out[0] - v_y * yaw_rate - g_x - state[_LOAD_A_X])
    out[_LOAD_A_Y] = load_rate * (a_y - state[_LOAD_A_Y])
    out[_TORQUE] = (drive_torque(c, command[0]) - state[_TORQUE]) / max(c.torque_lag, step)
    out[_DELTA] = (clip(command[1], c.max_steer) - state[_DELTA]) / max(c.steer_lag, step)


@strict_kernel
def _start(
    c: Constants,
    x0: FloatArray,
    reached: FloatArray,
    road: FloatArray,
    step: float,
    state: FloatArray,
    work: FloatArray,
) -> None:
    state[:] = 0.0
    for j in range(3):
        state[j] = clip(x0[j], _LIMIT[j])
    state[_TORQUE] = drive_torque(c, reached[0])
    state[_DELTA] = clip(reached[1], c.max_steer)
    state[_LOAD_A_X] = clip(state[_TORQUE] / (c.wheel_radius * c.mass), _LIMIT[_LOAD_A_X])
    state[_LOAD_A_Y] = clip(state[0] * state[2], _LIMIT[_LOAD_A_Y])
    steady = work[1, :4]
    _derivative(c, state, reached, road, step, work[0], steady)
    state[_F_Y_UTIL : _F_Y_UTIL + 4] = steady


@strict_kernel
def _rollouts(
    c: Constants,
    x0: FloatArray,
    reached: FloatArray,
    u: FloatArray,
    road: FloatArray,
    step: float,
    substeps: int,
    out: FloatArray,
) -> None:
    state = np.empty(_SIZE)
    work = np.empty((5, _SIZE))
    unused = np.empty(4)
    for n in range(x0.shape[0]):
        _start(c, x0[n], reached[n], road, step, state, work)
        for k in range(u.shape[1]):
            command = u[n, k]
            for _ in range(substeps):
                _derivative(c, state, command, road, step, work[0], unused)
                axpy(state, 0.5 * step, work[0], work[4])
                _derivative(c, work[4], command, road, step, work[1], unused)
                axpy(state, 0.5 * step, work[1], work[4])
                _derivative(c, work[4], command, road, step, work[2], unused)
                axpy(state, step, work[2], work[4])
                _derivative(c, work[4], command, road, step, work[3], unused)
                take_step(state, step, work, _LIMIT)
            for j in range(3):
                out[n, k, j] = state[j]


def rollout(
    vehicle: Vehicle | Constants,
    x0: FloatArray,
    u: FloatArray,
    dt: float = TICK_NS * 1e-9,
    *,
    actuators: FloatArray | None = None,
    mu: float = 1.0,
    grade: float = 0.0,
) -> FloatArray:
    """
    Predict (v_x, v_y, yaw rate) for a batch of starts, each under its own commands.

    `x0` (n, 3); `u` (n, h, 2): commands (torque in N·m, delta in rad), entry k constant from k dt
    to (k + 1) dt; `actuators` (n, 2): torque and angle at the start, see `actuator_states`
    (default: `u[:, 0]`, steady state); `mu`: friction of the road; `grade`: rad, uphill positive.

    Returns (n, h, 3), entry k is the state at (k + 1) dt. A batch is bit-identical to its single
    rollouts. Finite for finite input: starts are clamped to 150 m/s and 30 rad/s, commands to the
    actuators' limits. A NaN affects only its own row.

    :raises ValueError: shapes that do not match, or `dt` out of range.
    """
    start = np.ascontiguousarray(x0, dtype=np.float64)
    commands = np.ascontiguousarray(u, dtype=np.float64)
    if start.ndim != 2 or start.shape[1] != 3:
        raise ValueError(f"x0 must have shape (n, 3), got {start.shape}")
    if commands.ndim != 3 or commands.shape[0] != start.shape[0] or commands.shape[2] != 2:
        raise ValueError(f"u must have shape ({start.shape[0]}, h, 2), got {commands.shape}")
    if not 0.0 < dt <= 1.0:
        raise ValueError(f"dt must be more than 0 and at most 1 s, got {dt}")
    horizon = commands.shape[1]
    out = np.empty((start.shape[0], horizon, 3))
    if out.size == 0:
        return out
    reached = commands[:, 0] if actuators is None else np.asarray(actuators, dtype=np.float64)
    if reached.shape != (start.shape[0], 2):
        raise ValueError(f"actuators must have shape ({start.shape[0]}, 2), got {reached.shape}")
    constants = vehicle.constants() if isinstance(vehicle, Vehicle) else vehicle
    reached = np.ascontiguousarray(reached)
    substeps = max(1, math.ceil(dt / MAX_STEP - 1e-9))
    road = np.array([mu, grade, 0.0])
    _rollouts(constants, start, reached, commands, road, dt / substeps, substeps, out)
    return out


def actuator_states(
    vehicle: Vehicle | Constants, u: FloatArray, dt: float = TICK_NS * 1e-9
) -> FloatArray:
    """
    Return torque and road-wheel angle at the start of each command, (n, 2).

    `u` (n, 2): successive commands, each constant for `dt`; the first row is in steady state.
    """
    c = vehicle.constants() if isinstance(vehicle, Vehicle) else vehicle
    commands = np.asarray(u, dtype=np.float64)
    limited = np.column_stack(
        [
            np.clip(commands[:, 0], -c.max_brake_torque, c.max_drive_torque),
            np.clip(commands[:, 1], -c.max_steer, c.max_steer),
        ]
    )
    keep = np.exp(-dt / np.maximum([c.torque_lag, c.steer_lag], STEP))
    out = np.empty_like(limited)
    out[:1] = limited[:1]
    for k in range(1, out.shape[0]):
        out[k] = limited[k - 1] + keep * (out[k - 1] - limited[k - 1])
    return out
