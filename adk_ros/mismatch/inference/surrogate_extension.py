# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Extend the surrogate where vehicle parameters alone underfit the simulation.

Candidates are a road profile (grade and bank along the route), an effect of the catalogue, and a
few features of the drive. The first that fits the simulation is kept, otherwise the best; this
repeats while a further extension removes a third of the misfit. If none helps, the profile also
includes friction. Extensions belong to the surrogate: they act on the recording as well, and are
no findings.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from adk_ros.mismatch.inference.feature_effect import added_to
from adk_ros.mismatch.inference.fit_budget import SIMULATION
from adk_ros.mismatch.inference.forward_selection import select_effects
from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.unmodelled import fit_feature_expansion
from adk_ros.mismatch.library.criteria import (
    EFFECT_PRIOR_SHARE,
    EXTENSION_ERROR_TO_NOISE,
    MAX_EXTENSION_MISFIT,
    MAX_ROAD_MISFIT,
)
from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.search_limits import DOMINANT_EFFECT_MISFIT, MAX_EXTENSION_PASSES
from adk_ros.mismatch.library.sensitivity import decided
from adk_ros.mismatch.library.surrogate_parameters import INDEX, NAMES, SIZE
from adk_ros.mismatch.surrogate.identification import (
    OBSERVER_GAIN_FACTORS,
    SETTLING_BINS,
    SurrogateModel,
    fit_surrogate,
    fitted_parameters,
    simulation_weights,
)
from adk_ros.mismatch.surrogate.residuals import ResidualProblem
from adk_ros.mismatch.surrogate.road_profile import zero_profile
from adk_ros.mismatch.surrogate.road_profile_fit import fit_road_profile
from adk_ros.numerics.arrays import FloatArray
from adk_ros.numerics.levenberg_marquardt import huber_loss

_ROAD_ALTERNATIONS = 3
"""Alternations between the road profile and the parameters."""
_FIRST_ROAD_ROUNDS, _ROAD_ROUNDS = 1, 2
_ROAD_NOTE = "road grade"
_DRIVE_YAW = ("yaw_rate", "drive_torque")
"""Equation and feature of a yaw moment in proportion to the driving torque."""
_SENSOR_BIASES = {"bias_a_x": (0.02, 0.005), "bias_a_y": (0.02, 0.005), "bias_gyro": (5e-4, 2e-4)}
"""Biases of simulated sensors, SI: prior standard deviation, difference step."""


def is_underfit(problem: ResidualProblem, surrogate: SurrogateModel) -> bool:
    """Whether a surrogate does not fit the simulation that it was identified on."""
    return decided(
        lambda ratio: bool(np.any(surrogate.error > ratio * problem.bin_noise)),
        EXTENSION_ERROR_TO_NOISE=EXTENSION_ERROR_TO_NOISE,
    )


def misfit(problem: ResidualProblem, surrogate: SurrogateModel) -> float:
    """Return the mean Huber loss of a surrogate's residuals on the simulation."""
    weighted = surrogate.residuals * simulation_weights(problem)[:, SETTLING_BINS:]
    return huber_loss(weighted) / weighted.size


def augment_surrogate(
    problem: ResidualProblem,
    surrogate: SurrogateModel,
    start: FloatArray,
    unknown: Collection[str] = (),
    progress: Callable[[float, float], None] | None = None,
    along_road: bool = True,
) -> SurrogateModel:
    """
    Return a surrogate with the extensions that it needs to fit the simulation.

    `surrogate` was identified on `problem` from the parameters `start`; `unknown` masses
    and lengths are free as well. `along_road`: also by a road profile, which helps no recording on
    another road.
    """
    extension = _Extension(problem, start, unknown)
    anywhere = (extension.with_effect, extension.with_features)
    stages = (
        (extension.with_slopes, *anywhere, extension.with_friction) if along_road else anywhere
    )
    current = surrogate
    for done in range(MAX_EXTENSION_PASSES):
        best, dominant = current, False
        for i, stage in enumerate(stages):
            if not is_underfit(problem, best):
                return best
            # Friction along a road fits any lateral misfit: only where nothing else helps.
            is_last_resort = stage == extension.with_friction
            if dominant or (is_last_resort and best is not current):
                break
            if progress is not None:
                progress(i + done * len(stages), MAX_EXTENSION_PASSES * len(stages))
            trial = stage(current)
            if decided(
                partial(_leaves_less, misfit(problem, trial), misfit(problem, best)),
                MAX_EXTENSION_MISFIT=MAX_EXTENSION_MISFIT,
            ):
                best = trial
                limit = MAX_EXTENSION_MISFIT * misfit(problem, trial)
                dominant = (
                    stage == extension.with_effect
                    and limit < DOMINANT_EFFECT_MISFIT * misfit(problem, current)
                )
        if best is current:
            break
        current = best
    return current


def _leaves_less(after: float, before: float, share: float) -> bool:
    return after < share * before


def _leaves_more(after: float, before: float, share: float) -> bool:
    return after > share * before


@dataclass(frozen=True)
class _Extension:
    """The simulation's problem, the parameters to start from, and unknown masses and lengths."""

    problem: ResidualProblem
    start: FloatArray
    unknown: Collection[str]

    def with_slopes(self, current: SurrogateModel) -> SurrogateModel:
        """Add grade and bank along the road."""
        return self._with_road(current, ("grade", "bank"))

    def with_friction(self, current: SurrogateModel) -> SurrogateModel:
        """Add grade, bank and friction along the road."""
        return self._with_road(current, ("grade", "bank", "friction"))

    def _with_road(self, current: SurrogateModel, names: tuple[str, ...]) -> SurrogateModel:
        """Fit a road profile and the parameters in alternation."""
        problem = self.problem
        road = zero_profile(problem, names)
        weights = simulation_weights(problem)
        p = current.parameters
        other_terms = replace(current, road=None).fixed_terms(problem)
        for done in range(_ROAD_ALTERNATIONS):
            rounds = _ROAD_ROUNDS if done else _FIRST_ROAD_ROUNDS
            road = fit_road_profile(problem, p, road, weights, other_terms, rounds)
            if done == 0:
                terms = road.terms(problem).merged_with(other_terms)
                residuals = problem.residuals(p, terms)[:, SETTLING_BINS:]
                first_misfit = misfit(problem, replace(current, residuals=residuals))
                before = misfit(problem, current)
                if decided(
                    partial(_leaves_more, first_misfit, before), MAX_ROAD_MISFIT=MAX_ROAD_MISFIT
                ):
                    return current
            refitted = self._refit(replace(current, parameters=p, road=road))
            p = refitted.parameters
        grade, bank = (f"{100.0 * np.tan(x):.1f} %" for x in road.size[:2])
        friction = "" if len(names) < 3 else f", friction that varies by {road.size[2]:.2f}"
        note = f"{_ROAD_NOTE} (RMS {grade}) and bank ({bank}){friction}"
        # The new profile includes that of an earlier pass.
        notes = [text for text in current.augmentation_notes if not text.startswith(_ROAD_NOTE)]
        return replace(refitted, augmentation_notes=(*notes, note))

    def with_effect(self, current: SurrogateModel) -> SurrogateModel:
        """Add one effect of the catalogue, active throughout."""
        likelihood = self._likelihood(current)
        best = select_effects(likelihood, None, max_effects=1).best()
        effects = [active for active in best.effects if active.activation.always]
        if not effects:
            return current
        base = likelihood.with_nuisances(best.nuisances)
        extended = base.copy()
        free: dict[str, tuple[float, float]] = {}
        for active in effects:
            for parameter, theta in zip(active.effect.parameters, active.theta, strict=True):
                for i, size in parameter.amounts(theta, base):
                    extended[i] += size
                    unit = abs(size / (theta - parameter.theta_neutral)) if size else 0.0
                    free[NAMES[i]] = (EFFECT_PRIOR_SHARE * abs(size), unit * parameter.step)
        mean = self.start.copy()
        entries = [INDEX[name] for name in free]
        mean[entries] = extended[entries]
        free = {name: prior for name, prior in free.items() if min(prior) > 0.0}
        refitted = self._refit(replace(current, parameters=extended), mean, free)
        note = f"effects: {', '.join(_effect_text(active) for active in effects)}"
        return replace(refitted, augmentation_notes=(*current.augmentation_notes, note))

    def with_features(self, current: SurrogateModel) -> SurrogateModel:
        """Add features of the drive to the equations."""
        likelihood = self._likelihood(current)
        null = likelihood.fit([], budget=SIMULATION)
        assert null.fit is not None
        expected_loss = likelihood.expected_loss(null.fit.residuals)
        expansion = fit_feature_expansion(
            likelihood, null, expected_loss, max(null.loss - expected_loss, 0.0), parametric=False
        )
        if not expansion.terms:
            return current
        parameters = likelihood.with_nuisances(expansion.hypothesis.nuisances)
        for term in expansion.terms:
            if (term.equation, term.feature) == _DRIVE_YAW:
                # As a parameter it follows the torque that acts, also where effects change that.
                moment = term.coefficient * parameters[INDEX["yaw_inertia"]]
                parameters[INDEX["drive_yaw_moment"]] = moment
        others = [x for x in expansion.terms if (x.equation, x.feature) != _DRIVE_YAW]
        extended = replace(current, parameters=parameters, feature_terms=tuple(others))
        refitted = self._refit(extended)
        parts = [
            added_to(term.equation, f"{term.coefficient:+.3g} {feature(term.feature).expression}")
            for term in expansion.terms
        ]
        note = f"feature terms: {', '.join(parts)}"
        return replace(refitted, augmentation_notes=(*current.augmentation_notes, note))

    def _likelihood(self, current: SurrogateModel) -> Likelihood:
        """
        Return the likelihood of the simulation, with a noise model without surrogate error.

        All fitted parameters are free in it: they have been biased by what is missing.
        """
        fitted = fitted_parameters(self.unknown, self.start)
        directions = np.zeros((len(fitted), SIZE))
        for row, (name, (spread, _)) in zip(directions, fitted.items(), strict=True):
            row[INDEX[name]] = spread
        exact = replace(current, residuals=np.zeros_like(current.residuals))
        likelihood = Likelihood.of(self.problem, exact, is_noisy=False)
        return replace(likelihood, weak_directions=directions)

    def _refit(
        self,
        current: SurrogateModel,
        mean: FloatArray | None = None,
        free: Mapping[str, tuple[float, float]] | None = None,
    ) -> SurrogateModel:
        """Return the surrogate with its parameters, and those in `free`, fitted again."""
        fitted = {**fitted_parameters(self.unknown, self.start), **_SENSOR_BIASES, **(free or {})}
        refitted = fit_surrogate(
            self.problem,
            self.start if mean is None else mean,
            current.parameters,
            fitted,
            OBSERVER_GAIN_FACTORS[-1:],
            current.fixed_terms(self.problem),
        )
        return replace(
            refitted,
            road=current.road,
            feature_terms=current.feature_terms,
            augmentation_notes=current.augmentation_notes,
        )


def _effect_text(active: ActiveEffect) -> str:
    values = ", ".join(f"{name} {value:.3g}" for name, value in active.values().items())
    return f"{active.effect.name} ({values})"
