# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Single-track (bicycle) models with the parameters of the nominal car, as controllers use them.

    T' = (T_c - T) / tau_T,  delta' = (delta_c - delta) / tau_delta        actuators, nominal lags
    m_e (v_x' - v_y r) = T / R - F_yf sin(delta) - drag - rolling          m_e = m + 4 I_w / R²
    dynamic:    m (v_y' + v_x r) = F_yf cos(delta) + F_yr,  I_z r' = l_f F_yf cos(delta) - l_r F_yr
    kinematic:  r = v_x tan(delta) / (l_f + l_r),  v_y = l_r r,  F_y = 0

Axle forces F_y: Magic Formula of the nominal tyres at static loads, on the nominal road, without
combined slip. References: R. Rajamani, "Vehicle Dynamics and Control", 2nd ed., 2.2 and 2.3.
"""

from __future__ import annotations

import math

import numpy as np

from adk_ros.bench.control.cars import NOMINAL, make_car
from adk_ros.bench.control.prediction_models import Linearization, difference_quotients
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import AIR_DENSITY, GRAVITY
from adk_ros.numerics.numba_cache import strict_kernel
from adk_ros.plant.vehicle.tyre import axle_tyre, friction, magic_formula
from adk_ros.plant.vehicle.vehicle_parameters import Constants
from adk_ros.signals.channels import TICK_NS, Sample

_TICK_S = TICK_NS * 1e-9
_SUBSTEPS = 2
"""Midpoint steps of 12.5 ms: the fastest modes are the actuators' with 33 1/s."""


class BicycleModel:
    """A single-track model of the nominal car, dynamic or kinematic."""

    def __init__(self, *, dynamic: bool) -> None:
        car = make_car(NOMINAL)
        self._dynamic = dynamic
        self._constants, self._mu = car.vehicle.constants(), car.mu
        self._lags = np.array([self._constants.torque_lag, self._constants.steer_lag])
        self._velocity = np.zeros(3)
        self._actuators = np.zeros(2)
        self._command: FloatArray | None = None

    def update(self, sample: Sample) -> None:
        """Take measured velocities; the actuators have followed the last command for 25 ms."""
        self._velocity = np.array(sample.x)
        if self._command is None:
            self._actuators = np.array(sample.u)
        else:
            follow = 1.0 - np.exp(-_TICK_S / self._lags)
            self._actuators += follow * (self._command - self._actuators)
        self._command = np.array(sample.u)

    def roll_out_many(self, commands: FloatArray) -> FloatArray:
        """As `PredictionModel.roll_out_many`."""
        start = np.concatenate([self._velocity, self._actuators])
        out = np.empty((*commands.shape[:2], 3))
        _roll_out(self._dynamic, self._constants, self._mu, start, commands, out)
        return out

    def linearized(self, commands: FloatArray) -> Linearization:
        """As `PredictionModel.linearized`, by differences."""
        return difference_quotients(self, commands)


@strict_kernel
def _axle_force(c: Constants, mu: float, front: bool, tan_alpha: float) -> float:
    """Return the lateral force of both tyres of an axle, N."""
    tyre = axle_tyre(c, front)
    other = c.cg_to_rear_axle if front else c.cg_to_front_axle
    load = 0.5 * c.mass * GRAVITY * other / (c.cg_to_front_axle + c.cg_to_rear_axle)
    slip = tyre.b_y / mu * tan_alpha
    force = 2.0 * mu * load * friction(tyre, load)
    return math.copysign(force * magic_formula(abs(slip), tyre.c_y, tyre.e_y), slip)


@strict_kernel
def _rates(
    dynamic: bool, c: Constants, mu: float, state: FloatArray, command: FloatArray, out: FloatArray
) -> None:
    """Write d/dt of (v_x, v_y, yaw rate, torque, delta)."""
    v_x, v_y, rate, torque, delta = state[0], state[1], state[2], state[3], state[4]
    front = rear = 0.0
    if dynamic:
        rolling = max(v_x, 2.0)
        slip_f = math.tan(delta - math.atan2(v_y + c.cg_to_front_axle * rate, rolling))
        slip_r = -(v_y - c.cg_to_rear_axle * rate) / rolling
        front = _axle_force(c, mu, True, slip_f)
        rear = _axle_force(c, mu, False, slip_r)
    force = torque / c.wheel_radius - front * math.sin(delta)
    force -= 0.5 * AIR_DENSITY * c.cda * v_x * abs(v_x) + c.crr * c.mass * GRAVITY
    out[0] = force / (c.mass + 4.0 * c.wheel_inertia / c.wheel_radius**2) + v_y * rate
    side = front * math.cos(delta)
    out[1] = (side + rear) / c.mass - v_x * rate
    out[2] = (c.cg_to_front_axle * side - c.cg_to_rear_axle * rear) / c.yaw_inertia
    out[3] = (command[0] - torque) / c.torque_lag
    out[4] = (command[1] - delta) / c.steer_lag


@strict_kernel
def _roll_out(
    dynamic: bool, c: Constants, mu: float, start: FloatArray, commands: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write velocities (k, h, 3) under `commands` (k, h, 2) from velocities and actuators (5,)."""
    step = _TICK_S / _SUBSTEPS
    rate, middle = np.empty(5), np.empty(5)
    wheelbase = c.cg_to_front_axle + c.cg_to_rear_axle
    for k in range(commands.shape[0]):
        state = start.copy()
        for j in range(commands.shape[1]):
            for _ in range(_SUBSTEPS):
                _rates(dynamic, c, mu, state, commands[k, j], rate)
                for i in range(5):
                    middle[i] = state[i] + 0.5 * step * rate[i]
                _rates(dynamic, c, mu, middle, commands[k, j], rate)
                for i in range(5):
                    state[i] += step * rate[i]
                if not dynamic:
                    state[2] = state[0] * math.tan(state[4]) / wheelbase
                    state[1] = c.cg_to_rear_axle * state[2]
            for i in range(3):
                out[k, j, i] = state[i]
