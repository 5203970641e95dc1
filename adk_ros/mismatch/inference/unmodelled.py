# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A remainder that no effect explains: which equation it is in, and what it depends on.

Features of the drive (`correction`) times a coefficient are added to the accelerations of the
three equations, one after the other, as long as each gains enough; all is orthogonal to the build
tolerances and to the effects that were found. The result is a short expression, and a small smooth
correction of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adk_ros.mismatch.inference.forward_selection import MIN_GAIN_PER_SURROGATE_ERROR
from adk_ros.mismatch.inference.likelihood import ActiveEffect, Hypothesis, Likelihood
from adk_ros.mismatch.inference.score_test import LinearisedProblem
from adk_ros.mismatch.library.effect import Effect, EffectParameter
from adk_ros.mismatch.library.features import FEATURES, feature_matrix
from adk_ros.mismatch.surrogate.activation import Activation
from adk_ros.mismatch.surrogate.feature_terms import (
    EQUATION_PARAMETERS,
    FeatureTerm,
    feature_signals,
)
from adk_ros.numerics.arrays import FloatArray

EQUATION_TEXTS = {
    "v_x": "longitudinal acceleration",
    "v_y": "lateral acceleration",
    "yaw_rate": "yaw acceleration",
}
EQUATION_UNITS = {"v_x": "m/s^2", "v_y": "m/s^2", "yaw_rate": "rad/s^2"}
MARK = "~"
_DIFFERENCE_STEPS = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01}
_MAX_FEATURES = 4
_MIN_GAIN_PER_EXCESS = 0.08
_MIN_GAIN = 60.0
_MAX_FITTED = 5
_MAX_REFITS = 2
_REFIT_GAIN_SHARE = 0.85
"""Share of the best gain that a feature must have to be fitted anew."""
_TIE_LOSS, _TIE_LOSS_PER_SURROGATE_ERROR = 20.0, 0.02


@dataclass(frozen=True)
class UnmodelledDynamics:
    """What is left unexplained, and its description; `share` of all that was to be explained."""

    share: float
    terms: tuple[FeatureTerm, ...]
    hypothesis: Hypothesis

    @property
    def equations(self) -> list[str]:
        """Equations that it is in, the most telling first."""
        gains: dict[str, float] = {}
        for piece in self.terms:
            gains[piece.equation] = gains.get(piece.equation, 0.0) + piece.gain
        top = max(gains.values(), default=0.0)
        order = sorted(gains, key=lambda name: -gains[name])
        return [name for name in order if gains[name] > 0.1 * top]

    def text(self) -> str:
        """Return what depends on what, in words."""
        if not self.terms:
            return "a structured remainder that depends on none of the features looked at"
        return "; ".join(
            f"{EQUATION_TEXTS[p.equation]} against {FEATURES[p.feature].description}"
            for p in self.terms
        )

    def expression(self) -> str:
        """Return the expression with its units."""
        parts = []
        for equation in self.equations:
            terms = [
                f"{p.coefficient:+.4g} {FEATURES[p.feature].expression}"
                for p in self.terms
                if p.equation == equation
            ]
            parts.append(f"d({equation})/dt += {' '.join(terms)} [{EQUATION_UNITS[equation]}]")
        return "; ".join(parts)


def feature_as_effect(equation: str, feature: str, weight: FloatArray) -> Effect:
    """Return a feature in an equation as if it were an effect."""
    step = _DIFFERENCE_STEPS[equation]
    parameter = EffectParameter(
        "coefficient",
        EQUATION_UNITS[equation],
        -20.0,
        20.0,
        step,
        0.0,
        {EQUATION_PARAMETERS[equation]: 1.0},
    )
    return Effect(f"{MARK}{equation}:{feature}", (parameter,), (equation,), feature, "")


def fit_feature_expansion(
    likelihood: Likelihood, start: Hypothesis, noise: float, at_all: float
) -> UnmodelledDynamics:
    """Describe what `start` leaves by as few features as it takes."""
    course = likelihood.problem
    p, terms = likelihood.simulation_inputs(start.tolerances, start.actives)
    out = course.run(p, terms)
    signals = feature_signals(course, out)
    names = [name for name in FEATURES if name not in likelihood.unobservable]
    table = feature_matrix(names, signals)
    scale = np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-12)
    known = likelihood.nuisance_jacobian(start)
    now = start
    left = max(start.cost - noise, 0.0)
    least = max(
        _MIN_GAIN + MIN_GAIN_PER_SURROGATE_ERROR * likelihood.surrogate_error_dof(),
        _MIN_GAIN_PER_EXCESS * left,
    )
    gains: list[float] = []
    for _ in range(_MAX_FEATURES):
        screen = LinearisedProblem(likelihood, now, known)
        tried: list[tuple[float, ActiveEffect]] = []
        for equation in (
            name for name in EQUATION_PARAMETERS if name not in likelihood.unobservable
        ):
            for j, name in enumerate(names):
                gate = Activation(weight=np.ascontiguousarray(table[:, j] / scale[j]))
                effect = feature_as_effect(equation, name, table[:, j])
                if effect.name not in now.names:
                    found = screen.screen_effect(effect, gate)[0]
                    tried.append((found.gain, found.active))
        more = _best_of(likelihood, now, tried, known, least)
        if more is None:
            break
        gains.append(now.cost - more.cost)
        now = more
        if now.cost - noise < 0.03 * left:
            break
    pieces = []
    own = [a for a in now.actives if a.effect.name.startswith(MARK)]
    for active, gain in zip(own, gains, strict=True):
        equation, feature = active.effect.name.removeprefix(MARK).split(":")
        size = active.theta[0] / scale[names.index(feature)]
        pieces.append(FeatureTerm(equation, feature, float(size), gain))
    share = left / at_all if at_all > 0.0 else 0.0
    return UnmodelledDynamics(share, tuple(pieces), now)


def _best_of(
    likelihood: Likelihood,
    now: Hypothesis,
    tried: list[tuple[float, ActiveEffect]],
    known: FloatArray,
    least: float,
) -> Hypothesis | None:
    """
    Return the hypothesis with the best feature more, or None where none gains `least`.

    A linear gain is a guess where much is missing: the best few are fitted, and those ahead anew
    with derivatives of their own, since build tolerances are slow to give back what they took.
    Of those that gain as much, but for what chance and the stand-in's own error may do, the
    plainest is taken.
    """
    tried.sort(key=lambda x: -x[0])
    fitted = [
        likelihood.fit([*now.actives, active], now.tolerances, 20, known, 1e-6)
        for gain, active in tried[:_MAX_FITTED]
        if gain > max(least, 0.5 * tried[0][0])
    ]
    top = max((now.cost - h.cost for h in fitted), default=0.0)
    if top < least:
        return None
    ahead = sorted(
        (h for h in fitted if now.cost - h.cost > _REFIT_GAIN_SHARE * top), key=lambda h: h.cost
    )
    settled = [likelihood.fit(h.actives, h.tolerances, 4, None, 1e-5) for h in ahead[:_MAX_REFITS]]
    return most_parsimonious(
        settled, _TIE_LOSS + _TIE_LOSS_PER_SURROGATE_ERROR * likelihood.surrogate_error_dof()
    )


def most_parsimonious(fitted: list[Hypothesis], margin: float) -> Hypothesis:
    """Return that with the shortest last feature of those within `margin` of the best."""
    best = min(h.cost for h in fitted)
    alike = [h for h in fitted if h.cost < best + margin]
    return min(alike, key=lambda h: (_complexity(h.actives[-1]), h.cost))


def _complexity(active: ActiveEffect) -> int:
    """Return how many factors the feature of a pseudo effect has."""
    expression = FEATURES[active.effect.equation].expression
    return len(expression.split()) + expression.count("^")


def catalogue_effects(h: Hypothesis) -> tuple[ActiveEffect, ...]:
    """Return the hypothesis' effects of the catalogue."""
    return tuple(a for a in h.actives if not a.effect.name.startswith(MARK))
