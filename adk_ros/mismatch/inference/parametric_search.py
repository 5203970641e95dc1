# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for features with a memory, a threshold or an oscillation in time.

All members of a grid are screened by their linear response (`linear_response`); the parameters of
the best are refined. A feature that was found by a search costs `PENALTY_PER_LOCATION` for each
parameter that was searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.library.criteria import PENALTY_PER_LOCATION
from adk_ros.mismatch.library.features import FEATURES, Signals, feature
from adk_ros.mismatch.library.parametric_features import (
    FILTERED_SIGNALS,
    GATE,
    RESONANCE,
    gate_name,
    kind_of,
    lag_name,
    parsed,
    resonance_name,
    searched_parameters,
    split_condition,
    wave_name,
)
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.mismatch.surrogate.state_index import IMU_A_X, IMU_A_Y, IMU_YAW_RATE
from adk_ros.numerics.arrays import FloatArray

FREQUENCIES_HZ = tuple(float(x) for x in np.geomspace(0.15, 3.0, 18))
DAMPING_RATIOS = (0.04, 0.15)
"""Resonances that are tried; more damped ones resemble a lag."""
TIME_CONSTANTS_S = (0.15, 0.4, 1.0, 2.5, 6.0, 15.0)
QUANTILES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.85, 0.93)
"""Thresholds that are tried, as quantiles of the condition's values."""
_FINE_QUANTILES = np.linspace(0.05, 0.97, 47)
GATED = (
    "constant",
    "drive_torque",
    "brake_torque",
    "yaw_rate_speed",
    "delta",
    "speed_squared",
)
"""Features that a threshold may switch."""
_RESONATING = ("a_x", "a_y")
_MAIN_CHANNEL = {"v_x": IMU_A_X, "v_y": IMU_A_Y, "yaw_rate": IMU_YAW_RATE}
_WAVE_RANGE_HZ = (0.05, 3.0)
_PEAKS = 2
"""Peaks of a spectrum that are tried."""
_PADDING = 8
_KEPT = 40
"""Members of the grid that are kept for later rounds."""
_REFINED = 6
"""Members that are refined in each round."""


class Found(NamedTuple):
    """A feature in an equation, with its gain in loss less the penalty for the search."""

    equation: str
    name: str
    gain: float


class ParametricSearch:
    """Grid of parametric features along a recording; `kept` after the first round."""

    def __init__(self, signals: Signals, equations: Sequence[str], features: Sequence[str]):
        """`features`: the observable ones; others are neither gated nor conditions."""
        self.signals = signals
        self.equations = list(equations)
        self._quantiles = {
            name: np.quantile(FEATURES[name].function(signals), _FINE_QUANTILES)
            for name in ("lateral_size", "speed", "delta_size")
        }
        has_torque = "torque" in features
        self._names = [name for name in self._grid() if has_torque or "torque" not in name]
        self._kept: list[tuple[str, str]] | None = None

    def _grid(self) -> list[str]:
        names = [
            resonance_name(signal, frequency, damping)
            for signal in _RESONATING
            for frequency in FREQUENCIES_HZ
            for damping in DAMPING_RATIOS
        ]
        names += [lag_name(signal, tau) for signal in FILTERED_SIGNALS for tau in TIME_CONSTANTS_S]
        for base in GATED:
            for condition in self._quantiles:
                sides = (True, False) if condition == "speed" else (True,)
                thresholds = np.interp(QUANTILES, _FINE_QUANTILES, self._quantiles[condition])
                names += [
                    gate_name(base, condition, above, float(threshold))
                    for above in sides
                    for threshold in thresholds
                ]
            names += [gate_name(base, "torque", above, 0.0) for above in (True, False)]
        return names

    def best(self, response: LinearResponse, count: int) -> list[Found]:
        """Return the best features, their parameters refined, best first."""
        pairs = self._kept or [(e, name) for name in self._names for e in self.equations]
        found = sorted(
            (self._screened(response, equation, name) for equation, name in pairs),
            key=lambda x: -x.gain,
        )
        self._kept = [(x.equation, x.name) for x in found[:_KEPT]]
        refined = [self._refined(response, x) for x in _distinct(found)[:_REFINED]]
        refined += self._waves(response)
        return sorted(refined, key=lambda x: -x.gain)[:count]

    def values(self, name: str) -> FloatArray:
        """Return a feature along the recording (n,)."""
        return feature(name).function(self.signals)

    def _screened(self, response: LinearResponse, equation: str, name: str) -> Found:
        values = self.values(name)
        if not np.any(values):
            return Found(equation, name, -np.inf)
        _, gain = response.gain(response.column(equation, values)[:, None])
        return Found(equation, name, gain - PENALTY_PER_LOCATION * searched_parameters(name))

    def _refined(self, response: LinearResponse, start: Found) -> Found:
        """Return the best feature of the same kind with parameters near those of `start`."""
        best = start
        for spacing in (1.0, 0.3):
            trials = [
                self._screened(response, best.equation, name)
                for name in self._neighbours(best.name, spacing)
            ]
            best = max([best, *trials], key=lambda x: x.gain)
        return best

    def _neighbours(self, name: str, spacing: float) -> list[str]:
        """Return features with nearby parameters; `spacing` is relative to that of the grid."""
        kind, arguments = parsed(name)
        factors = [0.9**spacing, 0.95**spacing, 1.0, 1.05**spacing, 1.1**spacing]
        if kind == RESONANCE:
            frequency, damping = float(arguments[1]), float(arguments[2])
            dampings = [damping * 2.0 ** (spacing * k) for k in (-1, 0, 1)]
            return [
                resonance_name(arguments[0], frequency * f, d) for f in factors for d in dampings
            ]
        if kind == GATE:
            condition, above, threshold = split_condition(arguments[1])
            if condition not in self._quantiles:
                return []
            values = self._quantiles[condition]
            near = int(np.argmin(np.abs(values - threshold)))
            reach = 4 if spacing == 1.0 else 1
            low, high = values[max(near - reach, 0)], values[min(near + reach, values.size - 1)]
            thresholds = np.linspace(low, high, 9)
            return [gate_name(arguments[0], condition, above, float(x)) for x in thresholds]
        tau = float(arguments[1])
        return [lag_name(arguments[0], tau * 1.5 ** (spacing * k)) for k in (-1, -0.5, 0.5, 1)]

    def _waves(self, response: LinearResponse) -> list[Found]:
        """Return an oscillation in time for each equation, at a peak of the residual spectrum."""
        problem = response.linearised.likelihood.problem
        bins = problem.bins
        residuals = response.linearised.projected[: 6 * bins].reshape(6, bins)
        found = []
        for equation in self.equations:
            gates = ["", *(f"speed>{x:.4g}" for x in self._quantiles["speed"][10::10])]
            best = Found(equation, "", -np.inf)
            for gate in gates:
                weight = np.ones(bins)
                if gate:
                    condition, above, threshold = split_condition(gate)
                    values = problem.binned(FEATURES[condition].function(self.signals))
                    weight = np.asarray((values > threshold) == above, dtype=np.float64)
                for frequency in _peaks(residuals[_MAIN_CHANNEL[equation]] * weight):
                    trial = self._fitted_wave(response, equation, frequency, gate)
                    best = max([best, trial], key=lambda x: x.gain)
            if best.name:
                found.append(best)
        return found

    def _fitted_wave(
        self, response: LinearResponse, equation: str, frequency: float, gate: str
    ) -> Found:
        """Return the oscillation near a frequency with its best phase."""
        duration = float(self.signals["time"][-1] - self.signals["time"][0])
        best = Found(equation, "", -np.inf)
        for shift in (-0.3, -0.15, 0.0, 0.15, 0.3):
            near = max(frequency + shift / duration, _WAVE_RANGE_HZ[0])
            columns = np.column_stack(
                [
                    response.column(equation, self.values(wave_name(near, phase, gate)))
                    for phase in (0.0, -0.5 * np.pi)
                ]
            )
            (cosine, sine), gain = response.gain(columns)
            name = wave_name(near, float(np.arctan2(-sine, cosine)), gate)
            gain -= PENALTY_PER_LOCATION * searched_parameters(name)
            best = max([best, Found(equation, name, gain)], key=lambda x: x.gain)
        return best


def _peaks(residual: FloatArray) -> list[float]:
    """Return the frequencies in Hz of the largest peaks of a series in bins."""
    size = _PADDING * residual.size
    spectrum = np.abs(np.fft.rfft(residual, size))
    frequency = np.fft.rfftfreq(size, BIN_S)
    inside = (frequency >= _WAVE_RANGE_HZ[0]) & (frequency <= _WAVE_RANGE_HZ[1])
    spectrum = np.where(inside, spectrum, 0.0)
    out = []
    for _ in range(_PEAKS):
        top = int(np.argmax(spectrum))
        if spectrum[top] <= 0.0:
            break
        out.append(float(frequency[top]))
        spectrum[max(top - 2 * _PADDING, 0) : top + 2 * _PADDING + 1] = 0.0
    return out


def _distinct(found: Sequence[Found]) -> list[Found]:
    """Return the best feature of each equation, kind and signal or gated feature."""
    seen: dict[tuple[str, ...], Found] = {}
    for item in found:
        arguments = item.name.split(":")
        key = [item.equation, *arguments[:2]]
        if kind_of(item.name) == GATE:
            key.append(split_condition(arguments[2])[0])
        seen.setdefault(tuple(key), item)
    return list(seen.values())
