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

from adk_ros.mismatch.correction import FEATURES, values
from adk_ros.mismatch.effect import Effect, Parameter
from adk_ros.mismatch.gates import Gate
from adk_ros.mismatch.likelihood import Active, Hypothesis, Likelihood
from adk_ros.mismatch.pieces import EQUATIONS, Piece, signals_of
from adk_ros.mismatch.screen import Screen
from adk_ros.mismatch.search import LEAST_OF_OWN
from adk_ros.signals.channels import FloatArray

WORDS = {
    "v_x": "longitudinal acceleration", "v_y": "lateral acceleration",
    "yaw_rate": "yaw acceleration",
}
UNITS = {"v_x": "m/s^2", "v_y": "m/s^2", "yaw_rate": "rad/s^2"}
MARK = "~"
_STEPS = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01}
_MOST = 4
_LEAST_SHARE = 0.08
_LEAST_GAIN = 60.0
_FITTED = 5
_SETTLED = 2
_AHEAD = 0.85
"""Share of the best gain that a feature must have to be fitted anew."""
_ALIKE, _ALIKE_OF_OWN = 20.0, 0.02


@dataclass(frozen=True)
class Remainder:
    """What is left unexplained, and its description; `share` of all that was to be explained."""

    share: float
    pieces: tuple[Piece, ...]
    hypothesis: Hypothesis

    @property
    def equations(self) -> list[str]:
        """Equations that it is in, the most telling first."""
        gains: dict[str, float] = {}
        for piece in self.pieces:
            gains[piece.equation] = gains.get(piece.equation, 0.0) + piece.gain
        top = max(gains.values(), default=0.0)
        order = sorted(gains, key=lambda name: -gains[name])
        return [name for name in order if gains[name] > 0.1 * top]

    def text(self) -> str:
        """Return what depends on what, in words."""
        if not self.pieces:
            return "a structured remainder that depends on none of the features looked at"
        return "; ".join(
            f"{WORDS[p.equation]} against {FEATURES[p.feature].text}" for p in self.pieces
        )

    def expression(self) -> str:
        """Return the expression with its units."""
        parts = []
        for equation in self.equations:
            terms = [
                f"{p.coefficient:+.4g} {FEATURES[p.feature].expression}"
                for p in self.pieces if p.equation == equation
            ]
            parts.append(f"d({equation})/dt += {' '.join(terms)} [{UNITS[equation]}]")
        return "; ".join(parts)


def pseudo(equation: str, feature: str, weight: FloatArray) -> Effect:
    """Return a feature in an equation as if it were an effect."""
    step = _STEPS[equation]
    parameter = Parameter(
        "coefficient", UNITS[equation], -20.0, 20.0, step, 0.0, {EQUATIONS[equation]: 1.0}
    )
    return Effect(f"{MARK}{equation}:{feature}", (parameter,), (equation,), feature, "")


def describe(
    likelihood: Likelihood, start: Hypothesis, noise: float, at_all: float
) -> Remainder:
    """Describe what `start` leaves by as few features as it takes."""
    course = likelihood.course
    p, terms = likelihood.setting(start.tolerances, start.actives)
    out = course.run(p, terms)
    signals = signals_of(course, out)
    names = [name for name in FEATURES if name not in likelihood.beyond]
    table = values(names, signals)
    scale = np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-12)
    known = likelihood.tolerance_columns(start)
    now = start
    left = max(start.cost - noise, 0.0)
    least = max(_LEAST_GAIN + LEAST_OF_OWN * likelihood.own_error(), _LEAST_SHARE * left)
    gains: list[float] = []
    for _ in range(_MOST):
        screen = Screen(likelihood, now, known)
        tried: list[tuple[float, Active]] = []
        for equation in (name for name in EQUATIONS if name not in likelihood.beyond):
            for j, name in enumerate(names):
                gate = Gate(weight=np.ascontiguousarray(table[:, j] / scale[j]))
                effect = pseudo(equation, name, table[:, j])
                if effect.name not in now.names:
                    found = screen.effect(effect, gate)[0]
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
        size = active.inner[0] / scale[names.index(feature)]
        pieces.append(Piece(equation, feature, float(size), gain))
    share = left / at_all if at_all > 0.0 else 0.0
    return Remainder(share, tuple(pieces), now)


def _best_of(
    likelihood: Likelihood, now: Hypothesis, tried: list[tuple[float, Active]], known: FloatArray,
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
        for gain, active in tried[:_FITTED] if gain > max(least, 0.5 * tried[0][0])
    ]
    top = max((now.cost - h.cost for h in fitted), default=0.0)
    if top < least:
        return None
    ahead = sorted((h for h in fitted if now.cost - h.cost > _AHEAD * top), key=lambda h: h.cost)
    settled = [
        likelihood.fit(h.actives, h.tolerances, 4, None, 1e-5) for h in ahead[:_SETTLED]
    ]
    return plainest(settled, _ALIKE + _ALIKE_OF_OWN * likelihood.own_error())


def plainest(fitted: list[Hypothesis], margin: float) -> Hypothesis:
    """Return that with the shortest last feature of those within `margin` of the best."""
    best = min(h.cost for h in fitted)
    alike = [h for h in fitted if h.cost < best + margin]
    return min(alike, key=lambda h: (_terms(h.actives[-1]), h.cost))


def _terms(active: Active) -> int:
    """Return how many factors the feature of a pseudo effect has."""
    expression = FEATURES[active.effect.text].expression
    return len(expression.split()) + expression.count("^")


def without_features(h: Hypothesis) -> tuple[Active, ...]:
    """Return the hypothesis' effects of the catalogue."""
    return tuple(a for a in h.actives if not a.effect.name.startswith(MARK))
