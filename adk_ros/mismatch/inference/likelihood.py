# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Likelihood of a recording under a surrogate model with effects, over all channels.

Residuals (measured minus simulated, see `surrogate.residuals`) are divided by their noise and
whitened channel by channel (see `whitening`). The noise model includes the surrogate's own error
on the simulation: what the surrogate cannot reproduce of the simulator is no evidence of missing
physics.

Nuisance parameters (see `nuisances`) describe differences that are no mismatch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.counted_bins import stationary_bins, unmeasured_bins
from adk_ros.mismatch.inference.fit_budget import SIMULATION
from adk_ros.mismatch.inference.hypothesis import ActiveEffect, Hypothesis, with_parameters
from adk_ros.mismatch.inference.nuisances import (
    N_FIXED_NUISANCES,
    along_weak_directions,
    bounds,
    deviations,
    steps,
    with_nuisances,
)
from adk_ros.mismatch.inference.whitening import prediction_error_filters
from adk_ros.mismatch.library.catalogue import effects_of
from adk_ros.mismatch.library.criteria import SETTLING_S
from adk_ros.mismatch.library.effect import Effect
from adk_ros.mismatch.recording.sensor_log import MIN_SENSOR_NOISE
from adk_ros.mismatch.surrogate.error_autocovariance import MAX_LAG
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.surrogate.measured_slopes import slope_error_autocovariance
from adk_ros.mismatch.surrogate.passed_noise import passed_noise_autocovariance
from adk_ros.mismatch.surrogate.residuals import (
    DISTANCE_INTERVAL_S,
    ResidualProblem,
)
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import IMU_A_X, N_CHANNELS, ODOMETRY_V_X
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.numerics.arrays import BoolArray, FloatArray
from adk_ros.numerics.filters import causal_filter
from adk_ros.numerics.levenberg_marquardt import (
    BoundedParameters,
    FitOptions,
    huber_values,
    minimise,
)
from adk_ros.signals.score import WHITE_NOISE_VARIANCE_ERROR

_SEGMENT_END_STEP_M = 1.0
_ONSET_STEP_S = 0.1
_ONSET_RANGE_S = 1e4
"""s by which a fit may move an onset: longer than any recording, so in practice unbounded."""
_SEGMENT_END_RANGE_LAPS = 0.5
"""Laps by which a fit may move a segment's boundary."""


@dataclass(frozen=True)
class Likelihood:
    """A recording's residual problem, the surrogate's parameters, and the noise model."""

    problem: ResidualProblem
    parameters: FloatArray
    weights: FloatArray
    """(6, bins) one over the noise of a bin; zero where it does not count."""
    filters: FloatArray
    weak_directions: FloatArray
    """
    (k, SIZE) directions that the simulation determines poorly, one standard deviation long; the
    last are the levels of slopes that the recording measures.
    """
    fixed_terms: ActiveTerms
    """Parameter changes of the surrogate that vary along this recording: road, formula."""
    surrogate_error_share: FloatArray
    """(6,) share of the surrogate's own error in the residual variance, by channel."""
    smooth_error_share: FloatArray
    """(6,) the same without the noise of the simulation's sensors."""
    systematic_error: FloatArray
    """(6, bins) what is known of the surrogate's own error along this recording, SI."""
    until_s: float = np.inf
    unobservable: frozenset[str] = frozenset()
    """
    Names that the recorded channels do not show: effects, features of the drive (see
    `library.features`) and equations (v_x, v_y, yaw_rate).
    """

    @classmethod
    def of(
        cls,
        problem: ResidualProblem,
        surrogate: SurrogateModel,
        until_s: float = np.inf,
        *,
        is_noisy: bool = True,
    ) -> Likelihood:
        """
        Return the likelihood of a recording, or of its part before `until_s`.

        `is_noisy`: whether there is noise that the observer passes on; a simulation has none.
        """
        weights = problem.weights()
        outside = (problem.bin_s < problem.start_s + SETTLING_S) | (problem.bin_s >= until_s)
        outside |= stationary_bins(problem) | unmeasured_bins(problem)
        weights[:, outside | surrogate.bins_beyond(problem)] = 0.0
        terms = surrogate.fixed_terms(problem)
        passed = np.zeros((N_CHANNELS, MAX_LAG + 1))
        if is_noisy:
            passed = passed_noise_autocovariance(problem, surrogate.parameters, terms)
        weak_directions, road = surrogate.weak_directions, problem.log.road
        if road is not None:
            passed += slope_error_autocovariance(problem, surrogate.parameters, terms)
            weak_directions = np.vstack([weak_directions, road.level_directions()])
        filters, shares, smooth_shares = prediction_error_filters(
            surrogate, problem.bin_noise, passed
        )
        return cls(
            problem,
            surrogate.parameters,
            weights,
            filters,
            weak_directions,
            terms,
            shares,
            smooth_shares,
            surrogate.systematic_error(problem),
            until_s,
        )

    def expected_loss(self, residuals: FloatArray, share: float = 1.0) -> float:
        """
        Return an upper estimate of a perfect model's loss.

        One per whitened residual, plus the surrogate error once more: on another route it may be
        twice as large as in the simulation. `share`: of the data from which the residuals come.
        """
        return float(np.count_nonzero(residuals) + share * self.surrogate_error_dof())

    def noise_loss_variance(self) -> float:
        """
        Return the variance that the error of the estimated noise adds to a perfect model's loss.

        A relative error e of the noise variance of a channel changes its loss by n e, of n counted
        residuals whose variance is noise; the sensor's N samples determine it to
        `WHITE_NOISE_VARIANCE_ERROR` / N. Noise at its minimum is not estimated.
        """
        counted = np.count_nonzero(self.weights, axis=1) * (1.0 - self.surrogate_error_share)
        counted[self.problem.sigma <= MIN_SENSOR_NOISE] = 0.0
        samples = np.maximum(self.problem.counts.sum(axis=1), 1.0)
        return float(np.sum(WHITE_NOISE_VARIANCE_ERROR * counted**2 / samples))

    def surrogate_error_dof(self) -> float:
        """Return the number of residuals that the surrogate's own error accounts for."""
        return float(self.surrogate_error_by_channel().sum())

    def surrogate_error_by_channel(self) -> FloatArray:
        """Return that number in each channel (6,)."""
        return np.asarray(self.surrogate_error_share * np.count_nonzero(self.weights, axis=1))

    def losses_by_direction(self, residuals: FloatArray) -> FloatArray:
        """Return the loss (2,) of the longitudinal and of the lateral channels."""
        return _by_direction(huber_values(self._by_channel(residuals)).sum(axis=1))

    def expected_by_direction(self, residuals: FloatArray) -> FloatArray:
        """Return `expected_loss` (2,) of the longitudinal and of the lateral channels."""
        counted = np.count_nonzero(self._by_channel(residuals), axis=1)
        return _by_direction(counted + self.surrogate_error_by_channel())

    def _by_channel(self, residuals: FloatArray) -> FloatArray:
        """Return residuals (6, bins) without the distances travelled."""
        bins = self.weights.shape[1]
        return residuals[: N_CHANNELS * bins].reshape(N_CHANNELS, bins)

    def surrogate_variance_share(self) -> float:
        """
        Return the share of the residuals' variance that is the surrogate's own error.

        Without noise of the simulation's sensors, which does not make an effect's equation wrong.
        """
        counted = np.count_nonzero(self.weights, axis=1)
        return float(self.smooth_error_share @ counted) / max(int(counted.sum()), 1)

    @property
    def effects(self) -> dict[str, Effect]:
        """The catalogue of effects, for a vehicle of this size."""
        return effects_of(scale_of(self.parameters))

    @property
    def n_nuisances(self) -> int:
        """Number of nuisance parameters: tolerances, sensor offsets, weak directions."""
        return N_FIXED_NUISANCES + int(self.weak_directions.shape[0])

    def along_weak_directions(self, nuisances: FloatArray) -> FloatArray:
        """Return the nuisance parameters (k,) of the weakly determined directions."""
        return along_weak_directions(nuisances, self.weak_directions.shape[0])

    def with_nuisances(self, nuisances: FloatArray) -> FloatArray:
        """Return the surrogate's parameters with nuisance parameters applied."""
        return with_nuisances(self.parameters, self.weak_directions, nuisances)

    def simulation_inputs(
        self, nuisances: FloatArray, effects: Sequence[ActiveEffect]
    ) -> tuple[FloatArray, ActiveTerms]:
        """
        Return the parameters and terms of a simulation.

        Effects that are always active change the parameters; the others become changes that vary
        along the recording (`ActiveTerms`).
        """
        base = self.with_nuisances(nuisances)
        p = base.copy()
        fixed = self.fixed_terms
        entries, amounts, rows = list(fixed.entries), list(fixed.amounts), list(fixed.rows)
        activations = list(fixed.activations)
        for active in effects:
            row = 0
            if not active.activation.always:
                activations.append(active.activation.series(self.problem))
                row = len(activations) - 1
            for parameter, theta in zip(active.effect.parameters, active.theta, strict=True):
                for i, size in parameter.amounts(theta, base):
                    if row == 0:
                        p[i] += size
                    else:
                        entries.append(i)
                        amounts.append(size)
                        rows.append(row)
        return p, ActiveTerms(
            np.array(entries, dtype=np.int64),
            np.array(amounts, dtype=np.float64),
            np.array(rows, dtype=np.int64),
            np.array(activations),
        )

    def residuals(self, nuisances: FloatArray, effects: Sequence[ActiveEffect]) -> FloatArray:
        """Return all whitened residuals as one vector, travelled distances last."""
        p, terms = self.simulation_inputs(nuisances, effects)
        e = self.whiten(self.channel_residuals(p, terms))
        return np.concatenate([e.ravel(), self.distance_residuals(p)])

    def channel_residuals(self, parameters: FloatArray, terms: ActiveTerms) -> FloatArray:
        """Return measured minus simulated (6, bins), less the surrogate's known error, SI."""
        return self.problem.residuals(parameters, terms) - self.systematic_error

    def distance_residuals(self, parameters: FloatArray) -> FloatArray:
        """Return the residuals of the distances travelled (w,) that count, over their noise."""
        distances = self.problem.distance_residuals(parameters)
        duration_s = max(0.0, self.until_s - self.problem.start_s)
        keep = int(min(distances.shape[0], duration_s / DISTANCE_INTERVAL_S))
        return distances[:keep]

    def held_out_bins(self) -> BoolArray:
        """Return the bins (b,) after the part that counts, without those that settle."""
        return np.asarray(self.problem.bin_s >= self.until_s + SETTLING_S)

    def whiten(self, residuals: FloatArray) -> FloatArray:
        """Return residuals (6, bins) over their noise, whitened."""
        scaled = residuals * self.weights
        out = np.empty_like(scaled)
        for channel in range(6):
            out[channel] = causal_filter(scaled[channel], self.filters[channel])
        out[self.weights == 0.0] = 0.0
        return out

    def fit(
        self,
        effects: Sequence[ActiveEffect],
        *,
        nuisances: FloatArray | None = None,
        budget: FitOptions = SIMULATION,
        jacobian: FloatArray | None = None,
        fit_activation: bool = False,
    ) -> Hypothesis:
        """
        Fit nuisance parameters and effects jointly, starting from the given values.

        `jacobian` (m, nuisances): fixed derivatives with respect to the nuisance parameters, which
        saves most of the time. With `fit_activation`, onsets and segment boundaries are fitted.
        """
        unknowns = self._unknowns(effects, nuisances, fit_activation)
        k = self.n_nuisances

        def residuals(x: FloatArray) -> FloatArray:
            return self.residuals(x[:k], with_parameters(effects, x[k:], fit_activation))

        fit = minimise(residuals, unknowns, budget, known_columns=jacobian)
        return Hypothesis(
            tuple(with_parameters(effects, fit.x[k:], fit_activation)),
            fit.x[:k].copy(),
            fit.cost,
            fit,
            self.losses_by_direction(fit.residuals),
        )

    def _unknowns(
        self, effects: Sequence[ActiveEffect], nuisances: FloatArray | None, fit_activation: bool
    ) -> BoundedParameters:
        k = self.n_nuisances
        start = list(np.zeros(k) if nuisances is None else nuisances)
        high = list(self.nuisance_bounds())
        low = [-x for x in high]
        step = list(self.nuisance_steps())
        for active in effects:
            for parameter, theta in zip(active.effect.parameters, active.theta, strict=True):
                start.append(theta)
                least, most = parameter.bounds()
                low.append(least)
                high.append(most)
                step.append(parameter.step)
            activation = active.activation
            for value in activation.variables() if fit_activation else ():
                start.append(value)
                local = bool(activation.segments)
                room = _SEGMENT_END_RANGE_LAPS * activation.lap_length if local else _ONSET_RANGE_S
                low.append(value - room)
                high.append(value + room)
                step.append(_SEGMENT_END_STEP_M if local else _ONSET_STEP_S)
        n_free = len(start) - k
        return BoundedParameters(
            np.array(start),
            np.array(low),
            np.array(high),
            np.array(step),
            np.zeros(k + n_free),
            np.concatenate([self.nuisance_deviations(), np.full(n_free, np.inf)]),
        )

    def nuisance_jacobian(self, hypothesis: Hypothesis) -> FloatArray:
        """Return the residuals' derivatives (m, nuisances) with respect to the nuisances."""
        e = self.residuals(hypothesis.nuisances, hypothesis.effects)
        out = np.empty((e.shape[0], self.n_nuisances))
        for j, step in enumerate(self.nuisance_steps()):
            moved = hypothesis.nuisances.copy()
            moved[j] += step
            out[:, j] = (self.residuals(moved, hypothesis.effects) - e) / step
        return out

    def nuisance_steps(self) -> FloatArray:
        """Return the difference steps of the nuisance parameters."""
        return steps(self.weak_directions.shape[0])

    def nuisance_bounds(self) -> FloatArray:
        """Return the symmetric bounds of the nuisance parameters."""
        return bounds(self.weak_directions.shape[0])

    def nuisance_deviations(self) -> FloatArray:
        """Return the prior standard deviations of the nuisance parameters."""
        return deviations(self.weak_directions.shape[0])


def _by_direction(values: FloatArray) -> FloatArray:
    """Return the sums (2,) over the longitudinal and over the lateral channels of (6,)."""
    longitudinal = float(values[[IMU_A_X, ODOMETRY_V_X]].sum())
    return np.array([longitudinal, float(values.sum()) - longitudinal])
