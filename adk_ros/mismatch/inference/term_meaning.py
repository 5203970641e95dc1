# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a feature term means in physical quantities: a mass, a force, a moment, a share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adk_ros.mismatch.library.features import feature
from adk_ros.mismatch.library.parametric_features import (
    GATE,
    RESONANCE,
    WAVE,
    kind_of,
    parsed,
)
from adk_ros.mismatch.surrogate.feature_terms import FeatureTerm

_TORQUES = {
    "torque": "the wheel torque",
    "drive_torque": "the drive torque",
    "brake_torque": "the brake torque",
}
_DIRECTIONS = {("v_x", "a_x"): "fore and aft", ("v_y", "a_y"): "sideways"}


class Body(NamedTuple):
    """Mass in kg, yaw inertia in kg·m² and wheel radius in m of the surrogate."""

    mass: float
    yaw_inertia: float
    wheel_radius: float


def meaning(terms: Sequence[FeatureTerm], body: Body) -> str:
    """Return the meaning of the terms that have one, in words; empty if none has."""
    return "; ".join(text for text in (_meaning(term, body) for term in terms) if text)


def _meaning(term: FeatureTerm, body: Body) -> str:
    kind = kind_of(term.feature)
    if kind == RESONANCE:
        return _moving_mass(term, body)
    base, where = term.feature, ""
    if kind == GATE:
        base = parsed(term.feature)[1][0]
        where = feature(term.feature).description.removeprefix(feature(base).description)
    if base in _TORQUES and term.equation == "v_x":
        # dv_x/dt = torque / (mass radius): the coefficient is a share of that.
        share = 100.0 * term.coefficient * body.mass * body.wheel_radius
        side = "less" if share < 0.0 else "more"
        return f"{_TORQUES[base]} is about {abs(share):.0f} % {side}{where}"
    if kind == WAVE or base == "constant":
        return f"{_force(term, body)}{_oscillation(term)}{where}"
    return ""


def _moving_mass(term: FeatureTerm, body: Body) -> str:
    signal, frequency, damping = parsed(term.feature)[1]
    direction = _DIRECTIONS.get((term.equation, signal))
    if direction is None or term.coefficient >= 0.0:
        return ""
    moving = abs(term.coefficient) * body.mass
    return (
        f"a mass of about {_two_digits(moving)} kg moves {direction} at {float(frequency):.2g} Hz "
        f"with a damping ratio of {float(damping):.2g}"
    )


def _force(term: FeatureTerm, body: Body) -> str:
    if term.equation == "yaw_rate":
        return f"a yaw moment of about {_two_digits(abs(term.coefficient) * body.yaw_inertia)} N·m"
    direction = "longitudinal" if term.equation == "v_x" else "lateral"
    return f"a {direction} force of about {_two_digits(abs(term.coefficient) * body.mass)} N"


def _oscillation(term: FeatureTerm) -> str:
    if kind_of(term.feature) != WAVE:
        return ""
    words = feature(term.feature).description
    return f" that oscillates {words.removeprefix('an oscillation ')}"


def _two_digits(value: float) -> str:
    """Return a value to two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
