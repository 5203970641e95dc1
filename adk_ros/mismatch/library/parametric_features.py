# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Features with parameters of their own: memory, thresholds, and oscillation in time.

Each has a name that holds its parameters, so that a file can name it:

- `lag:SIGNAL:TAU`, a first-order lag, y' = (s - y) / tau;
- `resonance:SIGNAL:FREQUENCY:DAMPING`, the force of a mass on a spring and a damper per unit of
  mass, w^2 x + 2 z w x' with x'' + 2 z w x' + w^2 x = s and w = 2 pi FREQUENCY;
- `gate:FEATURE:CONDITION>THRESHOLD` (or `<`), a feature where a condition holds, zero elsewhere;
- `wave:FREQUENCY:PHASE` and `wave:FREQUENCY:PHASE:CONDITION>THRESHOLD`, cos(2 pi FREQUENCY t +
  PHASE) with t from the start of the recording: it cannot be transferred to another recording.

Signals and features are those of `library.features`, which also needs `time`, s, on an even grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.filters import low_pass, resonance

Signals = Mapping[str, FloatArray]
Static = Callable[[Signals], FloatArray]

LAG, RESONANCE, GATE, WAVE = "lag", "resonance", "gate", "wave"
KINDS = (LAG, RESONANCE, GATE, WAVE)
FILTERED_SIGNALS = {
    "a_x": ("longitudinal acceleration", "a_x", "m/s^2"),
    "a_y": ("lateral acceleration", "a_y", "m/s^2"),
    "yaw_rate": ("yaw rate", "r", "rad/s"),
    "torque": ("torque", "T", "N m"),
    "delta": ("steering angle", "delta", "rad"),
}
"""Signal -> words, symbol and unit, of those that may act with a memory."""
CONDITIONS = {
    "lateral_size": ("lateral acceleration", "|a_y|", "m/s²"),
    "speed": ("speed", "v_x", "m/s"),
    "delta_size": ("steering angle", "|delta|", "rad"),
    "torque": ("torque", "T", "N·m"),
}
"""Feature -> words, symbol and unit, of those that may switch another feature on."""
MAX_FREQUENCY_HZ, MIN_FREQUENCY_HZ = 10.0, 0.02
MAX_TAU_S = 100.0


def kind_of(name: str) -> str:
    """Return the kind of a parametric feature's name, or an empty text."""
    kind = name.split(":", 1)[0]
    return kind if kind in KINDS and ":" in name else ""


def searched_parameters(name: str) -> int:
    """Return how many parameters of a feature were searched, besides its coefficient."""
    return {LAG: 1, RESONANCE: 2, GATE: 1, WAVE: 2 + name.count(">") + name.count("<")}.get(
        kind_of(name), 0
    )


def has_memory(name: str) -> bool:
    """Whether a feature depends on earlier signals."""
    return kind_of(name) in {LAG, RESONANCE}


def is_transferable(name: str) -> bool:
    """Whether a feature has a meaning in another recording."""
    return kind_of(name) != WAVE


def number_text(value: float) -> str:
    """Return a parameter with the digits that a name keeps."""
    return f"{value:.4g}"


def lag_name(signal: str, tau: float) -> str:
    """Return the name of a first-order lag of a signal."""
    return f"{LAG}:{signal}:{number_text(tau)}"


def resonance_name(signal: str, frequency: float, damping: float) -> str:
    """Return the name of a resonance excited by a signal."""
    return f"{RESONANCE}:{signal}:{number_text(frequency)}:{number_text(damping)}"


def gate_name(feature: str, condition: str, above: bool, threshold: float) -> str:
    """Return the name of a feature that acts above or below a threshold."""
    return f"{GATE}:{feature}:{condition}{'>' if above else '<'}{number_text(threshold)}"


def wave_name(frequency: float, phase: float, gate: str = "") -> str:
    """Return the name of an oscillation in time; `gate` as in `CONDITION>THRESHOLD`."""
    # The phase is that at t = 0: the frequency needs more digits than others.
    text = f"{WAVE}:{frequency:.6g}:{number_text(phase)}"
    return f"{text}:{gate}" if gate else text


def split_condition(text: str) -> tuple[str, bool, float]:
    """
    Return (condition, above, threshold) of `CONDITION>THRESHOLD`.

    Raises `ValueError` for anything else.
    """
    for sign in (">", "<"):
        name, found, value = text.partition(sign)
        if found and name in CONDITIONS:
            return name, sign == ">", _number(value, -1e9, 1e9)
    raise ValueError(f"'{text}' is not a condition")


def parsed(name: str) -> tuple[str, list[str]]:
    """
    Return kind and checked arguments of a parametric feature.

    Raises `ValueError` with what is wrong.
    """
    kind, *arguments = name.split(":")
    if kind == LAG and len(arguments) == 2 and arguments[0] in FILTERED_SIGNALS:
        _number(arguments[1], 1e-3, MAX_TAU_S)
    elif kind == RESONANCE and len(arguments) == 3 and arguments[0] in FILTERED_SIGNALS:
        _number(arguments[1], MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ)
        _number(arguments[2], 0.0, 2.0)
    elif kind == GATE and len(arguments) == 2:
        split_condition(arguments[1])
    elif kind == WAVE and len(arguments) in {2, 3}:
        _number(arguments[0], MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ)
        _number(arguments[1], -10.0, 10.0)
        if len(arguments) == 3:
            split_condition(arguments[2])
    else:
        raise ValueError(f"feature '{name}' is unknown")
    return kind, arguments


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"'{text}' is not a number") from None
    if not low <= value <= high:
        raise ValueError(f"{text} is not within {low:g} to {high:g}")
    return value


def values_of(name: str, signals: Signals, static: Mapping[str, Static]) -> FloatArray:
    """Return a parametric feature along a recording (n,); `static`: the other features."""
    kind, arguments = parsed(name)
    if kind == GATE:
        return static[arguments[0]](signals) * _where(arguments[1], signals, static)
    time = signals["time"]
    if kind == WAVE:
        phase = 2.0 * math.pi * float(arguments[0]) * time + float(arguments[1])
        wave = np.cos(phase)
        if len(arguments) == 3:
            wave = wave * _where(arguments[2], signals, static)
        return np.asarray(wave)
    step = float(time[1] - time[0]) if time.shape[0] > 1 else 0.01
    signal = np.ascontiguousarray(signals[arguments[0]])
    if kind == LAG:
        return low_pass(signal, step, float(arguments[1]))
    return resonance(signal, step, 2.0 * math.pi * float(arguments[1]), float(arguments[2]))


def _where(text: str, signals: Signals, static: Mapping[str, Static]) -> FloatArray:
    name, above, threshold = split_condition(text)
    values = static[name](signals)
    return np.asarray((values > threshold) if above else (values < threshold), dtype=np.float64)
