# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What two recordings say without a vehicle model: the same regressions on both.

The equations of `direct_quantities` are approximate, and what they omit depends on the driving.
Both recordings are therefore weighted to the same shares of speed and lateral acceleration
(`common_driving`), and what the equations omit is assumed to be equal in both. A difference counts
where it exceeds build tolerance by three standard deviations of a block bootstrap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.criteria import TOLERANCE_BOUND
from adk_ros.mismatch.library.surrogate_parameters import SURROGATE_PARAMETERS
from adk_ros.mismatch.recording.common_driving import (
    PERIOD_S,
    DrivingSignals,
    common_weights,
)
from adk_ros.mismatch.recording.direct_meanings import MEANINGS, threshold
from adk_ros.mismatch.recording.direct_quantities import Quantity, quantities
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.numerics.constants import GRAVITY, QUANTILE_90
from adk_ros.numerics.similarity import scaled_by_unit

SIGNIFICANT_SIGMAS = 3.0
"""Standard deviations beyond build tolerance from which a difference is significant: p = 0.003."""
_SCALED = {"drag_area": "m^2"}
"""Unit of a quantity whose tolerance is an absolute one of a full-size car."""
_MIN_COMMON_S = 40.0
"""Least driving that both recordings share, s: eight bootstrap blocks of 5 s."""
_GRADIENT_TOLERANCE = (
    2.0 * TOLERANCE_BOUND / (GRAVITY * SURROGATE_PARAMETERS["stiffness_f"].default)
)
"""
Difference of the understeer gradient within build tolerance, rad s²/m. It is the difference of the
slip angles per acceleration, 1 / (g stiffness) on each axle; stiffness and load of two axles, each
within `TOLERANCE_BOUND`, add in quadrature.
"""


@dataclass(frozen=True)
class Estimate:
    """A value with its standard deviation."""

    value: float
    deviation: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 90 % interval."""
        half = QUANTILE_90 * self.deviation
        return self.value - half, self.value + half


@dataclass(frozen=True)
class DirectComparison:
    """
    A quantity of both recordings, in `unit`.

    `tolerance`: difference that build tolerance and sensor offsets explain; `effects`: effects of
    the catalogue that change the quantity, the most direct first; `equations` that it enters;
    `assumption` in words; `is_relative`: whether the difference is stated as a share of the
    simulation's value.
    """

    name: str
    quantity: str
    unit: str
    simulation: Estimate
    recording: Estimate
    tolerance: float
    effects: tuple[str, ...]
    equations: tuple[str, ...]
    assumption: str
    is_relative: bool = False

    @property
    def difference(self) -> Estimate:
        """Recording minus simulation."""
        return Estimate(
            self.recording.value - self.simulation.value,
            float(np.hypot(self.recording.deviation, self.simulation.deviation)),
        )

    @property
    def differs(self) -> bool:
        """Whether the difference exceeds the tolerance by more than its statistical error."""
        found = self.difference
        return bool(abs(found.value) > self.tolerance + SIGNIFICANT_SIGMAS * found.deviation)


def compare_directly(
    simulation: SensorLog,
    recording: SensorLog,
    wheel_radius: float,
    unobservable: frozenset[str] = frozenset(),
) -> list[DirectComparison]:
    """
    Return the quantities that both recordings allow, in the order of `MEANINGS`.

    `unobservable`: effects that the channels do not show; quantities that speak for no other
    effect are left out. Empty without common driving.
    """
    size = simulation.length_scale
    signals = [DrivingSignals.of(log) for log in (simulation, recording)]
    weights = common_weights(*signals)
    if min(w.sum() for w in weights) * PERIOD_S < _MIN_COMMON_S:
        return []
    speed = float(np.average(signals[1].v_x, weights=weights[1]))
    found = [
        dict(quantities(each, w, speed, wheel_radius))
        for each, w in zip(signals, weights, strict=True)
    ]
    out = []
    for name, meaning in MEANINGS.items():
        if meaning.effects[0] in unobservable or not all(name in each for each in found):
            continue
        first, second = (_estimate(each[name]) for each in found)
        out.append(
            DirectComparison(
                name,
                meaning.quantity,
                meaning.unit,
                first,
                second,
                _tolerance(name, found[0], speed)
                * scaled_by_unit(1.0, _SCALED.get(name, ""), size),
                meaning.effects,
                EFFECTS[meaning.effects[0]].equations,
                meaning.assumption,
                meaning.relative,
            )
        )
    return out


def _tolerance(name: str, simulation: Mapping[str, Quantity], speed: float) -> float:
    """Return the difference of a quantity that build tolerance and sensor offsets explain."""
    meaning, value = MEANINGS[name], abs(simulation[name].value)
    if name == "steering_gain":
        # gain = 1 / (L + K v^2): a tolerance of the understeer gradient K adds to that of L.
        gradient = _GRADIENT_TOLERANCE * speed**2 * value
        return value * float(np.hypot(meaning.tolerance, gradient))
    if name == "resistance":
        # An offset of the accelerometer acts like a resistance.
        return threshold("imu_bias") * abs(simulation["torque_per_acceleration"].value)
    return meaning.tolerance * (value if meaning.relative else 1.0)


def _estimate(quantity: Quantity) -> Estimate:
    return Estimate(float(quantity.value), float(quantity.resampled.std()))
