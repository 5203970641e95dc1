# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Effects as data: how the parameters of an effect enter the surrogate's parameter vector.

To add an effect, write an `Effect` into one of the lists in `catalogue`: name, parameters,
equation, excitation and confusable effects; and its category into `categories`. If the equations
of motion contain its physics already, that is all. Otherwise add an entry to
`surrogate_parameters.SURROGATE_PARAMETERS` whose default has no influence, and its term to
`surrogate.equations_of_motion`, `tyre_forces` or `command_response`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from adk_ros.mismatch.library.surrogate_parameters import INDEX, SURROGATE_PARAMETERS
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.similarity import scaled_by_unit

ALWAYS, PLACE, TIME = "always", "place", "time"


@dataclass(frozen=True)
class EffectParameter:
    """
    One parameter of an effect, in the unit in which it is reported.

    `targets` maps entries of the surrogate's parameter vector to the amount that one unit of
    (value - neutral) adds to them; if `relative`, to that multiple of the entry itself. An
    `inverse` parameter enters by its reciprocal. `step` is the finite-difference step of the
    fitted variable theta. A difference from neutral below `materiality_threshold` is within
    build tolerance and not reported. `starts` are start values of a fit; empty: neutral.

    The materiality thresholds are by choice: 2 % of a factor of the vehicle (five standard
    deviations of `criteria.TOLERANCE_SIGMA`), 0.5 % of a scale of a sensor, and else a size that
    is not worth a correction of the simulator, 3 to 20 % of what the benchmark injects at full
    strength (`plant.injection.injectors`); of the IMU's lateral place 38 %.
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
        """Fitted variable without effect."""
        return 0.0 if self.inverse else self.neutral

    def value(self, theta: float) -> float:
        """Return the value of a fitted variable, in `unit`."""
        return 1.0 / max(theta, 1e-30) if self.inverse else theta

    def theta(self, value: float) -> float:
        """Return the fitted variable of a value."""
        return 1.0 / value if self.inverse else value

    def bounds(self) -> tuple[float, float]:
        """Return the bounds of the fitted variable."""
        return (0.0, 1.0 / self.low) if self.inverse else (self.low, self.high)

    def amounts(self, theta: float, base: FloatArray) -> list[tuple[int, float]]:
        """Return (index, amount) pairs that the fitted variable adds to the vector `base`."""
        size = theta - self.theta_neutral
        return [
            (INDEX[entry], size * factor * (float(base[INDEX[entry]]) if self.relative else 1.0))
            for entry, factor in self.targets.items()
        ]

    def is_material(self, theta: float) -> bool:
        """Whether the difference from neutral exceeds the materiality threshold."""
        if self.inverse:
            return self.value(theta) < self.materiality_threshold
        return abs(theta - self.neutral) >= self.materiality_threshold

    def similar(self, size: float) -> EffectParameter:
        """Return the parameter with bounds, step and thresholds at a scale of lengths."""

        def scaled(value: float) -> float:
            return scaled_by_unit(value, self.unit, size)

        def factor(entry: str, of: float) -> float:
            # A payload in kg adds to the yaw inertia, in kg m^2, by a length squared.
            unit = SURROGATE_PARAMETERS[entry].unit
            return of if self.relative else scaled_by_unit(of, unit, size) / scaled(1.0)

        step_unit = f"1/{self.unit}" if self.inverse else self.unit
        targets = self.targets
        if not self.inverse:
            targets = {entry: factor(entry, of) for entry, of in targets.items()}
        return replace(
            self,
            low=scaled(self.low),
            high=scaled(self.high),
            step=scaled_by_unit(self.step, step_unit, size),
            materiality_threshold=scaled(self.materiality_threshold),
            starts=tuple(scaled(x) for x in self.starts),
            targets=targets,
        )


@dataclass(frozen=True)
class Effect:
    """
    A named physical effect, or a sensor fault, that a simulation may lack.

    `equations`: state equations or sensors that it enters (v_x, v_y, yaw_rate, imu, odometry).
    `equation`: its formula. `excitation`: driving that makes it observable. `confusables`: effects
    with similar residuals. `manoeuvre`: driving that separates it from those. `activations`: how
    it may act (always, place, time). `where`: its location in words when it acts always.
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

    def similar(self, size: float) -> Effect:
        """Return the effect in a vehicle at a scale of lengths (`numerics.similarity`)."""
        return replace(self, parameters=tuple(p.similar(size) for p in self.parameters))
