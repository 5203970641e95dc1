# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Feature library: candidate functions of the signals that a residual may depend on.

Features describe a residual that no effect of the catalogue explains, and correct the model for
it. A feature is a function of signals (n,) in SI units: v_x, v_y, yaw_rate, a_x, a_y (simulated),
torque, delta (commanded).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

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


def feature_matrix(names: list[str], signals: Signals) -> FloatArray:
    """Return the named features (n, k) of a recording's signals."""
    if not names:
        return np.empty((signals["v_x"].shape[0], 0))
    return np.column_stack([FEATURES[name].function(signals) for name in names])
