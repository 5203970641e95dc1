# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Feature library: candidate functions of the signals that a residual may depend on.

Features describe a residual that no effect of the catalogue explains, and correct the model for
it. A feature is a function of signals (n,) in SI units: v_x, v_y, yaw_rate, a_x, a_y (simulated),
torque, delta (commanded). `FEATURES` depend on the signals of the same moment; `feature` also
knows those with parameters: a memory, a threshold, wear or an oscillation (see
`parametric_features`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.library import parametric_features as parametric
from adk_ros.mismatch.library.parametric_values import values_of
from adk_ros.numerics.arrays import FloatArray

Signals = Mapping[str, FloatArray]


class Feature(NamedTuple):
    """Description in words, expression, unit and function of a feature."""

    description: str
    expression: str
    unit: str
    function: Callable[[Signals], FloatArray]


FEATURES: dict[str, Feature] = {
    "constant": Feature("a constant", "1", "1", lambda s: np.ones_like(s["v_x"])),
    "speed": Feature("speed", "v_x", "m/s", lambda s: s["v_x"]),
    "speed_squared": Feature("speed squared", "v_x^2", "m^2/s^2", lambda s: s["v_x"] ** 2),
    "speed_cubed": Feature("speed cubed", "v_x^3", "m^3/s^3", lambda s: s["v_x"] ** 3),
    "lateral_speed": Feature("lateral velocity", "v_y", "m/s", lambda s: s["v_y"]),
    "yaw_rate": Feature(
        "yaw rate (wheel-speed difference)", "r", "rad/s", lambda s: s["yaw_rate"]
    ),
    "yaw_rate_cubed": Feature("yaw rate cubed", "r^3", "rad^3/s^3", lambda s: s["yaw_rate"] ** 3),
    "yaw_rate_size": Feature("yaw rate's size", "|r|", "rad/s", lambda s: np.abs(s["yaw_rate"])),
    "yaw_rate_per_speed": Feature(
        "relative wheel-speed difference (path curvature)",
        "r / v_x",
        "1/m",
        lambda s: s["yaw_rate"] / np.maximum(s["v_x"], 1.0),
    ),
    "yaw_rate_speed": Feature(
        "lateral acceleration", "r v_x", "m/s^2", lambda s: s["yaw_rate"] * s["v_x"]
    ),
    "yaw_rate_speed_squared": Feature(
        "yaw rate times speed squared",
        "r v_x^2",
        "m^2/s^3",
        lambda s: s["yaw_rate"] * s["v_x"] ** 2,
    ),
    "lateral_squared": Feature(
        "lateral acceleration squared", "a_y^2", "m^2/s^4", lambda s: s["a_y"] ** 2
    ),
    "lateral_cubed": Feature(
        "lateral acceleration cubed", "a_y^3", "m^3/s^6", lambda s: s["a_y"] ** 3
    ),
    "lateral_size": Feature(
        "lateral acceleration's size", "|a_y|", "m/s^2", lambda s: np.abs(s["a_y"])
    ),
    "torque": Feature("torque", "T", "N m", lambda s: s["torque"]),
    "drive_torque": Feature(
        "drive torque", "max(T, 0)", "N m", lambda s: np.maximum(s["torque"], 0.0)
    ),
    "brake_torque": Feature(
        "brake torque", "min(T, 0)", "N m", lambda s: np.minimum(s["torque"], 0.0)
    ),
    "torque_size": Feature("torque's size", "|T|", "N m", lambda s: np.abs(s["torque"])),
    "torque_squared": Feature(
        "torque squared", "T |T|", "N^2 m^2", lambda s: s["torque"] * np.abs(s["torque"])
    ),
    "torque_speed": Feature("power", "T v_x", "N m^2/s", lambda s: s["torque"] * s["v_x"]),
    "torque_yaw_rate": Feature(
        "torque times yaw rate", "T r", "N m rad/s", lambda s: s["torque"] * s["yaw_rate"]
    ),
    "torque_delta": Feature(
        "torque times steering angle", "T delta", "N m rad", lambda s: s["torque"] * s["delta"]
    ),
    "torque_lateral": Feature(
        "torque times lateral acceleration",
        "T a_y",
        "N m^2/s^2",
        lambda s: s["torque"] * s["a_y"],
    ),
    "torque_size_curvature": Feature(
        "torque's size times path curvature (differential that locks)",
        "|T| r / v_x",
        "N",
        lambda s: np.abs(s["torque"]) * s["yaw_rate"] / np.maximum(s["v_x"], 1.0),
    ),
    "delta": Feature("steering angle", "delta", "rad", lambda s: s["delta"]),
    "delta_size": Feature("steering angle's size", "|delta|", "rad", lambda s: np.abs(s["delta"])),
    "delta_cubed": Feature("steering angle cubed", "delta^3", "rad^3", lambda s: s["delta"] ** 3),
    "delta_speed": Feature(
        "steering angle times speed", "delta v_x", "rad m/s", lambda s: s["delta"] * s["v_x"]
    ),
    "delta_speed_squared": Feature(
        "steering angle times speed squared",
        "delta v_x^2",
        "rad m^2/s^2",
        lambda s: s["delta"] * s["v_x"] ** 2,
    ),
    "lateral_speed_speed": Feature(
        "sideslip force", "v_y v_x", "m^2/s^2", lambda s: s["v_y"] * s["v_x"]
    ),
    "lateral_speed_per_speed": Feature(
        "sideslip angle", "v_y / v_x", "rad", lambda s: s["v_y"] / np.maximum(s["v_x"], 1.0)
    ),
    "sine_of_speed": Feature(
        "an oscillation with speed", "sin(v_x)", "1", lambda s: np.sin(s["v_x"])
    ),
}


_OSCILLATIONS = {
    parametric.RIPPLE: ("every {:.4g} m travelled", "s / {:.5g} m"),
    parametric.PULSATION: ("in time at {:.3g} Hz", "{:.4g} t"),
    parametric.SPEED_WAVE: ("with speed every {:.3g} m/s", "v_x / {:.4g} m/s"),
}
"""Kind of an oscillation -> words and phase in turns, of its period or frequency."""


def feature(name: str) -> Feature:
    """
    Return a feature by its name.

    Raises `ValueError` for an unknown name.
    """
    if name in FEATURES:
        return FEATURES[name]
    kind, arguments = parametric.parsed(name)
    base = parametric.base_of(name)
    if base and base not in FEATURES:
        raise ValueError(f"feature '{base}' is unknown")
    description, expression, unit = _texts(kind, arguments, base)
    functions = {key: entry.function for key, entry in FEATURES.items()}
    return Feature(description, expression, unit, lambda s: values_of(name, s, functions))


def _texts(kind: str, arguments: list[str], base_name: str) -> tuple[str, str, str]:
    """Return description, expression and unit of a parametric feature."""
    if base_name:
        base = FEATURES[base_name]
        words, symbols, unit = _change(kind, arguments, base)
        if kind in _OSCILLATIONS and base_name == "constant":
            return f"an oscillation{words.removeprefix('that oscillates')}", symbols, unit
        return f"{base.description} {words}", f"{base.expression} {symbols}", unit
    if kind == parametric.WAVE:
        frequency = float(arguments[0])
        words, symbol = _condition(arguments[2]) if len(arguments) == 3 else ("", "")
        gate = f" [{symbol}]" if symbol else ""
        return (
            f"an oscillation in time at {frequency:.3g} Hz {words}".rstrip(),
            f"cos(2 pi {frequency:.4g} t {float(arguments[1]):+.2f}){gate}",
            "1",
        )
    words, symbol, unit = parametric.FILTERED_SIGNALS[arguments[0]]
    first = float(arguments[1])
    if kind == parametric.LAG:
        return f"{words} with a lag of {first:.2g} s", f"lag({symbol}, {first:.3g} s)", unit
    if kind == parametric.HYSTERESIS:
        return (
            f"{words} with a hysteresis of ±{first:.2g} {readable(unit)}",
            f"hysteresis({symbol}, {first:.3g} {unit})",
            unit,
        )
    damping = float(arguments[2])
    moved = "a mass on a spring moved by" if arguments[0] in {"a_x", "a_y"} else "a spring bent by"
    return (
        f"{moved} {words} ({first:.2g} Hz, damping ratio {damping:.2g})",
        f"resonance({symbol}, {first:.3g} Hz, {damping:.2g})",
        unit,
    )


def _change(kind: str, arguments: list[str], base: Feature) -> tuple[str, str, str]:
    """Return words, symbols and unit of what a kind makes of the feature `base`."""
    if kind == parametric.GATE:
        words, symbol = _condition(arguments[1])
        return words, f"[{symbol}]", base.unit
    if kind == parametric.EXCESS:
        limit = f"{float(arguments[1]):.4g}"
        return f"beyond {limit} {readable(base.unit)}", f"[beyond {limit} {base.unit}]", base.unit
    if kind in _OSCILLATIONS:
        words, phase = _OSCILLATIONS[kind]
        period = float(arguments[0])
        symbols = f"cos(2 pi {phase.format(period)} {float(arguments[1]):+.2f})"
        return f"that oscillates {words.format(period)}", symbols, base.unit
    if kind == parametric.HEAT:
        tau = f"{float(arguments[1]):.3g} s"
        return (
            f"that changes with the braking power of the last {tau}",
            f"lag(max(-T v_x, 0), {tau})",
            f"{base.unit} N m^2/s",
        )
    scale = f"{float(arguments[2]):.3g}"
    in_time = arguments[1] == parametric.TIME
    words = f"with the time over {scale} s" if in_time else "with the braking work"
    left = f"exp(-t / {scale} s)" if in_time else f"exp(-W / {scale} N m^2)"
    fades = kind == parametric.DECAY
    share = left if fades else f"(1 - {left})"
    return f"that {'fades' if fades else 'changes'} {words}", share, base.unit


def readable(unit: str) -> str:
    """Return a unit of a feature as people write it."""
    return unit.replace("^2", "²").replace("^3", "³").replace("N m", "N·m")


def _condition(text: str) -> tuple[str, str]:
    """Return a condition in words and as an expression."""
    name, above, threshold = parametric.split_condition(text)
    words, symbol, unit = parametric.CONDITIONS[name]
    side = "above" if above else "below"
    expression = f"{symbol} {'>' if above else '<'} {threshold:.3g} {unit}"
    if name == "torque" and threshold == 0.0:
        return ("while driving" if above else "while braking"), f"T {'>' if above else '<'} 0"
    if name == parametric.TIME:
        return f"{'from' if above else 'until'} {threshold:.3g} s", expression
    return f"where the {words} is {side} {threshold:.3g} {unit}", expression


def feature_matrix(names: list[str], signals: Signals) -> FloatArray:
    """Return the named features (n, k) of a recording's signals."""
    if not names:
        return np.empty((signals["v_x"].shape[0], 0))
    return np.column_stack([feature(name).function(signals) for name in names])
