# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A feature of the drive in one equation, as an effect with one coefficient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.hypothesis import ActiveEffect
from adk_ros.mismatch.library.criteria import FEATURE_ANGLE_BOUND, FEATURE_COEFFICIENT_BOUND
from adk_ros.mismatch.library.effect import Effect, EffectParameter
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import EQUATION_PARAMETERS, STEERING, FeatureTerm
from adk_ros.numerics.arrays import FloatArray

EQUATION_TEXTS = {
    "v_x": "longitudinal acceleration",
    "v_y": "lateral acceleration",
    "yaw_rate": "yaw acceleration",
    STEERING: "road-wheel angle",
}
EQUATION_UNITS = {"v_x": "m/s^2", "v_y": "m/s^2", "yaw_rate": "rad/s^2", STEERING: "rad"}
_SYMBOLS = {STEERING: "road-wheel angle"}
_MIN_RMS = 1e-12
_DIFFERENCE_STEPS = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01, STEERING: 1e-4}


@dataclass(frozen=True)
class FeatureEffect(Effect):
    """
    An effect that adds a feature to an equation, and no member of the catalogue.

    Its coefficient multiplies the feature divided by `scale`, the feature's RMS.
    """

    feature: str = ""
    scale: float = 1.0

    enters: str = ""
    """Equation of the term, a key of `EQUATION_PARAMETERS`."""

    def term(self, coefficient: float, gain: float = 0.0) -> FeatureTerm:
        """Return the term of the feature itself, SI."""
        return FeatureTerm(self.enters, self.feature, float(coefficient / self.scale), gain)


def state_equations(equation: str) -> tuple[str, ...]:
    """Return the state equations that a term in `equation` enters, the most affected first."""
    return ("yaw_rate", "v_y") if equation == STEERING else (equation,)


def added_to(equation: str, terms: str) -> str:
    """Return that `terms` are added to an equation, with the unit."""
    left = _SYMBOLS.get(equation, f"d({equation})/dt")
    return f"{left} += {terms} [{EQUATION_UNITS[equation]}]"


def feature_as_effect(equation: str, feature: str, scale: float = 1.0) -> FeatureEffect:
    """Return a feature in an equation as an effect."""
    bound = FEATURE_ANGLE_BOUND if equation == STEERING else FEATURE_COEFFICIENT_BOUND
    parameter = EffectParameter(
        "coefficient",
        EQUATION_UNITS[equation],
        -bound,
        bound,
        _DIFFERENCE_STEPS[equation],
        0.0,
        {EQUATION_PARAMETERS[equation]: 1.0},
    )
    return FeatureEffect(
        name=f"{equation}:{feature}",
        parameters=(parameter,),
        equations=state_equations(equation),
        equation=feature,
        excitation="",
        feature=feature,
        scale=scale,
        enters=equation,
    )


def active_feature(
    equation: str, feature: str, values: FloatArray, coefficient: float = 0.0
) -> ActiveEffect:
    """Return a feature with `values` (n,) along a recording, and its SI coefficient, as active."""
    scale = max(float(np.sqrt(np.mean(values**2))), _MIN_RMS)
    weight = np.ascontiguousarray(values / scale)
    effect = feature_as_effect(equation, feature, scale)
    return ActiveEffect(effect, (coefficient * scale,), Activation(weight=weight))


def catalogue_effects(effects: Sequence[ActiveEffect]) -> tuple[ActiveEffect, ...]:
    """Return the effects of the catalogue."""
    return tuple(a for a in effects if not isinstance(a.effect, FeatureEffect))


def feature_terms(effects: Sequence[ActiveEffect]) -> tuple[FeatureTerm, ...]:
    """Return the terms of the features with their fitted coefficients, SI."""
    return tuple(a.effect.term(a.theta[0]) for a in effects if isinstance(a.effect, FeatureEffect))
