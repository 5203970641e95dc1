# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a simulator has beyond the model family: learned where its recording is not met without.

Slopes of its road by place; effects of the catalogue that are the simulator's own; a few features
of the drive. The first that meets the recording is taken, else what leaves least by far, and then
again, while that takes a third of the misfit; where nothing does, the road's grip by place. All of
it belongs to the stand-in, and acts on the recording alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from adk_ros.mismatch.inference.forward_selection import select_effects
from adk_ros.mismatch.inference.likelihood import Likelihood
from adk_ros.mismatch.inference.unmodelled import EQUATION_UNITS, fit_feature_expansion
from adk_ros.mismatch.library.features import FEATURES
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

MAX_ERROR_TO_NOISE = 4.0
"""A simulation is missed where a channel's error is more than this many times a bin's noise."""
_MAX_KEPT_MISFIT = 0.67
"""Share of the misfit that may be left for something learned to be kept."""
_DOMINANT_EFFECT_MISFIT = 0.2
"""An effect that leaves no more than this share of the misfit needs no rival."""
_MAX_STAGE_PASSES = 3
_MAX_ROAD_MISFIT = 0.85
"""Share of the misfit that a road's first fit may leave for it to be fitted on."""
_ALTERNATIONS, _ROUNDS = 3, 2
_EFFECT_PRIOR_SHARE = 0.5
"""Usual spread of an effect of the simulator's own about what it was found with, as a share."""
_BIASES = {"bias_a_x": (0.02, 0.005), "bias_a_y": (0.02, 0.005), "bias_gyro": (5e-4, 2e-4)}
"""What a simulated sensor may be off by: usual spread, step of the differences."""

Stage = Callable[[ResidualProblem, SurrogateModel, FloatArray, bool], SurrogateModel]


def is_underfit(course: ResidualProblem, stand_in: SurrogateModel) -> bool:
    """Whether a stand-in fails to meet the simulation that it was identified on."""
    return bool(np.any(stand_in.error > MAX_ERROR_TO_NOISE * course.bin_noise))


def augment_surrogate(
    course: ResidualProblem,
    plain: SurrogateModel,
    start: FloatArray,
    body_known: bool = True,
    progress: Callable[[float, float], None] | None = None,
) -> SurrogateModel:
    """
    Return a stand-in with what it takes besides its parameters to meet the simulation's course.

    `plain` is the stand-in identified there, `start` the vector that it was identified from.
    """
    now = plain
    for turn in range(_MAX_STAGE_PASSES):
        best, least, named = now, _MAX_KEPT_MISFIT * misfit(course, now), False
        for done, stage in enumerate(_STAGES):
            if not is_underfit(course, best):
                return best
            # The grip along a road bends to whatever is lateral: only where nothing else helps.
            if named or (stage is _with_grip and best is not now):
                break
            if progress is not None:
                progress(done + turn * len(_STAGES), _MAX_STAGE_PASSES * len(_STAGES))
            tried = stage(course, now, start, body_known)
            if misfit(course, tried) < least:
                best, least = tried, _MAX_KEPT_MISFIT * misfit(course, tried)
                named = stage is _with_effects and least < _DOMINANT_EFFECT_MISFIT * misfit(
                    course, now
                )
        if best is now:
            break
        now = best
    return now


def misfit(course: ResidualProblem, stand_in: SurrogateModel) -> float:
    """Return the Huber loss of what a stand-in leaves of a simulation, a residual."""
    weighted = stand_in.residuals * simulation_weights(course)[:, SETTLING_BINS:]
    return huber_loss(weighted) / weighted.size


def _with_slopes(
    course: ResidualProblem, now: SurrogateModel, start: FloatArray, body_known: bool
) -> SurrogateModel:
    return _with_road(course, now, start, body_known, ("grade", "bank"))


def _with_grip(
    course: ResidualProblem, now: SurrogateModel, start: FloatArray, body_known: bool
) -> SurrogateModel:
    return _with_road(course, now, start, body_known, ("grade", "bank", "friction"))


def _with_road(
    course: ResidualProblem,
    now: SurrogateModel,
    start: FloatArray,
    body_known: bool,
    names: tuple[str, ...],
) -> SurrogateModel:
    """Return the stand-in with curves along the road, its parameters fitted anew beside them."""
    road = zero_profile(course, names)
    weights = simulation_weights(course)
    p = now.parameters
    besides = replace(now, road=None).fixed_terms(course)
    for turn in range(_ALTERNATIONS):
        road = fit_road_profile(course, p, road, weights, besides, _ROUNDS if turn else 1)
        if turn == 0:
            left = course.residuals(p, road.terms(course).merged_with(besides))[:, SETTLING_BINS:]
            if misfit(course, replace(now, residuals=left)) > _MAX_ROAD_MISFIT * misfit(
                course, now
            ):
                return now
        again = _refit(course, replace(now, parameters=p, road=road), start, body_known)
        p = again.parameters
    slope, lean = (f"{100.0 * np.tan(x):.1f} %" for x in road.size[:2])
    grip = "" if len(names) < 3 else f", its grip varies by {road.size[2]:.2f}"
    said = f"a road that climbs (RMS {slope}) and leans ({lean}){grip}"
    # What was learned of an earlier road is in this one.
    before = [text for text in now.augmentation_notes if not text.startswith("a road")]
    return replace(again, augmentation_notes=(*before, said))


def _with_effects(
    course: ResidualProblem, now: SurrogateModel, start: FloatArray, body_known: bool
) -> SurrogateModel:
    """Return the stand-in with one more effect of the catalogue, acting throughout."""
    likelihood = _simulation_likelihood(course, now, body_known)
    best = select_effects(likelihood, None, most=1).best()
    actives = [active for active in best.actives if active.activation.always]
    if not actives:
        return now
    base = likelihood.with_nuisances(best.tolerances)
    held = base.copy()
    open_: dict[str, tuple[float, float]] = {}
    for active in actives:
        for parameter, inner in zip(active.effect.parameters, active.theta, strict=True):
            for i, size in parameter.amounts(inner, base):
                held[i] += size
                unit = abs(size / (inner - parameter.theta_neutral)) if size else 0.0
                open_[NAMES[i]] = (_EFFECT_PRIOR_SHARE * abs(size), unit * parameter.step)
    has = [
        f"{active.effect.name} ({', '.join(f'{k} {v:.3g}' for k, v in active.values().items())})"
        for active in actives
    ]
    mean = start.copy()
    where = [INDEX[name] for name in open_]
    mean[where] = held[where]
    own = {name: both for name, both in open_.items() if min(both) > 0.0}
    again = _refit(course, replace(now, parameters=held), mean, body_known, own)
    return replace(
        again,
        augmentation_notes=(*now.augmentation_notes, f"effects of its own: {', '.join(has)}"),
    )


def _with_features(
    course: ResidualProblem, now: SurrogateModel, start: FloatArray, body_known: bool
) -> SurrogateModel:
    """Return the stand-in with features of the drive in its equations."""
    likelihood = _simulation_likelihood(course, now, body_known)
    nothing = likelihood.fit([])
    assert nothing.fit is not None
    noise = likelihood.expected_loss(nothing.fit.residuals)
    rest = fit_feature_expansion(likelihood, nothing, noise, max(nothing.cost - noise, 0.0))
    if not rest.terms:
        return now
    tolerances = rest.hypothesis.tolerances
    with_pieces = replace(
        now, parameters=likelihood.with_nuisances(tolerances), feature_terms=rest.terms
    )
    again = _refit(course, with_pieces, start, body_known)
    parts = [
        f"{piece.coefficient:+.3g} {FEATURES[piece.feature].expression} in d({piece.equation})/dt"
        f" [{EQUATION_UNITS[piece.equation]}]"
        for piece in rest.terms
    ]
    return replace(
        again,
        augmentation_notes=(*now.augmentation_notes, f"a smooth correction: {', '.join(parts)}"),
    )


def _simulation_likelihood(
    course: ResidualProblem, now: SurrogateModel, body_known: bool
) -> Likelihood:
    """
    Return the likelihood of the simulation itself, whose model owes it no error.

    All of the family's parameters are open in it: they have bent to imitate what is missing.
    """
    family = fitted_parameters(body_known)
    unsure = np.zeros((len(family), SIZE))
    for row, (name, (spread, _)) in zip(unsure, family.items(), strict=True):
        row[INDEX[name]] = spread
    plain = replace(now, residuals=np.zeros_like(now.residuals))
    return replace(Likelihood.of(course, plain), weak_directions=unsure)


def _refit(
    course: ResidualProblem,
    now: SurrogateModel,
    start: FloatArray,
    body_known: bool,
    own: Mapping[str, tuple[float, float]] | None = None,
) -> SurrogateModel:
    """Return the stand-in with the family's parameters fitted anew, and `own`; the rest kept."""
    fitted_anew = {**fitted_parameters(body_known), **_BIASES, **(own or {})}
    again = fit_surrogate(
        course,
        start,
        now.parameters,
        fitted_anew,
        OBSERVER_GAIN_FACTORS[-1:],
        now.fixed_terms(course),
    )
    return replace(
        again,
        road=now.road,
        feature_terms=now.feature_terms,
        augmentation_notes=now.augmentation_notes,
    )


_STAGES: tuple[Stage, ...] = (_with_slopes, _with_effects, _with_features, _with_grip)
