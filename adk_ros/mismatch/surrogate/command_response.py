# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Command response: dead times, lags, backlash and limits of steering and drive.

Dead times average the held command over a step; they and the lags are smooth in their parameters,
and may be zero.

A wheel must spin up before its tyre transmits a torque. For small slip, with the longitudinal
slip stiffness K F_z of the tyres, the force lags the torque by I_w v_x / (R^2 K F_z). The lag of
the torque, identified from the simulation, contains it, so that only additional inertia counts. K
of a passenger-car tyre is 21.5: p_Kx1 in appendix 3 of H. B. Pacejka, Tire and Vehicle Dynamics,
3rd ed. (2012). A simulation says nothing about K, and in a simple one wheels do not slip: 1 / K is
fitted with a wide prior (`identification`).
"""

from __future__ import annotations

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.surrogate.command_integrals import CommandIntegrals
from adk_ros.mismatch.surrogate.state_index import (
    S_LOAD_Y,
    S_PLAY,
    S_STEER,
    S_STEER_MORE,
    S_TORQUE,
    S_TORQUE_MORE,
)
from adk_ros.mismatch.surrogate.step_constants import StepConstants, first_order_lag, lag_of
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import inlined_kernel

_MIN_POWER_SPEED = 1.0
"""Speed from which the power limit acts, m/s: below it P / v_x is unbounded."""

_MASS = INDEX["mass"]
_RADIUS = INDEX["wheel_radius"]
_SPIN_UP_INERTIA = INDEX["spin_up_inertia"]
_SLIP_COMPLIANCE = INDEX["slip_compliance"]
_STEER_GAIN = INDEX["steer_gain"]
_STEER_OFFSET = INDEX["steer_offset"]
_STEER_DELAY = INDEX["steer_delay"]
_EXTRA_STEER = INDEX["extra_steer"]
_BACKLASH = INDEX["steer_half_gap"]
_COMPLIANCE = INDEX["steer_compliance"]
_TORQUE_GAIN = INDEX["torque_gain"]
_BRAKE_GAIN = INDEX["brake_gain"]
_TORQUE_OFFSET = INDEX["torque_offset"]
_TORQUE_DELAY = INDEX["torque_delay"]
_TORQUE_LAG_2 = INDEX["torque_lag_more"]
_INVERSE_POWER = INDEX["power_inverse"]
_COMMAND_DELAY = INDEX["command_delay"]


@inlined_kernel
def zoh_mean(integral: FloatArray, spacing: float, begin: float, step: float) -> float:
    """Return the mean over `step` seconds from `begin` of a held signal, given its integral."""
    last = integral.shape[0] - 1
    at = min(max(begin / spacing, 0.0), last - 1e-6)
    i = int(at)
    first = integral[i] + (at - i) * (integral[i + 1] - integral[i])
    at = min(max((begin + step) / spacing, 0.0), last - 1e-6)
    i = int(at)
    second = integral[i] + (at - i) * (integral[i + 1] - integral[i])
    end = last * spacing
    span = min(max(begin + step, 0.0), end) - min(max(begin, 0.0), end)
    mean: float = (second - first) / max(span, 1e-9)
    if span < 0.5 * step:
        # Outside the commands' time range: the first or the last command holds.
        mean = (integral[1] - integral[0]) / spacing
        if begin > step:
            mean = (integral[last] - integral[last - 1]) / spacing
    return mean


@inlined_kernel
def spin_up_lag(p: FloatArray, v_x: float) -> float:
    """Return the additional lag of the longitudinal force behind the wheel torque, s."""
    per_load = max(p[_SPIN_UP_INERTIA], 0.0) * max(v_x, 0.0) / (p[_RADIUS] ** 2)
    lag: float = per_load * p[_SLIP_COMPLIANCE] / (p[_MASS] * GRAVITY)
    return lag


@inlined_kernel
def actuate(
    p: FloatArray,
    constants: StepConstants,
    state: FloatArray,
    commands: CommandIntegrals,
    time: float,
    step: float,
    v_x: float,
) -> tuple[float, float]:
    """
    Return the torque (N·m) and road-wheel angle (rad) of the step from `time`; advance the lags.

    `time` counts from the first value of the command integrals.
    """
    begin = time - p[_COMMAND_DELAY]
    requested = zoh_mean(commands.angle, commands.spacing, begin - p[_STEER_DELAY], step)
    requested = p[_STEER_GAIN] * requested
    gap = p[_BACKLASH]
    play = min(max(state[S_PLAY], requested - gap), requested + gap)
    state[S_PLAY] = play
    mean, state[S_STEER] = first_order_lag(state[S_STEER], play, constants.steering)
    delta, state[S_STEER_MORE] = first_order_lag(state[S_STEER_MORE], mean, constants.steering_2)
    delta += p[_STEER_OFFSET] + p[_EXTRA_STEER] - p[_COMPLIANCE] * state[S_LOAD_Y]
    demand = zoh_mean(commands.torque, commands.spacing, begin - p[_TORQUE_DELAY], step)
    demand *= p[_TORQUE_GAIN] * (p[_BRAKE_GAIN] if demand < 0.0 else 1.0)
    mean, state[S_TORQUE] = first_order_lag(state[S_TORQUE], demand, constants.torque)
    lag = constants.torque_2
    if p[_SPIN_UP_INERTIA] > 0.0:
        # Two short lags in series are one of their sum.
        lag = lag_of(p[_TORQUE_LAG_2] + spin_up_lag(p, v_x), step)
    torque, state[S_TORQUE_MORE] = first_order_lag(state[S_TORQUE_MORE], mean, lag)
    torque += p[_TORQUE_OFFSET]
    if p[_INVERSE_POWER] > 0.0:
        torque = min(torque, p[_RADIUS] / (p[_INVERSE_POWER] * max(v_x, _MIN_POWER_SPEED)))
    return torque, delta
