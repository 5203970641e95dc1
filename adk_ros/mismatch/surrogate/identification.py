# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The stand-in of a simulator: the model's parameters identified from the simulation's recording.

Masses and lengths are given; tyres, lags, drag and what the simulator has of them are fitted to
all channels. The observer's gain falls over three rounds, since a direct fit diverges while the
tyres are wrong. A simulation hardly saturates its tyres: what it says nothing of is pulled
weakly to usual values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.mismatch.library.surrogate_parameters import HIGH, INDEX, LOW, SIZE
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm, active_terms_of
from adk_ros.mismatch.surrogate.residuals import ActiveTerms, ResidualProblem
from adk_ros.mismatch.surrogate.road_profile import RoadProfile
from adk_ros.numerics.arrays import FloatArray, IntArray
from adk_ros.numerics.levenberg_marquardt import BoundedParameters, FitResult, minimise

FITTED_PARAMETERS: dict[str, tuple[float, float]] = {
    # name: (usual spread, step of the differences)
    "stiffness_f": (8.0, 0.05),
    "stiffness_r": (8.0, 0.05),
    "shape_f": (0.1, 0.005),
    "shape_r": (0.1, 0.005),
    "curvature_f": (0.4, 0.02),
    "curvature_r": (0.4, 0.02),
    "grip_f": (0.15, 0.005),
    "grip_r": (0.15, 0.005),
    "brush_share": (0.4, 0.03),
    "load_sensitivity": (0.1, 0.005),
    "stiffness_falloff": (0.1, 0.005),
    "combined_slip": (0.3, 0.03),
    "relaxation_length": (0.5, 0.02),
    "roll_share_front": (0.1, 0.01),
    "load_lag": (0.1, 0.005),
    "roll_gradient": (0.01, 2e-4),
    "roll_frequency": (8.0, 0.3),
    "roll_damping": (0.3, 0.02),
    "roll_arm": (0.3, 0.02),
    "pitch_gradient": (0.01, 2e-4),
    "pitch_frequency": (8.0, 0.3),
    "pitch_damping": (0.3, 0.02),
    "load_springs": (0.5, 0.03),
    "torque_split_front": (0.2, 0.02),
    "drag_area": (0.7, 0.02),
    "rolling": (0.015, 0.0005),
    "steer_delay": (0.03, 0.002),
    "steer_lag": (0.05, 0.002),
    "torque_delay": (0.03, 0.002),
    "torque_lag": (0.05, 0.002),
}
_BODY_MOTION_PARAMETERS = (
    "roll_gradient",
    "roll_frequency",
    "roll_damping",
    "roll_arm",
    "pitch_gradient",
    "pitch_frequency",
    "pitch_damping",
    "load_springs",
)
"""
The body on its springs. A simulator without springs leaves all of these open, and nothing comes
of it on any other drive: they do not count among what is unsure.
"""
_MASS_AND_LENGTH_PARAMETERS: dict[str, tuple[float, float]] = {
    "mass": (300.0, 5.0),
    "yaw_inertia": (800.0, 10.0),
    "cg_to_front_axle": (0.2, 0.01),
    "cg_to_rear_axle": (0.2, 0.01),
    "cg_height": (0.06, 0.01),
}
_FIT_BOUNDS: dict[str, tuple[float, float]] = {
    "shape_f": (1.05, 1.9),
    "shape_r": (1.05, 1.9),
    "curvature_f": (-5.0, 0.95),
    "curvature_r": (-5.0, 0.95),
}
"""Bounds of the fit within those of the entries: what is left open may go beyond, smoothly."""
_INITIAL_VALUES = {
    "relaxation_length": 0.2,
    "drag_area": 0.3,
    "load_lag": 0.05,
    "roll_gradient": 0.002,
    "pitch_gradient": 0.002,
}
OBSERVER_GAIN_FACTORS = (10.0, 2.0, 0.5)
"""Factors on the observer's gain."""
RESIDUAL_SUBSAMPLING = 0.25
"""
What is left is the model's own error, not white noise: one sample of it in this many squared is
new. Counted as white it would bend the tyres' shape to explain itself.
"""
_WEAK_DIRECTION_SHARE = 0.1
"""Directions known to less than this share of the usual spread are kept as known."""
_PRIOR_INFLATION = 2.0
_MAX_WEAK_DIRECTIONS = 6
SETTLING_BINS = 25

Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class SurrogateModel:
    """
    Parameters (SIZE,) of the simulator, and how well they meet its recording.

    `error` (6,) is the root mean square of what is left in 40 ms bins, by channel.
    """

    parameters: FloatArray
    error: FloatArray
    residuals: FloatArray
    weak_directions: FloatArray
    """
    (k, SIZE) directions in which the parameters are ill-determined by the simulation, each as
    long as its standard deviation.
    """
    road: RoadProfile | None = None
    """What the simulator has at places, where its recording could not be met without."""
    feature_terms: tuple[FeatureTerm, ...] = ()
    """A correction by features, where even so it could not."""
    augmentation_notes: tuple[str, ...] = field(default=())
    """What was learned of the simulator beyond the model family's parameters, in words."""

    def fixed_terms(self, course: ResidualProblem) -> ActiveTerms:
        """Return what the simulator has along a course besides its parameters."""
        terms = course.no_terms() if self.road is None else self.road.terms(course)
        if not self.feature_terms:
            return terms
        return terms.merged_with(
            active_terms_of(self.feature_terms, course, course.run(self.parameters, terms))
        )


def identify_surrogate(
    course: ResidualProblem,
    start: FloatArray,
    progress: Progress | None = None,
    body_known: bool = True,
) -> SurrogateModel:
    """
    Identify the stand-in on the simulation's course, from a nominal vehicle's parameters.

    Unless `body_known`, masses and lengths are fitted as well.
    """
    guess = start.copy()
    for name, value in _INITIAL_VALUES.items():
        guess[INDEX[name]] = value
    return fit_surrogate(course, start, guess, fitted_parameters(body_known), progress=progress)


def fitted_parameters(body_known: bool) -> dict[str, tuple[float, float]]:
    """Return what is fitted to a simulation: usual spread and step of the differences."""
    return FITTED_PARAMETERS if body_known else FITTED_PARAMETERS | _MASS_AND_LENGTH_PARAMETERS


def fit_surrogate(
    course: ResidualProblem,
    mean: FloatArray,
    guess: FloatArray,
    fitted: Mapping[str, tuple[float, float]],
    rounds: tuple[float, ...] = OBSERVER_GAIN_FACTORS,
    given: ActiveTerms | None = None,
    progress: Progress | None = None,
) -> SurrogateModel:
    """
    Return the stand-in whose entries `fitted` meet a course best, from the vector `guess`.

    They are pulled towards `mean`; `given` is what acts besides the parameters.
    """
    names = list(fitted)
    where = np.array([INDEX[name] for name in names])
    spread = np.array([fitted[name][0] for name in names])
    low = np.array([_FIT_BOUNDS.get(name, (LOW[INDEX[name]],))[0] for name in names])
    high = np.array([_FIT_BOUNDS.get(name, (HIGH[INDEX[name]],))[-1] for name in names])
    step = np.array([fitted[name][1] for name in names])
    weights = simulation_weights(course)
    p = guess.copy()
    unknowns = BoundedParameters(guess[where], low, high, step, mean[where], spread)
    fit = fit_with_annealed_observer(course, p, where, unknowns, weights, progress, rounds, given)
    p[where] = fit.x
    left = course.residuals(p, given)
    error = np.sqrt(np.mean(left[:, SETTLING_BINS:] ** 2, axis=1))
    tyres = np.array([name not in _BODY_MOTION_PARAMETERS for name in names])
    normal = fit.normal[np.ix_(tyres, tyres)]
    # What the model cannot say of the simulator is noise to its parameters as well.
    weighted = (left * weights / RESIDUAL_SUBSAMPLING)[:, SETTLING_BINS:]
    misfit = np.sqrt(max(float(np.mean(weighted**2)), 1.0))
    unsure = _weakly_identified_directions(normal / misfit**2, spread[tyres], where[tyres])
    return SurrogateModel(p, error, left[:, SETTLING_BINS:], unsure)


def simulation_weights(course: ResidualProblem) -> FloatArray:
    """Return the weights (6, bins) of a simulation's residuals: see `COLOURED`."""
    weights = course.weights() * RESIDUAL_SUBSAMPLING
    weights[:, course.bin_s < course.start_s + 1.0] = 0.0
    return weights


def fit_with_annealed_observer(
    course: ResidualProblem,
    vector: FloatArray,
    where: IntArray,
    unknowns: BoundedParameters,
    weights: FloatArray,
    progress: Progress | None = None,
    rounds: tuple[float, ...] = OBSERVER_GAIN_FACTORS,
    given: ActiveTerms | None = None,
) -> FitResult:
    """
    Fit the entries `where` of a parameter vector to a course, with less and less observer.

    `weights` (6, bins) of the residuals; the model's own error is coloured: see `COLOURED`.
    """
    for done, gain in enumerate(rounds, 1):

        def residuals(x: FloatArray, gain: float = gain) -> FloatArray:
            q = vector.copy()
            q[where] = x
            return np.asarray((course.residuals(q, given, gain=gain) * weights).ravel())

        last = done == len(rounds)
        fit = minimise(residuals, unknowns, iterations=8 if last else 5, settled=1e-3)
        unknowns = replace(unknowns, start=fit.x)
        if progress is not None:
            progress(done, len(rounds))
    return fit


def _weakly_identified_directions(
    normal: FloatArray, spread: FloatArray, where: IntArray
) -> FloatArray:
    """Return the ill-determined directions of a fit, from its normal matrix."""
    values, vectors = np.linalg.eigh(normal * np.outer(spread, spread))
    deviation = _PRIOR_INFLATION / np.sqrt(np.maximum(values, 1.0))
    out: list[FloatArray] = []
    for size, vector in zip(deviation, vectors.T, strict=True):
        if size > _WEAK_DIRECTION_SHARE * _PRIOR_INFLATION and len(out) < _MAX_WEAK_DIRECTIONS:
            row = np.zeros(SIZE)
            row[where] = min(size, 1.0) * vector * spread
            out.append(row)
    return np.array(out).reshape(-1, SIZE)
