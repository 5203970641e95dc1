# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Oracle predictor: the plant itself, restarted from measured (v_x, v_y, yaw rate).

It knows everything else exactly: the remaining state, the road, the wind, the commands and their
timing. Its error is due to the measurement error of the start alone.
"""

from __future__ import annotations

import numpy as np

from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.environment.road import locate
from adk_ros.plant.environment.wind import wind_at
from adk_ros.plant.scenario.route_step import step_on_route
from adk_ros.plant.scenario.sensor_simulation import SimulatedDrive
from adk_ros.plant.vehicle.fourteen_dof import STATE_LIMIT as FOURTEEN_LIMIT
from adk_ros.plant.vehicle.seven_dof import DELTA, OMEGA, STEP, V_X, V_Y, YAW_RATE, X, Y
from adk_ros.plant.vehicle.seven_dof import STATE_LIMIT as SEVEN_LIMIT
from adk_ros.plant.vehicle.sprung_mass import NO_SPRUNG_MASS, SprungMass, resolve
from adk_ros.plant.vehicle.vehicle_parameters import Constants
from adk_ros.signals.channels import TICK_NS

_TICK = round(TICK_NS * 1e-9 / STEP)


def _along(c: Constants, i: int, v: FloatArray, delta: FloatArray) -> FloatArray:
    """Return the speed (n,) of the hub of wheel `i` in its rolling direction, body plane."""
    x = c.cg_to_front_axle if i < 2 else -c.cg_to_rear_axle
    y = 0.5 * c.track_width if i % 2 == 0 else -0.5 * c.track_width
    angle = delta if i < 2 else np.zeros_like(delta)
    hub_x, hub_y = v[:, 0] - v[:, 2] * y, v[:, 1] + v[:, 2] * x
    return np.asarray(hub_x * np.cos(angle) + hub_y * np.sin(angle))


def _restarted(drive: SimulatedDrive, c: Constants, rows: IntArray, x0: FloatArray) -> FloatArray:
    """Return the states at `rows` with the measured velocities and unchanged wheel slips."""
    states = drive.states[rows]
    measured = np.where(np.isfinite(x0), x0, drive.x[rows])
    for i in range(4):
        before = _along(c, i, states[:, [V_X, V_Y, YAW_RATE]], states[:, DELTA])
        after = _along(c, i, measured, states[:, DELTA])
        slip = states[:, OMEGA + i] * c.wheel_radius - before
        slip /= np.maximum(np.abs(before), c.slip_speed_min)
        spin = (after + slip * np.maximum(np.abs(after), c.slip_speed_min)) / c.wheel_radius
        # With an unchanged velocity the spin stays bit-identical.
        states[:, OMEGA + i] = np.where(after == before, states[:, OMEGA + i], spin)
    states[:, [V_X, V_Y, YAW_RATE]] = measured
    limit = SEVEN_LIMIT if drive.plant == "seven_dof" else FOURTEEN_LIMIT
    return np.asarray(np.clip(states, -limit, limit))


@strict_kernel
def _continue_drive(
    fourteen: bool,
    c: Constants,
    b: SprungMass,
    table: FloatArray,
    spacing: float,
    wind: FloatArray,
    commands: FloatArray,
    command_step: IntArray,
    rows: IntArray,
    place: FloatArray,
    states: FloatArray,
    out: FloatArray,
) -> None:
    road = np.empty((4, 5))
    work = np.empty((5, states.shape[1]))
    last = commands.shape[0] - 1
    for n in range(rows.shape[0]):
        state = states[n]
        s = place[n]
        step = rows[n] * _TICK
        k = max(np.searchsorted(command_step, step, side="right") - 1, 0)
        for j in range(out.shape[1]):
            for _ in range(_TICK):
                s = locate(table, spacing, s, state[X], state[Y])[0]
                while k < last and command_step[k + 1] <= step:
                    k += 1
                step_on_route(
                    fourteen,
                    c,
                    b,
                    table,
                    spacing,
                    s,
                    wind_at(wind, step, _TICK),
                    state,
                    commands[k],
                    road,
                    work,
                )
                step += 1
            out[n, j, 0] = state[V_X]
            out[n, j, 1] = state[V_Y]
            out[n, j, 2] = state[YAW_RATE]


def oracle_rollout(
    drive: SimulatedDrive, rows: IntArray, x0: FloatArray, ahead: int
) -> FloatArray:
    """
    Continue the simulation from grid rows of `drive` with measured velocities; both plants.

    `rows` (n,): rows of the 25 ms grid; `x0` (n, 3): measured (v_x, v_y, yaw rate), used instead
    of the true ones. Wheel spins change such that the slips stay; all other states are true.
    Commands are the recorded ones with their timing; after the end of the drive the last holds.

    Returns (n, ahead, 3), entry j is the state j + 1 ticks later. With the truth as `x0` this is
    the drive itself. A start with NaN gives NaN. Takes about 0.1 ms per start and tick.

    :raises ValueError: rows outside of the drive, or shapes that do not match.
    """
    rows = np.ascontiguousarray(rows, dtype=np.int64)
    start = np.ascontiguousarray(x0, dtype=np.float64)
    if rows.ndim != 1 or start.shape != (rows.shape[0], 3):
        raise ValueError(f"x0 must have shape (n, 3) for rows (n,), got {start.shape}")
    if ahead < 0:
        raise ValueError(f"ahead must not be negative, got {ahead}")
    if rows.size and not 0 <= rows.min() <= rows.max() < len(drive.x):
        raise ValueError(f"rows must be in the grid of the drive, 0 to {len(drive.x) - 1}")
    out = np.empty((rows.shape[0], ahead, 3))
    if out.size == 0:
        return out
    constants = drive.vehicle.constants()
    fourteen = drive.plant == "fourteen_dof"
    body = resolve(drive.vehicle) if fourteen else NO_SPRUNG_MASS
    _continue_drive(
        fourteen, constants, body, drive.route.table, drive.route.spacing, drive.wind,
        drive.commands, drive.command_step, rows, drive.arc_length[rows],
        _restarted(drive, constants, rows, start), out,
    )  # fmt: skip
    out[~np.isfinite(start).all(axis=1)] = np.nan
    return out
