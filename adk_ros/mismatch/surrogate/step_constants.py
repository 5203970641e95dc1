# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a step of the surrogate needs of its parameters, computed only when they change.

First-order lags use their exact solution over a step with constant input. Second-order lags use
the implicit Euler rule, which is stable at any frequency.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.constants import GRAVITY
from adk_ros.numerics.numba_cache import inlined_kernel, relaxed_kernel

_STEER_LAG = INDEX["steer_lag"]
_STEER_LAG_2 = INDEX["steer_lag_more"]
_TORQUE_LAG = INDEX["torque_lag"]
_TORQUE_LAG_2 = INDEX["torque_lag_more"]
_LOAD_LAG = INDEX["load_lag"]
_ROLL_FREQUENCY = INDEX["roll_frequency"]
_ROLL_DAMPING = INDEX["roll_damping"]
_PITCH_FREQUENCY = INDEX["pitch_frequency"]
_PITCH_DAMPING = INDEX["pitch_damping"]
_GRADE = INDEX["grade"]
_BANK = INDEX["bank"]


class Lag(NamedTuple):
    """A first-order lag over one step: the shares of the distance to its input that remain."""

    mean: float
    """On average over the step."""
    final: float
    """At the end of the step."""


class Resonance(NamedTuple):
    """A second-order lag over one step: rate' = keep rate + gain (input - value)."""

    keep: float
    gain: float
    """1/s."""


class StepConstants(NamedTuple):
    """Constants of a step, from the parameters of the surrogate."""

    steering: Lag
    steering_2: Lag
    torque: Lag
    torque_2: Lag
    load: Lag
    roll: Resonance
    pitch: Resonance
    sin_grade: float
    sin_bank: float
    normal: float
    """Gravity normal to the road, m/s²."""


@inlined_kernel
def lag_of(time: float, step: float) -> Lag:
    """Return a first-order lag of the given time constant, both in s; 0: it follows at once."""
    if time < 1e-6 * step:
        return Lag(0.0, 0.0)
    x = step / time
    final = math.exp(-x)
    return Lag((1.0 - final) / x, final)


@relaxed_kernel
def resonance_of(frequency: float, damping: float, step: float) -> Resonance:
    """Return a second-order lag of a natural frequency, rad/s, and a damping ratio."""
    x = frequency * step
    keep = 1.0 / (1.0 + 2.0 * damping * x + x * x)
    return Resonance(keep, keep * x * frequency)


@inlined_kernel
def first_order_lag(state: float, to: float, lag: Lag) -> tuple[float, float]:
    """Return a first-order lag's (mean, final value) of a step towards the constant input `to`."""
    return to + (state - to) * lag.mean, to + (state - to) * lag.final


@inlined_kernel
def second_order_lag(
    state: float, rate: float, to: float, resonance: Resonance, step: float
) -> tuple[float, float]:
    """Return a second-order lag's (value, rate) after a step towards the constant input `to`."""
    rate = resonance.keep * rate + resonance.gain * (to - state)
    return state + step * rate, rate


@relaxed_kernel
def step_constants(p: FloatArray, step: float) -> StepConstants:
    """Return the constants of a step of `step` s for the parameters `p` (SIZE,)."""
    return StepConstants(
        lag_of(p[_STEER_LAG], step),
        lag_of(p[_STEER_LAG_2], step),
        lag_of(p[_TORQUE_LAG], step),
        lag_of(p[_TORQUE_LAG_2], step),
        lag_of(p[_LOAD_LAG], step),
        resonance_of(p[_ROLL_FREQUENCY], p[_ROLL_DAMPING], step),
        resonance_of(p[_PITCH_FREQUENCY], p[_PITCH_DAMPING], step),
        math.sin(p[_GRADE]),
        math.sin(p[_BANK]),
        GRAVITY * math.cos(p[_GRADE]) * math.cos(p[_BANK]),
    )
