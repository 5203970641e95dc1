# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Grid of features with searched parameters: those that are screened, and their neighbours.

Grids are coarse: a parameter between two members loses little of the gain, and the best members
are refined. Thresholds and widths follow the values that occur in the recording.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adk_ros.mismatch.library.features import FEATURES, Signals
from adk_ros.mismatch.library.parametric_features import (
    BRAKE_WORK,
    DECAY,
    DRIFT,
    FILTERED_SIGNALS,
    GATE,
    LAG,
    RESONANCE,
    TIME,
    decay_name,
    drift_name,
    excess_name,
    gate_name,
    heat_name,
    hysteresis_name,
    lag_name,
    parsed,
    resonance_name,
    scaled,
    split_condition,
)
from adk_ros.mismatch.library.parametric_values import condition_values, drift_variable
from adk_ros.numerics.arrays import FloatArray

FREQUENCIES_HZ = tuple(float(x) for x in np.geomspace(0.15, 3.0, 18))
DAMPING_RATIOS = (0.04, 0.15)
"""Resonances that are tried; more damped ones resemble a lag."""
TIME_CONSTANTS_S = (0.15, 0.4, 1.0, 2.5, 6.0, 15.0)
QUANTILES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.85, 0.93)
"""Thresholds that are tried, as quantiles of the condition's values."""
WIDTHS = (0.05, 0.15, 0.4, 1.0)
"""Half widths of a hysteresis that are tried, over the standard deviation of the signal."""
SCALES = (0.15, 0.5, 2.0)
"""Scales of a drift that are tried, over its variable's last value; 2 is nearly linear."""
COOLING_S = (10.0, 30.0, 100.0)
"""Time constants of heat that are tried."""
_FINE_QUANTILES = np.linspace(0.05, 0.97, 47)
GATED = (
    "constant",
    "drive_torque",
    "brake_torque",
    "yaw_rate_speed",
    "delta",
    "speed_squared",
)
"""Features that a threshold may switch, or that may change with time."""
EXCEEDING = ("drive_torque", "brake_torque", "speed", "yaw_rate_speed", "yaw_rate", "delta")
"""Features of which the part beyond a threshold is tried."""
HYSTERETIC = ("torque", "delta", "a_y")
_RESONATING = ("a_x", "a_y", "torque", "delta")
_CONDITIONS = ("lateral_size", "speed", "delta_size", "deceleration", TIME)
_BOTH_SIDES = ("speed",)
"""Conditions of which a feature may also act below the threshold."""


class ParametricGrid:
    """Names of the features to screen along a recording; `names`: without waves and ripples."""

    def __init__(self, signals: Signals, features: Sequence[str]) -> None:
        """`features`: the observable ones; others are neither modified nor conditions."""
        static = {name: entry.function for name, entry in FEATURES.items()}
        self.quantiles = {}
        for name in _CONDITIONS:
            values = condition_values(name, signals, static)
            # An acceleration is no deceleration.
            values = values[values > 0.0] if name == "deceleration" else values
            if values.size:
                self.quantiles[name] = np.quantile(values, _FINE_QUANTILES)
        self._sizes = {
            name: _nonzero_sizes(FEATURES[name].function(signals)) for name in EXCEEDING
        }
        names = [*self._memories(signals), *self._switched(), *self._worn(signals)]
        has_torque = "torque" in features
        self.names = [
            name
            for name in names
            if has_torque or not ("torque" in name or "brake" in name or name.startswith("heat"))
        ]

    def _memories(self, signals: Signals) -> list[str]:
        names = [
            resonance_name(signal, frequency, damping)
            for signal in _RESONATING
            for frequency in FREQUENCIES_HZ
            for damping in DAMPING_RATIOS
        ]
        names += [lag_name(signal, tau) for signal in FILTERED_SIGNALS for tau in TIME_CONSTANTS_S]
        for signal in HYSTERETIC:
            spread = float(np.std(signals[signal]))
            names += [hysteresis_name(signal, share * spread) for share in WIDTHS if spread > 0.0]
        return names

    def _switched(self) -> list[str]:
        names = []
        for base in GATED:
            for condition, values in self.quantiles.items():
                sides = (True, False) if condition in _BOTH_SIDES else (True,)
                thresholds = np.interp(QUANTILES, _FINE_QUANTILES, values)
                names += [
                    gate_name(base, condition, above, float(threshold))
                    for above in sides
                    for threshold in thresholds
                ]
            names += [gate_name(base, "torque", above, 0.0) for above in (True, False)]
        for base, sizes in self._sizes.items():
            thresholds = np.quantile(sizes, QUANTILES[1:]) if sizes.size else np.empty(0)
            names += [excess_name(base, float(threshold)) for threshold in thresholds]
        return names

    def _worn(self, signals: Signals) -> list[str]:
        variables = [(TIME, GATED), (BRAKE_WORK, ("brake_torque",))]
        names = [
            named(base, variable, scale * last)
            for variable, bases in variables
            for scale in SCALES
            for base in bases
            for named in (drift_name, decay_name)
            if (last := float(drift_variable(variable, signals)[-1])) > 0.0
        ]
        return [*names, *(heat_name("brake_torque", tau) for tau in COOLING_S)]

    def neighbours(self, name: str, spacing: float) -> list[str]:
        """Return features with nearby parameters; `spacing` is relative to that of the grid."""
        kind, arguments = parsed(name)
        if kind == RESONANCE:
            factors = [0.9**spacing, 0.95**spacing, 1.0, 1.05**spacing, 1.1**spacing]
            dampings = [2.0 ** (spacing * k) for k in (-1, 0, 1)]
            return [scaled(name, [f, d]) for f in factors for d in dampings]
        if kind == GATE:
            return self._near_thresholds(arguments, spacing)
        reach = 1.7 if kind in {DRIFT, DECAY} else 1.5 if kind == LAG else 1.3
        return [scaled(name, [reach ** (spacing * k)]) for k in (-1, -0.5, 0.5, 1)]

    def _near_thresholds(self, arguments: Sequence[str], spacing: float) -> list[str]:
        condition, above, threshold = split_condition(arguments[1])
        if condition not in self.quantiles:
            return []
        values = self.quantiles[condition]
        near = int(np.argmin(np.abs(values - threshold)))
        reach = 4 if spacing == 1.0 else 1
        low, high = values[max(near - reach, 0)], values[min(near + reach, values.size - 1)]
        thresholds = np.linspace(low, high, 9)
        return [gate_name(arguments[0], condition, above, float(x)) for x in thresholds]


def _nonzero_sizes(values: FloatArray) -> FloatArray:
    """Return the magnitudes of the values that are not zero."""
    sizes = np.abs(values)
    return sizes[sizes > 1e-9]
