# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What an effect is: data that say how its parameters enter the stand-in's vector.

To add one, write an `Effect` into a list of `catalogue`: name, parameters, equation, what excites
it and what it is confused with. If its physics is in the kernel already, that is all; else it
needs an entry in `parameters.ENTRIES`, zero where nothing acts, and its line in `kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.numerics.arrays import FloatArray

ALWAYS, PLACE, TIME = "always", "place", "time"


@dataclass(frozen=True)
class EffectParameter:
    """
    A parameter of an effect, as a person reads it.

    `entries` maps entries of the stand-in's vector to what a unit of (value - neutral) adds to
    them; where `relative`, that much of the entry itself. An `inverse` parameter enters by its
    reciprocal. `step` is that of differences, `least` the size (from neutral) below which it is
    build tolerance and not worth a name. `starts` are values to start a fit from; none: neutral.
    """

    name: str
    unit: str
    low: float
    high: float
    step: float
    materiality_threshold: float
    targets: dict[str, float]
    neutral: float = 0.0
    relative: bool = False
    inverse: bool = False
    starts: tuple[float, ...] = ()

    @property
    def theta_neutral(self) -> float:
        """Value of the fitted variable at which nothing acts."""
        return 0.0 if self.inverse else self.neutral

    def value(self, inner: float) -> float:
        """Return the value that a fitted variable stands for."""
        return 1.0 / max(inner, 1e-30) if self.inverse else inner

    def theta(self, value: float) -> float:
        """Return the fitted variable of a value."""
        return 1.0 / value if self.inverse else value

    def bounds(self) -> tuple[float, float]:
        """Return the bounds of the fitted variable."""
        return (0.0, 1.0 / self.low) if self.inverse else (self.low, self.high)

    def amounts(self, inner: float, base: FloatArray) -> list[tuple[int, float]]:
        """Return (index, amount) pairs that this value adds to the vector `base`."""
        size = inner - self.theta_neutral
        return [
            (INDEX[entry], size * factor * (float(base[INDEX[entry]]) if self.relative else 1.0))
            for entry, factor in self.targets.items()
        ]

    def is_material(self, inner: float) -> bool:
        """Whether the value is more than build tolerance."""
        if self.inverse:
            return self.value(inner) < self.materiality_threshold
        return abs(inner - self.neutral) >= self.materiality_threshold


@dataclass(frozen=True)
class Effect:
    """
    A named piece of physics, or a fault of a sensor, that a simulation may lack.

    `equations` are the ones it enters (v_x, v_y, yaw_rate, imu, odometry); `scopes` where it may
    act; `confused` names of effects that look alike; `manoeuvre` what tells it from those.
    """

    name: str
    parameters: tuple[EffectParameter, ...]
    equations: tuple[str, ...]
    equation: str
    excitation: str
    confusables: tuple[str, ...] = ()
    manoeuvre: str = ""
    activations: tuple[str, ...] = (ALWAYS, TIME)
    sensor: bool = False
    where: str = field(default="the whole drive")
