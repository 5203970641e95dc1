# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for oscillations in time, distance and speed, at peaks of the residuals' spectrum.

An oscillation in distance may be one of a wheel, a brake disc or a corrugated road. It is coherent
only if the wheel does not slip much between revolutions. Bins of 40 ms attenuate a frequency f by
sin(pi f 0.04 s) / (pi f 0.04 s): 0.87 at 7 Hz, nothing is left at 25 Hz. Above 12.5 Hz the
frequency is aliased; the feature has the same alias, so its wavelength remains that of the
distance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.inference.found_feature import Found
from adk_ros.mismatch.inference.linear_response import LinearResponse
from adk_ros.mismatch.library.criteria import PENALTY_PER_LOCATION
from adk_ros.mismatch.library.features import FEATURES, Signals, feature
from adk_ros.mismatch.library.parametric_features import (
    pulsation_name,
    ripple_name,
    searched_parameters,
    speed_wave_name,
    split_condition,
    wave_name,
)
from adk_ros.mismatch.library.parametric_values import accumulated, step_of
from adk_ros.mismatch.surrogate.feature_terms import STEERING
from adk_ros.mismatch.surrogate.residuals import BIN_S
from adk_ros.mismatch.surrogate.state_index import IMU_A_X, IMU_A_Y, IMU_YAW_RATE
from adk_ros.numerics.arrays import FloatArray

_MAIN_CHANNEL = {"v_x": IMU_A_X, "v_y": IMU_A_Y, "yaw_rate": IMU_YAW_RATE, STEERING: IMU_YAW_RATE}
_WAVE_RANGE_HZ = (0.05, 8.0)
"""
Frequencies in time that are tried: 8 Hz lies above those of body, steering and pressure control.
"""
_WAVELENGTHS_M = (1.0, 1000.0)
"""Wavelengths that are tried: from less than a turn of a small wheel to a section of a lap."""
_RIPPLING = ("constant", "speed_squared", "brake_torque")
"""Features that may oscillate with distance: an unbalanced wheel's force rises with v_x^2."""
_SPEED_DEPENDENT = ("constant", "drive_torque", "yaw_rate_speed")
"""Features that may oscillate with the speed: a vibration, a driveline, a tyre's response."""
_PULSATING = ("torque", "drive_torque", "brake_torque")
"""Features that may oscillate in time."""
_DISTANCE_STEP_M = 0.1
_SPEED_STEP_MPS = 0.1
_PERIODS_MPS = (1.0, 20.0)
"""
Periods of an oscillation with the speed that are tried: from a narrow resonance to the range of
speeds of a drive.
"""
_PEAKS = 2
"""Peaks of a spectrum that are tried."""
_PADDING = 8
_SHIFTS = (-0.3, -0.15, 0.15, 0.3)
"""Frequencies tried near a peak, over the resolution of the recording."""

Named = Callable[[float, float], str]
"""Maps frequency, 1/s or 1/m, and phase to the name of a feature."""


class _Axis(NamedTuple):
    """Variable of an oscillation: values (n,), resolution, periods tried, and feature's name."""

    values: FloatArray
    step: float
    periods: tuple[float, float]
    named: Callable[[float, float, str], str]


class PeriodicSearch:
    """Oscillations along a recording; `features`: the observable ones."""

    def __init__(self, signals: Signals, equations: Sequence[str], features: Sequence[str]):
        self.signals = signals
        self.equations = list(equations)
        self._features = set(features)
        self._distance = accumulated(signals["v_x"], step_of(signals))
        self._speed = np.maximum(signals["v_x"], 0.0)
        speeds = np.quantile(signals["v_x"], (0.25, 0.45, 0.65, 0.85))
        self._gates = ["", *(f"speed>{x:.4g}" for x in speeds)]

    def best(self, response: LinearResponse) -> list[Found]:
        """Return an oscillation in time, distance and speed for each equation, if there is one."""
        bins = response.linearised.likelihood.problem.bins
        residuals = response.linearised.projected[: 6 * bins].reshape(6, bins)
        found = []
        for equation in self.equations:
            residual = residuals[_MAIN_CHANNEL[equation]]
            found += [
                self._wave(response, equation, residual),
                self._ripple(response, equation, residual),
                self._speed_wave(response, equation, residual),
            ]
        return [x for x in found if x.name]

    def _wave(self, response: LinearResponse, equation: str, residual: FloatArray) -> Found:
        """Return the best oscillation in time: always, above a speed, or of a torque."""
        problem = response.linearised.likelihood.problem
        speed = problem.binned(self.signals["v_x"])
        size = _PADDING * residual.size
        axis = _axis(size, BIN_S)
        trials = []
        for of in (*self._gates, *(name for name in _PULSATING if name in self._features)):
            if of in _PULSATING:
                weight = problem.binned(FEATURES[of].function(self.signals))
            else:
                above = speed > (split_condition(of)[2] if of else -np.inf)
                weight = above.astype(np.float64)

            def named(frequency: float, phase: float, of: str = of) -> str:
                build = pulsation_name if of in _PULSATING else wave_name
                return build(frequency, phase, of)

            spectrum = np.abs(np.fft.rfft(residual * weight, size))
            trials += [(f, named) for f in _peaks(spectrum, axis, _WAVE_RANGE_HZ)]
        duration = float(self.signals["time"][-1] - self.signals["time"][0])
        return self._refined(response, equation, trials, 1.0 / duration)

    def _ripple(self, response: LinearResponse, equation: str, residual: FloatArray) -> Found:
        """Return the best oscillation in distance of a feature."""
        along = _Axis(self._distance, _DISTANCE_STEP_M, _WAVELENGTHS_M, ripple_name)
        return self._along(response, equation, residual, along, _RIPPLING)

    def _speed_wave(self, response: LinearResponse, equation: str, residual: FloatArray) -> Found:
        """Return the best oscillation with the speed of a feature."""
        along = _Axis(self._speed, _SPEED_STEP_MPS, _PERIODS_MPS, speed_wave_name)
        return self._along(response, equation, residual, along, _SPEED_DEPENDENT)

    def _along(
        self,
        response: LinearResponse,
        equation: str,
        residual: FloatArray,
        along: _Axis,
        bases: Sequence[str],
    ) -> Found:
        """Return the best oscillation of a feature in a variable."""
        problem = response.linearised.likelihood.problem
        at = np.rint(problem.binned(along.values) / along.step).astype(np.int64)
        at -= at.min()
        size = _PADDING * int(at.max() + 1)
        axis = _axis(size, along.step)
        limits = (1.0 / along.periods[1], 1.0 / along.periods[0])
        trials = []
        for base in (name for name in bases if name in self._features):
            weight = problem.binned(FEATURES[base].function(self.signals))
            spectrum = np.abs(np.fft.rfft(np.bincount(at, residual * weight), size))

            def named(frequency: float, phase: float, base: str = base) -> str:
                return along.named(1.0 / frequency, phase, base)

            trials += [(f, named) for f in _peaks(spectrum, axis, limits)]
        span = max(float(np.ptp(along.values)), 1.0)
        return self._refined(response, equation, trials, 1.0 / span)

    def _refined(
        self,
        response: LinearResponse,
        equation: str,
        trials: Sequence[tuple[float, Named]],
        resolution: float,
    ) -> Found:
        """Return the best of some oscillations, its frequency refined."""
        best, at, best_named = Found(equation, "", -np.inf), 0.0, None
        for frequency, named in trials:
            trial = self._with_phase(response, equation, frequency, named)
            if trial.gain > best.gain:
                best, at, best_named = trial, frequency, named
        if best_named is None:
            return best
        near = [at + shift * resolution for shift in _SHIFTS if at + shift * resolution > 0.0]
        shifted = [self._with_phase(response, equation, x, best_named) for x in near]
        return max([best, *shifted], key=lambda x: x.gain)

    def _with_phase(
        self, response: LinearResponse, equation: str, frequency: float, named: Named
    ) -> Found:
        """Return the oscillation at a frequency with its best phase."""
        quarters = (feature(named(frequency, phase)) for phase in (0.0, -0.5 * np.pi))
        columns = [response.column(equation, x.function(self.signals)) for x in quarters]
        (cosine, sine), gain = response.gain(np.column_stack(columns))
        name = named(frequency, float(np.arctan2(-sine, cosine)))
        return Found(equation, name, gain - PENALTY_PER_LOCATION * searched_parameters(name))


def _axis(size: int, step: float) -> FloatArray:
    """Return the frequencies of a spectrum of `size` samples."""
    return np.asarray(np.fft.rfftfreq(size, step), dtype=np.float64)


def _peaks(spectrum: FloatArray, axis: FloatArray, limits: tuple[float, float]) -> list[float]:
    """Return the frequencies of the largest peaks of a padded spectrum within limits."""
    left = np.where((axis >= limits[0]) & (axis <= limits[1]), spectrum, 0.0)
    out = []
    for _ in range(_PEAKS):
        top = int(np.argmax(left))
        if left[top] <= 0.0:
            break
        out.append(float(axis[top]))
        left[max(top - 2 * _PADDING, 0) : top + 2 * _PADDING + 1] = 0.0
    return out
