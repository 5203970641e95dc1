# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How well a stand-in with some effects explains a recording: one likelihood over all channels.

The residuals of `course`, over their noise, are whitened channel by channel with an autoregressive
filter. Its spectrum is that of the sensors' white noise plus that of the stand-in's own error on
the simulation, where nothing is missing: what the stand-in cannot say of the simulator is no
evidence of missing physics. The car may differ from the nominal one by build tolerance in a dozen
parameters, each with a prior and a hard bound; without the bound they swallow effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.library.surrogate_parameters import HIGH, INDEX, LOW
from adk_ros.mismatch.surrogate.activation import ALWAYS_ACTIVE, Activation
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.residuals import BIN_S, ActiveTerms, ResidualProblem
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.levenberg_marquardt import BoundedParameters, FitResult, minimise

TOLERANCE_PARAMETERS = (
    "mass",
    "yaw_inertia",
    "cg_to_front_axle",
    "cg_to_rear_axle",
    "cg_height",
    "stiffness_f",
    "stiffness_r",
    "grip_f",
    "grip_r",
    "wheel_radius",
    "drag_area",
    "rolling",
)
"""Parameters in which one built car differs from the next."""
SENSOR_OFFSETS: dict[str, tuple[float, float, float]] = {
    # name: (usual spread, most, step of the differences)
    "bias_a_x": (0.006, 0.018, 0.005),
    "bias_a_y": (0.006, 0.018, 0.005),
    "bias_gyro": (2e-4, 7e-4, 2e-4),
}
"""What sensors are off by without being worth a name: SI, absolute."""
TOLERANCE_SIGMA = 0.004
"""Usual relative spread of those."""
TOLERANCE_BOUND = 0.012
TOLERANCE_STEP = 0.002
MIN_SPEED = 3.0
"""m/s, below which a car is not judged: slip is stiffer there than a step of the grid allows."""
SETTLING_S = 1.0
"""Beginning of a recording that is not judged: the stand-in's state has yet to settle."""
SEGMENT_END_STEP_M = 1.0
"""m, of differences with respect to a place's ends."""
ONSET_STEP_S = 0.1
_AR_ORDER = 30
_WEAK_DIRECTION_BOUND = 3.0
_WEAK_DIRECTION_STEP = 0.2

_TOLERANCE_INDEX = np.array([INDEX[name] for name in TOLERANCE_PARAMETERS])
_OFFSET_INDEX = np.array([INDEX[name] for name in SENSOR_OFFSETS])
_OFFSETS = np.array(list(SENSOR_OFFSETS.values()))
N_FIXED_NUISANCES = len(TOLERANCE_PARAMETERS) + len(SENSOR_OFFSETS)
"""Where among the nuisances those begin that the simulation left open."""


@dataclass(frozen=True)
class ActiveEffect:
    """An effect at work: its fitted variables (one a parameter) and where it acts."""

    effect: Effect
    theta: tuple[float, ...]
    activation: Activation = ALWAYS_ACTIVE

    def values(self) -> dict[str, float]:
        """Return parameter name -> value, as a person reads it."""
        return {
            parameter.name: parameter.value(x)
            for parameter, x in zip(self.effect.parameters, self.theta, strict=True)
        }

    def is_material(self) -> bool:
        """Whether any parameter is more than build tolerance."""
        return any(
            parameter.is_material(x)
            for parameter, x in zip(self.effect.parameters, self.theta, strict=True)
        )


def whitener(
    course: ResidualProblem, own_error: FloatArray, order: int = _AR_ORDER
) -> tuple[FloatArray, FloatArray]:
    """
    Return prediction-error filters (6, order + 1) for residuals over noise, and shares (6,).

    A share is that of the stand-in's own error in the variance of its channel.

    `own_error` (6, bins) is what the stand-in leaves of the simulation. Solves the Yule-Walker
    equations of the sum of both autocovariances, in units of the sensors' noise in a bin.
    """
    filters = np.zeros((6, order + 1))
    shares = np.zeros(6)
    per_bin = course.bin_noise
    for channel in range(6):
        error = own_error[channel] / per_bin[channel]
        error = np.clip(error - error.mean(), -5.0, 5.0)
        n = error.shape[0]
        covariance = np.array([error[: n - k] @ error[k:] / n for k in range(order + 1)])
        shares[channel] = covariance[0] / (1.0 + covariance[0])
        covariance[0] += 1.0
        toeplitz = covariance[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
        ahead = np.linalg.solve(toeplitz, covariance[1:])
        left = covariance[0] - ahead @ covariance[1:]
        filters[channel] = np.concatenate([[1.0], -ahead]) / np.sqrt(max(left, 1e-6))
    return filters, shares


@dataclass(frozen=True)
class Hypothesis:
    """Effects with a fit: `x` holds the tolerances, then the effects' variables in order."""

    actives: tuple[ActiveEffect, ...]
    tolerances: FloatArray
    cost: float
    fit: FitResult | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The effects' names."""
        return tuple(active.effect.name for active in self.actives)


@dataclass(frozen=True)
class Likelihood:
    """A course, the stand-in's parameters, and how residuals are weighed."""

    problem: ResidualProblem
    parameters: FloatArray
    weights: FloatArray
    filters: FloatArray
    weak_directions: FloatArray
    fixed_terms: ActiveTerms
    """What the stand-in has besides its parameters, along this course."""
    surrogate_error_share: FloatArray
    """(6,) share of the stand-in's own error in what a clean recording leaves, by channel."""
    until_s: float = np.inf
    unobservable: frozenset[str] = frozenset()
    """Effects, features and equations that the recording's channels say nothing of."""

    @classmethod
    def of(
        cls, course: ResidualProblem, stand_in: SurrogateModel, until_s: float = np.inf
    ) -> Likelihood:
        """Return the likelihood of a recording; of its part before `until_s`."""
        weights = course.weights()
        outside = (course.bin_s < course.start_s + SETTLING_S) | (course.bin_s >= until_s)
        weights[:, outside | _stationary_bins(course)] = 0.0
        filters, shares = whitener(course, stand_in.residuals)
        return cls(
            course,
            stand_in.parameters,
            weights,
            filters,
            stand_in.weak_directions,
            stand_in.fixed_terms(course),
            shares,
            until_s,
        )

    def expected_loss(self, e: FloatArray) -> float:
        """
        Return the loss that residuals `e` would have with nothing missing, at most.

        One for each, and as much again of what is the stand-in's own error: on another route it
        may be twice what it was in the simulation.
        """
        return float(np.count_nonzero(e) + self.surrogate_error_dof())

    def surrogate_error_dof(self) -> float:
        """Return the stand-in's own error as a share of the loss: how much of it is no noise."""
        return float((self.surrogate_error_share * np.count_nonzero(self.weights, axis=1)).sum())

    @property
    def n_nuisances(self) -> int:
        """Number of nuisance variables: tolerances, offsets, what the simulation left open."""
        return N_FIXED_NUISANCES + int(self.weak_directions.shape[0])

    def with_nuisances(self, tolerances: FloatArray) -> FloatArray:
        """Return the stand-in's vector with the nuisances: relative, absolute, in deviations."""
        k = len(TOLERANCE_PARAMETERS)
        p = np.clip(
            self.parameters + tolerances[N_FIXED_NUISANCES:] @ self.weak_directions, LOW, HIGH
        )
        p[_TOLERANCE_INDEX] *= 1.0 + tolerances[:k]
        p[_OFFSET_INDEX] += tolerances[k:N_FIXED_NUISANCES]
        return np.asarray(p)

    def simulation_inputs(
        self, tolerances: FloatArray, actives: Sequence[ActiveEffect]
    ) -> tuple[FloatArray, ActiveTerms]:
        """Return the vector and the terms that a run takes; what always acts is in the vector."""
        base = self.with_nuisances(tolerances)
        p = base.copy()
        given = self.fixed_terms
        index, amount, gate = list(given.index), list(given.amount), list(given.activation)
        gates = list(given.activations)
        for active in actives:
            row = 0
            if not active.activation.always:
                gates.append(active.activation.series(self.problem))
                row = len(gates) - 1
            for parameter, inner in zip(active.effect.parameters, active.theta, strict=True):
                for i, size in parameter.amounts(inner, base):
                    if row == 0:
                        p[i] += size
                    else:
                        index.append(i)
                        amount.append(size)
                        gate.append(row)
        return p, ActiveTerms(
            np.array(index, dtype=np.int64),
            np.array(amount, dtype=np.float64),
            np.array(gate, dtype=np.int64),
            np.array(gates),
        )

    def residuals(self, tolerances: FloatArray, actives: Sequence[ActiveEffect]) -> FloatArray:
        """Return all whitened residuals as one vector, the ways driven last."""
        p, terms = self.simulation_inputs(tolerances, actives)
        e = self.whiten(self.problem.residuals(p, terms))
        ways = self.problem.distance_residuals(p)
        keep = int(min(ways.shape[0], max(0.0, (self.until_s - self.problem.start_s) / 2.0)))
        return np.concatenate([e.ravel(), ways[:keep]])

    def whiten(self, residuals: FloatArray) -> FloatArray:
        """Return residuals (6, bins) over their noise, whitened."""
        scaled = residuals * self.weights
        out = np.empty_like(scaled)
        n = scaled.shape[1]
        for channel in range(6):
            out[channel] = np.convolve(scaled[channel], self.filters[channel])[:n]
        out[self.weights == 0.0] = 0.0
        return out

    def fit(
        self,
        actives: Sequence[ActiveEffect],
        tolerances: FloatArray | None = None,
        iterations: int = 8,
        known: FloatArray | None = None,
        settled: float = 1e-5,
        edges: bool = False,
    ) -> Hypothesis:
        """
        Fit tolerances and the effects' variables together, starting from those given.

        `known` (m, nuisances): derivatives with respect to the tolerances, taken as they are,
        which is much faster. With `edges`, where the effects act is fitted as well.
        """
        unknowns = self._unknowns(actives, tolerances, edges)
        k = self.n_nuisances

        def residuals(x: FloatArray) -> FloatArray:
            return self.residuals(x[:k], with_parameters(actives, x[k:], edges))

        found = minimise(residuals, unknowns, iterations, settled, known)
        return Hypothesis(
            tuple(with_parameters(actives, found.x[k:], edges)),
            found.x[:k].copy(),
            found.cost,
            found,
        )

    def _unknowns(
        self, actives: Sequence[ActiveEffect], tolerances: FloatArray | None, edges: bool
    ) -> BoundedParameters:
        k = self.n_nuisances
        start = list(np.zeros(k) if tolerances is None else tolerances)
        high = list(self.nuisance_bounds())
        low = [-x for x in high]
        step = list(self.nuisance_steps())
        for active in actives:
            for parameter, inner in zip(active.effect.parameters, active.theta, strict=True):
                start.append(inner)
                bounds = parameter.bounds()
                low.append(bounds[0])
                high.append(bounds[1])
                step.append(parameter.step)
            for value in active.activation.variables() if edges else ():
                start.append(value)
                room = 0.5 * active.activation.lap if active.activation.stretches else 1e4
                low.append(value - room)
                high.append(value + room)
                step.append(SEGMENT_END_STEP_M if active.activation.stretches else ONSET_STEP_S)
        loose = len(start) - k
        return BoundedParameters(
            np.array(start),
            np.array(low),
            np.array(high),
            np.array(step),
            np.zeros(k + loose),
            np.concatenate([self.nuisance_deviations(), np.full(loose, np.inf)]),
        )

    def nuisance_jacobian(self, of: Hypothesis) -> FloatArray:
        """Return the residuals' derivatives (m, nuisances) with respect to the nuisances."""
        e = self.residuals(of.tolerances, of.actives)
        out = np.empty((e.shape[0], self.n_nuisances))
        for j, step in enumerate(self.nuisance_steps()):
            moved = of.tolerances.copy()
            moved[j] += step
            out[:, j] = (self.residuals(moved, of.actives) - e) / step
        return out

    def nuisance_steps(self) -> FloatArray:
        """Return the steps of differences with respect to the nuisances."""
        left_open = np.full(self.weak_directions.shape[0], _WEAK_DIRECTION_STEP)
        return np.concatenate(
            [np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_STEP), _OFFSETS[:, 2], left_open]
        )

    def nuisance_bounds(self) -> FloatArray:
        """Return the most that each nuisance may be, either way."""
        left_open = np.full(self.weak_directions.shape[0], _WEAK_DIRECTION_BOUND)
        return np.concatenate(
            [np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_BOUND), _OFFSETS[:, 1], left_open]
        )

    def nuisance_deviations(self) -> FloatArray:
        """Return the prior standard deviations of the nuisances."""
        return np.concatenate(
            [
                np.full(len(TOLERANCE_PARAMETERS), TOLERANCE_SIGMA),
                _OFFSETS[:, 0],
                np.ones(self.weak_directions.shape[0]),
            ]
        )


def _stationary_bins(course: ResidualProblem) -> BoolArray:
    """Return the bins (b,) in which the car stands or has just begun to move."""
    slow = np.interp(course.bin_s, course.middle_s, np.abs(course.smooth[:, 0])) < MIN_SPEED
    after = np.ones(round(SETTLING_S / BIN_S), dtype=np.int64)
    return np.asarray(np.convolve(slow.astype(np.int64), after)[: slow.shape[0]] > 0)


def with_parameters(
    actives: Sequence[ActiveEffect], values: FloatArray, edges: bool = False
) -> list[ActiveEffect]:
    """Return the effects with their fitted variables replaced, in order."""
    out, rest = [], [float(v) for v in values]
    for active in actives:
        inner, rest = tuple(rest[: len(active.theta)]), rest[len(active.theta) :]
        gate = active.activation
        if edges:
            count = len(gate.variables())
            gate, rest = gate.with_variables(rest[:count]), rest[count:]
        out.append(ActiveEffect(active.effect, inner, gate))
    return out


def inactive_effect(effect: Effect, gate: Activation = ALWAYS_ACTIVE) -> ActiveEffect:
    """Return an effect that does not act."""
    return ActiveEffect(effect, tuple(p.theta_neutral for p in effect.parameters), gate)
