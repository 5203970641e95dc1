# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Identification of the surrogate model from the simulation's recording.

Masses and lengths are given. Tyres, lags, drag and other properties of the simulator are fitted
to all channels by output error. The observer gain falls over three rounds (a homotopy), because a
direct fit diverges while the tyres are far off. A simulation rarely saturates its tyres:
parameters that it does not determine stay near the prior mean.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import (
    HIGH,
    INDEX,
    LOW,
    SURROGATE_PARAMETERS,
)
from adk_ros.mismatch.surrogate.acceleration_envelope import (
    AccelerationEnvelope,
    simulated_accelerations,
)
from adk_ros.mismatch.surrogate.error_autocovariance import ErrorAutocovariance
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm, active_terms_of
from adk_ros.mismatch.surrogate.measured_slopes import slope_terms
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile
from adk_ros.mismatch.surrogate.run_inputs import ActiveTerms
from adk_ros.mismatch.surrogate.state_index import N_CHANNELS
from adk_ros.mismatch.surrogate.substeps import scale_of
from adk_ros.mismatch.surrogate.systematic_error import SystematicError, learn_systematic_error
from adk_ros.mismatch.surrogate.timing_error import timing_error
from adk_ros.mismatch.surrogate.weak_directions import weakly_identified_directions
from adk_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import (
    BoundedParameters,
    FitOptions,
    FitResult,
    minimise,
)
from adk_ros.numerics.similarity import scaled_by_unit, time_scale


class ParameterPrior(NamedTuple):
    """Prior standard deviation of a parameter and its finite-difference step, in its unit."""

    sigma: float
    step: float


FITTED_PARAMETERS: dict[str, ParameterPrior] = {
    "stiffness_f": ParameterPrior(8.0, 0.05),
    "stiffness_r": ParameterPrior(8.0, 0.05),
    "shape_f": ParameterPrior(0.1, 0.005),
    "shape_r": ParameterPrior(0.1, 0.005),
    "curvature_f": ParameterPrior(0.4, 0.02),
    "curvature_r": ParameterPrior(0.4, 0.02),
    "grip_f": ParameterPrior(0.15, 0.005),
    "grip_r": ParameterPrior(0.15, 0.005),
    "brush_share": ParameterPrior(0.4, 0.03),
    "load_sensitivity": ParameterPrior(0.1, 0.005),
    "stiffness_falloff": ParameterPrior(0.1, 0.005),
    "combined_slip": ParameterPrior(0.3, 0.03),
    "relaxation_length": ParameterPrior(0.5, 0.02),
    "roll_share_front": ParameterPrior(0.1, 0.01),
    "load_lag": ParameterPrior(0.1, 0.005),
    "roll_gradient": ParameterPrior(0.01, 2e-4),
    "roll_frequency": ParameterPrior(8.0, 0.3),
    "roll_damping": ParameterPrior(0.3, 0.02),
    "roll_arm": ParameterPrior(0.3, 0.02),
    "pitch_gradient": ParameterPrior(0.01, 2e-4),
    "pitch_frequency": ParameterPrior(8.0, 0.3),
    "pitch_damping": ParameterPrior(0.3, 0.02),
    "load_springs": ParameterPrior(0.5, 0.03),
    "torque_split_front": ParameterPrior(0.2, 0.02),
    "drag_area": ParameterPrior(0.7, 0.02),
    "rolling": ParameterPrior(0.015, 0.0005),
    "steer_delay": ParameterPrior(0.03, 0.002),
    "steer_lag": ParameterPrior(0.05, 0.002),
    "torque_delay": ParameterPrior(0.03, 0.002),
    "torque_lag": ParameterPrior(0.05, 0.002),
}
"""Parameters fitted to every simulation; standard deviations span the range of road cars."""
MASS_AND_LENGTH_PARAMETERS: dict[str, ParameterPrior] = {
    "mass": ParameterPrior(0.19, 0.003),
    "yaw_inertia": ParameterPrior(0.29, 0.004),
    "cg_to_front_axle": ParameterPrior(0.15, 0.008),
    "cg_to_rear_axle": ParameterPrior(0.14, 0.007),
    "cg_height": ParameterPrior(0.11, 0.02),
}
"""
Fitted in addition if they are not known; shares of the assumed value. Of a car of 1600 kg, the
deviations are 300 kg, 800 kg m², 0.2 m, 0.2 m and 0.06 m: those among road cars.
"""
_FIT_BOUNDS: dict[str, tuple[float, float]] = {
    "shape_f": (1.05, 1.9),
    "shape_r": (1.05, 1.9),
    "curvature_f": (-5.0, 0.95),
    "curvature_r": (-5.0, 0.95),
}
"""Bounds of the fit, tighter than those of the parameters: weak directions may exceed them."""
_INITIAL_VALUES = {
    "relaxation_length": 0.2,
    "drag_area": 0.3,
    "load_lag": 0.05,
    "roll_gradient": 0.002,
    "pitch_gradient": 0.002,
}
"""Start of the fit where the prior mean is zero: at zero the residuals have no slope."""
OBSERVER_GAIN_FACTORS = (10.0, 2.0, 0.5)
"""Factors on the observer gain, one per round of the fit."""
RESIDUAL_SUBSAMPLING = 0.25
"""
Weight of a residual relative to white noise. The residuals are mostly model error, which is
correlated: only one sample in 1 / 0.25^2 = 16 is independent. Counted as white noise it would bias
the shape of the tyre curve.
"""
SETTLING_BINS = 25
"""Bins at the start of a recording in which lags and loads settle: 1 s."""
_SETTLING_S = 1.0
"""The same in seconds."""
MAX_SHARE_BEYOND = 0.5
"""
Largest share of a recording that does not count for being driven harder: a result on less than
half of it would not be one of the recording.
"""
_EARLY_ROUND = FitOptions(iterations=5, relative_tolerance=1e-3)
_LAST_ROUND = FitOptions(iterations=8, relative_tolerance=1e-3)

Progress = Callable[[float, float], None]
"""Called with (done, total)."""


@dataclass(frozen=True)
class SurrogateModel:
    """
    Surrogate model of a simulator, with its error on the simulation's recording.

    `parameters` (SIZE,); `error` (6,): RMS of the residuals in 40 ms bins, by channel;
    `residuals` (6, bins) after settling.
    """

    parameters: FloatArray
    error: FloatArray
    residuals: FloatArray
    weak_directions: FloatArray
    """
    (k, SIZE) directions of the parameter space that the simulation identifies weakly, each one
    standard deviation long.
    """
    road: RoadProfile | None = None
    """Road of the simulator, where its recording cannot be reproduced without."""
    feature_terms: tuple[FeatureTerm, ...] = ()
    """Feature terms, where its recording cannot be reproduced otherwise."""
    augmentation_notes: tuple[str, ...] = field(default=())
    """What was identified beyond the parameters, in words."""
    autocovariance: ErrorAutocovariance | None = None
    """Autocovariance of the residuals; for a surrogate from a file, which has no residuals."""
    open_loop_error: FloatArray | None = None
    """(horizons, 3) RMSE of open-loop predictions of the simulation, if it was measured."""
    timing_error: FloatArray | float = 0.0
    """(6, bins) of the residuals, what half a time step changes in them, SI (`timing_error`)."""
    systematic: SystematicError | None = None
    """The error as a function of the driven state, if it was learned."""
    envelope: AccelerationEnvelope | None = None
    """The accelerations that the simulation reaches, if they span an area."""
    deviations: Mapping[str, float] = field(default_factory=dict)
    """Standard deviations of the fitted parameters by name; empty where nothing was fitted."""

    @property
    def unexplained_residuals(self) -> FloatArray:
        """Residuals (6, bins) on the simulation less what is known of them."""
        return self.residuals if self.systematic is None else self.systematic.remaining

    def with_known_driving(self, problem: ResidualProblem) -> SurrogateModel:
        """Return the surrogate with its errors and the envelope of the simulation's `problem`."""
        terms = self.fixed_terms(problem)
        out = problem.run(self.parameters, terms)
        residuals = problem.residuals(self.parameters, terms)
        learned = learn_systematic_error(problem, out, residuals, SETTLING_BINS)
        accelerations = simulated_accelerations(problem, out)[SETTLING_BINS:]
        return replace(
            self,
            systematic=learned,
            timing_error=timing_error(problem, self.parameters, terms, out)[:, SETTLING_BINS:],
            envelope=AccelerationEnvelope.of(accelerations),
        )

    def bins_beyond(
        self, problem: ResidualProblem, friction: FloatArray | None = None
    ) -> BoolArray:
        """
        Return the bins (b,) of a recording that is driven harder than the simulation.

        `friction` (b,): of the road, relative to the simulation's. None, where that is most of the
        recording: what is left would not be what is asked about.
        """
        beyond = self.harder_driving(problem, friction)
        return np.asarray(beyond & (beyond.mean() <= MAX_SHARE_BEYOND))

    def harder_driving(
        self, problem: ResidualProblem, friction: FloatArray | None = None
    ) -> BoolArray:
        """Return the bins (b,) with accelerations that the simulation does not reach."""
        if self.envelope is None:
            return np.zeros(problem.bins, dtype=bool)
        out = problem.run(self.parameters, self.fixed_terms(problem))
        unchanged = np.ones(problem.bins)
        return self.envelope.bins_beyond(problem, out, unchanged if friction is None else friction)

    def systematic_error(self, problem: ResidualProblem) -> FloatArray:
        """Return the known error (6, bins) along a recording: measured minus simulated."""
        if self.systematic is None:
            return np.zeros((N_CHANNELS, problem.bins))
        out = problem.run(self.parameters, self.fixed_terms(problem))
        return self.systematic.along(problem, out)

    def fixed_terms(self, problem: ResidualProblem) -> ActiveTerms:
        """
        Return the terms of the simulator along a recording: road and feature terms.

        A slope that the recording measures takes the place of the simulated road's.
        """
        road, measured = self.road, problem.log.road
        if road is not None and measured is not None:
            road = road.without(measured.entries)
        terms = problem.no_terms() if road is None else road.terms(problem)
        if measured is not None:
            terms = terms.merged_with(slope_terms(measured, problem.middle_s))
        if not self.feature_terms:
            return terms
        out = problem.run(self.parameters, terms)
        return terms.merged_with(active_terms_of(self.feature_terms, problem, out))


def identify_surrogate(
    problem: ResidualProblem,
    start: FloatArray,
    progress: Progress | None = None,
    unknown: Collection[str] = (),
) -> SurrogateModel:
    """
    Identify the surrogate model on the simulation's recording, from nominal parameters `start`.

    `unknown`: masses and lengths that are fitted as well.
    """
    guess = start.copy()
    size = scale_of(start)
    for name, value in _INITIAL_VALUES.items():
        guess[INDEX[name]] = scaled_by_unit(value, SURROGATE_PARAMETERS[name].unit, size)
    return fit_surrogate(
        problem, start, guess, fitted_parameters(unknown, start), progress=progress
    )


def fitted_parameters(unknown: Collection[str], start: FloatArray) -> dict[str, ParameterPrior]:
    """Return the parameters fitted to a simulation from `start` (SIZE,), with their priors."""
    body = {
        name: ParameterPrior(share * float(start[INDEX[name]]), step * float(start[INDEX[name]]))
        for name, (share, step) in MASS_AND_LENGTH_PARAMETERS.items()
        if name in unknown
    }
    return _similar(FITTED_PARAMETERS, scale_of(start)) | body


def _similar(priors: dict[str, ParameterPrior], size: float) -> dict[str, ParameterPrior]:
    """Return the priors of road cars at a scale of lengths; natural frequencies rise with it."""
    if size == 1.0:
        return priors
    out = {}
    for name, prior in priors.items():
        unit = SURROGATE_PARAMETERS[name].unit
        factor = 1.0 / time_scale(size) if unit == "rad/s" else scaled_by_unit(1.0, unit, size)
        out[name] = ParameterPrior(factor * prior.sigma, factor * prior.step)
    return out


def fit_surrogate(
    problem: ResidualProblem,
    mean: FloatArray,
    guess: FloatArray,
    fitted: Mapping[str, tuple[float, float]],
    rounds: tuple[float, ...] = OBSERVER_GAIN_FACTORS,
    fixed_terms: ActiveTerms | None = None,
    progress: Progress | None = None,
) -> SurrogateModel:
    """
    Fit the parameters `fitted` of the surrogate to a recording, from the vector `guess`.

    `fitted` maps names to `ParameterPrior`s; `mean` (SIZE,) is the prior mean; `fixed_terms` act
    in addition to the parameters.
    """
    names = list(fitted)
    index = np.array([INDEX[name] for name in names])
    sigma = np.array([sigma for sigma, _ in fitted.values()])
    step = np.array([step for _, step in fitted.values()])
    low = np.array([_FIT_BOUNDS.get(name, (LOW[INDEX[name]],))[0] for name in names])
    high = np.array([_FIT_BOUNDS.get(name, (HIGH[INDEX[name]],))[-1] for name in names])
    weights = simulation_weights(problem)
    p = guess.copy()
    unknowns = BoundedParameters(guess[index], low, high, step, mean[index], sigma)
    fit = fit_with_annealed_observer(
        problem, p, index, unknowns, weights, progress, rounds, fixed_terms
    )
    p[index] = fit.x
    residuals = problem.residuals(p, fixed_terms)
    settled = residuals[:, SETTLING_BINS:]
    error = np.sqrt(np.mean(settled**2, axis=1))
    # The model error of the surrogate acts as noise on its parameters.
    whitened = (residuals * weights / RESIDUAL_SUBSAMPLING)[:, SETTLING_BINS:]
    misfit = np.sqrt(max(float(np.mean(whitened**2)), 1.0))
    weak = weakly_identified_directions(fit.normal / misfit**2, sigma, names)
    deviations = dict(zip(names, map(float, misfit * fit.deviation()), strict=True))
    return SurrogateModel(p, error, settled, weak, deviations=deviations)


def simulation_weights(problem: ResidualProblem) -> FloatArray:
    """Return the weights (6, bins) of a simulation's residuals, by `RESIDUAL_SUBSAMPLING`."""
    weights = problem.weights() * RESIDUAL_SUBSAMPLING
    weights[:, problem.bin_s < problem.start_s + _SETTLING_S] = 0.0
    return weights


def fit_with_annealed_observer(
    problem: ResidualProblem,
    vector: FloatArray,
    index: IntArray,
    unknowns: BoundedParameters,
    weights: FloatArray,
    progress: Progress | None = None,
    rounds: tuple[float, ...] = OBSERVER_GAIN_FACTORS,
    fixed_terms: ActiveTerms | None = None,
) -> FitResult:
    """
    Fit the entries `index` of a parameter vector, with a lower observer gain in each round.

    `weights` (6, bins) of the residuals; `rounds` are factors on the observer gain.
    """
    for done, gain in enumerate(rounds, 1):

        def residuals(x: FloatArray, gain: float = gain) -> FloatArray:
            q = vector.copy()
            q[index] = x
            return np.asarray((problem.residuals(q, fixed_terms, gain=gain) * weights).ravel())

        fit = minimise(residuals, unknowns, _LAST_ROUND if done == len(rounds) else _EARLY_ROUND)
        unknowns = replace(unknowns, start=fit.x)
        if progress is not None:
            progress(done, len(rounds))
    return fit
