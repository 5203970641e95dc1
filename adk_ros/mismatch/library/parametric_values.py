# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Values of features with parameters along a recording; `parametric_features` defines them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from adk_ros.mismatch.library.parametric_features import (
    DECAY,
    DRIFT,
    EXCESS,
    GATE,
    HEAT,
    HYSTERESIS,
    LAG,
    PULSATION,
    RIPPLE,
    SPEED_WAVE,
    TIME,
    WAVE,
    base_of,
    parsed,
    split_condition,
)
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.filters import low_pass, resonance, stop_operator

Signals = Mapping[str, FloatArray]
Static = Callable[[Signals], FloatArray]


def values_of(name: str, signals: Signals, static: Mapping[str, Static]) -> FloatArray:
    """Return a parametric feature along a recording (n,); `static`: the other features."""
    kind, arguments = parsed(name)
    of = base_of(name)
    base = static[of](signals) if of else np.ones_like(signals["v_x"])
    if kind == GATE:
        return base * _where(arguments[1], signals, static)
    if kind == EXCESS:
        return base - np.clip(base, -float(arguments[1]), float(arguments[1]))
    if kind in {WAVE, PULSATION}:
        phase = 2.0 * math.pi * float(arguments[0]) * signals["time"] + float(arguments[1])
        if kind == WAVE and len(arguments) == 3:
            base = _where(arguments[2], signals, static)
        return np.asarray(np.cos(phase) * base)
    if kind == SPEED_WAVE:
        phase = 2.0 * math.pi * signals["v_x"] / float(arguments[0]) + float(arguments[1])
        return np.asarray(base * np.cos(phase))
    step = step_of(signals)
    if kind == RIPPLE:
        turns = accumulated(signals["v_x"], step) / float(arguments[0])
        return np.asarray(base * np.cos(2.0 * math.pi * turns + float(arguments[1])))
    if kind == HEAT:
        return base * low_pass(braking_power(signals), step, float(arguments[1]))
    if kind in {DRIFT, DECAY}:
        left = np.exp(-drift_variable(arguments[1], signals) / float(arguments[2]))
        return base * (left if kind == DECAY else 1.0 - left)
    return _filtered(kind, np.ascontiguousarray(signals[arguments[0]]), step, arguments[1:])


def _filtered(kind: str, signal: FloatArray, step: float, arguments: Sequence[str]) -> FloatArray:
    """Return a lag, a hysteresis or a resonance of a signal (n,)."""
    first = float(arguments[0])
    if kind == LAG:
        return low_pass(signal, step, first)
    if kind == HYSTERESIS:
        return stop_operator(signal, first)
    return resonance(signal, step, 2.0 * math.pi * first, float(arguments[1]))


def step_of(signals: Signals) -> float:
    """Return the step of the signals' grid, s."""
    time = signals["time"]
    return float(time[1] - time[0]) if time.shape[0] > 1 else 0.01


def braking_power(signals: Signals) -> FloatArray:
    """Return max(-T v_x, 0) (n,), N m^2/s."""
    return np.maximum(-signals["torque"] * signals["v_x"], 0.0)


def accumulated(rate: FloatArray, step: float) -> FloatArray:
    """Return the integral (n,) of a rate from the start."""
    return np.cumsum(rate) * step


def drift_variable(name: str, signals: Signals) -> FloatArray:
    """Return the time, s, or the braking work, N m^2, since the start of the recording (n,)."""
    if name == TIME:
        return np.maximum(signals["time"], 0.0)
    return accumulated(braking_power(signals), step_of(signals))


def condition_values(name: str, signals: Signals, static: Mapping[str, Static]) -> FloatArray:
    """Return what a condition compares with its threshold (n,)."""
    if name == TIME:
        return signals["time"]
    return -signals["a_x"] if name == "deceleration" else static[name](signals)


def _where(text: str, signals: Signals, static: Mapping[str, Static]) -> FloatArray:
    name, above, threshold = split_condition(text)
    values = condition_values(name, signals, static)
    return np.asarray((values > threshold) if above else (values < threshold), dtype=np.float64)
