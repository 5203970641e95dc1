# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a feature term means in physical quantities: a mass, a force, a moment, a share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from adk_ros.mismatch.library.features import feature, readable
from adk_ros.mismatch.library.parametric_features import (
    DECAY,
    DRIFT,
    EXCESS,
    FILTERED_SIGNALS,
    GATE,
    HEAT,
    HYSTERESIS,
    LAG,
    PULSATION,
    RESONANCE,
    RIPPLE,
    SPEED_WAVE,
    TIME,
    WAVE,
    base_of,
    kind_of,
    parsed,
)
from adk_ros.mismatch.surrogate.feature_terms import STEERING, FeatureTerm

_TORQUES = {
    "torque": "the wheel torque",
    "drive_torque": "the drive torque",
    "brake_torque": "the brake torque",
}
_DIRECTIONS = {("v_x", "a_x"): "fore and aft", ("v_y", "a_y"): "sideways"}
_REFERENCE_SPEED = 20.0
"""m/s at which a force that rises with the speed squared is stated."""
_TURN_TOLERANCE = 0.03
"""
Largest relative difference of a wavelength from the wheel's circumference: tyres roll on a radius
about 2 % below the unloaded one, and slip.
"""
_PER_TURN = {1: "once", 2: "twice", 3: "three times"}
_MAX_SHARE = 100.0
"""% above which the final value of a drift lies outside the data: its rate is stated instead."""


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
    base = base_of(term.feature) or term.feature
    if kind in _SPECIAL:
        return _SPECIAL[kind](term, body)
    where = ""
    if kind in {GATE, EXCESS}:
        where = feature(term.feature).description.removeprefix(feature(base).description)
    if base == "delta" and term.equation == STEERING:
        share = 100.0 * term.coefficient
        side = "less" if share < 0.0 else "more"
        return f"the road wheels turn by about {_two_digits(abs(share))} % {side}{where}"
    if base in _TORQUES and term.equation == "v_x":
        share = _torque_share(term, body)
        side = "less" if share < 0.0 else "more"
        return f"{_TORQUES[base]} is about {_two_digits(abs(share))} % {side}{where}"
    if kind == WAVE or base == "constant":
        return f"{_force(term, body)}{_oscillation(term)}{where}"
    return ""


def _torque_share(term: FeatureTerm, body: Body) -> float:
    """Return the change of a torque in %: dv_x/dt = torque / (mass radius)."""
    return 100.0 * term.coefficient * body.mass * body.wheel_radius


def _passed_share(term: FeatureTerm, body: Body) -> str:
    """Return which share of torque or steering acts in addition, with a memory; or nothing."""
    signal, *memory = parsed(term.feature)[1]
    if (term.equation, signal) == ("v_x", "torque"):
        share, words = _torque_share(term, body), "the wheel torque"
    elif (term.equation, signal) == (STEERING, "delta"):
        share, words = 100.0 * term.coefficient, "the steering angle"
    else:
        return ""
    size = f"{_two_digits(abs(share))} % {'less' if share < 0.0 else 'more'} of {words} acts"
    if kind_of(term.feature) == LAG:
        return f"about {size}, with a lag of {float(memory[0]):.2g} s"
    return (
        f"about {size}, through a spring that oscillates at {float(memory[0]):.2g} Hz with a "
        f"damping ratio of {float(memory[1]):.2g}"
    )


def _moving_mass(term: FeatureTerm, body: Body) -> str:
    signal, frequency, damping = parsed(term.feature)[1]
    direction = _DIRECTIONS.get((term.equation, signal))
    if direction is None or term.coefficient >= 0.0:
        return _passed_share(term, body)
    moving = abs(term.coefficient) * body.mass
    return (
        f"a mass of about {_two_digits(moving)} kg moves {direction} at {float(frequency):.2g} Hz "
        f"with a damping ratio of {float(damping):.2g}"
    )


def _friction(term: FeatureTerm, body: Body) -> str:
    """Return a hysteresis as the force at which the dry friction yields."""
    signal, width = parsed(term.feature)[1]
    words, _, unit = FILTERED_SIGNALS[signal]
    return (
        f"{_force(term, body, float(width))} that changes sign only after the {words} has "
        f"reversed by {_two_digits(2.0 * float(width))} {readable(unit)}, as with play or dry "
        "friction"
    )


def _wear(term: FeatureTerm, body: Body) -> str:
    """Return how a torque or a force changes with time or braking work."""
    base, variable, scale = parsed(term.feature)[1]
    # Braking work over the wheel radius is in J.
    unit, size = (" s", 1.0) if variable == TIME else (" MJ of braking work", 1e-6)
    final = float(scale) * size / (1.0 if variable == TIME else body.wheel_radius)
    half = f"{_two_digits(math.log(2.0) * final)}{unit}"
    fades = kind_of(term.feature) == DECAY
    if base in _TORQUES and term.equation == "v_x":
        share = _torque_share(term, body)
        if fades:
            side = "less" if share < 0.0 else "more"
            first = _two_digits(abs(share))
            return f"{_TORQUES[base]} is at first {first} % {side}, half of it after {half}"
        verb = f"{_TORQUES[base]} {'loses' if share < 0.0 else 'gains'}"
        if abs(share) > _MAX_SHARE:
            per = "minute" if variable == TIME else "MJ of braking work"
            rate = abs(share) / final * (60.0 if variable == TIME else 1.0)
            return f"{verb} {_two_digits(rate)} % per {per}"
        return f"{verb} {0.5 * abs(share):.0f} % after {half}, and at most {abs(share):.0f} %"
    if base == "constant":
        verb = "fades" if fades else "builds up"
        return f"{_force(term, body)} that {verb}, half of it after {half}"
    return ""


def _pulsating(term: FeatureTerm, body: Body) -> str:
    """Return a torque that oscillates in time."""
    frequency, _, base = parsed(term.feature)[1]
    if base not in _TORQUES or term.equation != "v_x":
        return ""
    share = _two_digits(abs(_torque_share(term, body)))
    return f"{_TORQUES[base]} varies by ±{share} % at {float(frequency):.3g} Hz"


def _per_speed(term: FeatureTerm, body: Body) -> str:
    """Return an oscillation with the speed."""
    period, _, base = parsed(term.feature)[1]
    if base != "constant":
        return ""
    return f"{_force(term, body)} that changes its sign every {0.5 * float(period):.2g} m/s"


def _fading(term: FeatureTerm, body: Body) -> str:
    """Return how a torque changes with the recent braking power."""
    base, tau = parsed(term.feature)[1]
    if base not in _TORQUES or term.equation != "v_x":
        return ""
    # 10 kW are 1e4 N m^2/s times the wheel radius.
    share = _torque_share(term, body) * 1e4 * body.wheel_radius
    verb = "loses" if share < 0.0 else "gains"
    return (
        f"{_TORQUES[base]} {verb} {_two_digits(abs(share))} % per 10 kW of braking power, "
        f"averaged over {float(tau):.2g} s"
    )


def _per_distance(term: FeatureTerm, body: Body) -> str:
    """Return an oscillation with distance, and how often it is in a turn of the wheel."""
    wavelength, _, base = parsed(term.feature)[1]
    turns = 2.0 * math.pi * body.wheel_radius / float(wavelength)
    nearest = round(turns)
    often = ""
    if nearest in _PER_TURN and abs(turns / nearest - 1.0) < _TURN_TOLERANCE:
        often = f", {_PER_TURN[nearest]} per turn of the wheel"
    every = f"every {float(wavelength):.3g} m{often}"
    if base in _TORQUES and term.equation == "v_x":
        share = abs(_torque_share(term, body))
        return f"{_TORQUES[base]} varies by ±{_two_digits(share)} % {every}"
    if base == "speed_squared":
        at_speed = _force(term, body, _REFERENCE_SPEED**2)
        return f"{at_speed} at {_REFERENCE_SPEED:g} m/s that oscillates {every}"
    return f"{_force(term, body)} that oscillates {every}" if base == "constant" else ""


_SPECIAL: dict[str, Callable[[FeatureTerm, Body], str]] = {
    RESONANCE: _moving_mass,
    LAG: _passed_share,
    HYSTERESIS: _friction,
    DRIFT: _wear,
    DECAY: _wear,
    PULSATION: _pulsating,
    HEAT: _fading,
    RIPPLE: _per_distance,
    SPEED_WAVE: _per_speed,
}


def _force(term: FeatureTerm, body: Body, size: float = 1.0) -> str:
    """Return the force or moment of a term at a feature of `size`."""
    amount = abs(term.coefficient) * size
    if term.equation == STEERING:
        return f"a road-wheel angle of about {_two_digits(math.degrees(amount))}°"
    if term.equation == "yaw_rate":
        return f"a yaw moment of about {_two_digits(amount * body.yaw_inertia)} N·m"
    direction = "longitudinal" if term.equation == "v_x" else "lateral"
    return f"a {direction} force of about {_two_digits(amount * body.mass)} N"


def _oscillation(term: FeatureTerm) -> str:
    if kind_of(term.feature) != WAVE:
        return ""
    words = feature(term.feature).description
    return f" that oscillates {words.removeprefix('an oscillation ')}"


def _two_digits(value: float) -> str:
    """Return a value to two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
