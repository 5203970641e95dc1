# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Remove a known term from a surrogate model of a real car, and ask `adk mismatch` what is missing.

Nobody knows what a simulation of a real car lacks. So a surrogate model is calibrated on the first
part of a recording, one term is taken out of it, and it is the simulation of the rest: the term
must be named with its size. With nothing removed, nothing may be named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from adk_ros.bench.real.calibrated_model import (
    ModelOutcome,
    Sentence,
    between,
    calibrated_model,
    claims,
    middle_of_driving,
)
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import IdentifiedEffect, Interval, MismatchResult
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel

CALIBRATION_SHARE = 0.6
"""Share of a recording on which the surrogate model is calibrated, as in `adk bench paper`."""


@dataclass(frozen=True)
class Term:
    """
    A term of a model of the car and how much of it is removed.

    `effect` of the catalogue that has to supply it, with `parameter`; the simulation's `entry` of
    the parameter vector is `factor` times the car's, less `amount`. `neutral`: the effect's
    parameter without a difference.
    """

    effect: str
    parameter: str
    entry: str
    factor: float = 1.0
    amount: float = 0.0
    neutral: float = 0.0

    def out_of(self, car: SurrogateModel) -> SurrogateModel:
        """Return the surrogate without the term."""
        p = car.parameters.copy()
        p[INDEX[self.entry]] = self.factor * p[INDEX[self.entry]] - self.amount
        return replace(car, parameters=p)

    def expected(self, car: SurrogateModel) -> float:
        """Return the size that the effect must have."""
        value = float(car.parameters[INDEX[self.entry]])
        if self.entry.startswith("stiffness"):
            # This effect is a factor on the simulation's value; the others are added to it.
            return 1.0 / self.factor
        return self.neutral + value - (self.factor * value - self.amount)


TERMS = (
    Term("steering_ratio", "scale", "steer_gain", factor=0.8, neutral=1.0),
    Term("steering_delay", "delay", "steer_delay", amount=0.1),
    Term("front_tyre_stiffness", "scale", "stiffness_f", factor=1.25, neutral=1.0),
    Term("aero_drag", "cda", "drag_area", factor=0.0),
)
"""A fifth of the steering gain, 0.1 s of the steering's dead time, softer front tyres (the car's
have 0.8 of the simulation's stiffness), and the whole drag."""


@dataclass(frozen=True, kw_only=True)
class TermOutcome(ModelOutcome):
    """What was said after the removal of a term, `term` "" for none; `expected`: its size."""

    term: str
    expected: float


def removed_term_outcomes(
    vehicle: str,
    recording: SensorLog,
    nominal: NominalVehicle,
    sentence: Sentence,
    left_out: list[str],
) -> Iterator[TermOutcome]:
    """
    Yield what is said of a recording with nothing removed, then with each term removed.

    :param sentence: words a result.
    :param left_out: receives the terms that the channels cannot show.
    :raises DataError: the recording is not usable.
    """
    log = middle_of_driving(recording, nominal)
    first, rest = parts(log)
    car, scope = calibrated_model(first, rest, nominal)
    hidden = scope.unobservable
    left_out += [term.effect for term in TERMS if term.effect in hidden]
    yield _outcome(vehicle, log.name, None, car, identify_mismatch(car, rest, nominal), sentence)
    for term in TERMS:
        if term.effect not in hidden:
            found = identify_mismatch(term.out_of(car), rest, nominal)
            yield _outcome(vehicle, log.name, term, car, found, sentence)


def parts(log: SensorLog) -> tuple[SensorLog, SensorLog]:
    """Return the part of a recording to calibrate on, and the rest."""
    begin, end = float(log.odometry_s[0]), float(log.odometry_s[-1])
    at = begin + CALIBRATION_SHARE * (end - begin)
    return between(log, begin, at), between(log, at, end)


def _outcome(
    vehicle: str,
    recording: str,
    term: Term | None,
    car: SurrogateModel,
    found: MismatchResult,
    sentence: Sentence,
) -> TermOutcome:
    effect = "" if term is None else term.effect
    expected = 0.0 if term is None else term.expected(car)
    of_it, false_claims = claims(found, {effect})
    outcome = TermOutcome(
        vehicle=vehicle,
        recording=recording,
        term=effect,
        expected=expected,
        is_named=bool(of_it),
        is_alone=bool(of_it) and not of_it[0].alternatives,
        false_claims=tuple(false_claims),
        verdict=found.verdict,
        sentence=sentence(found),
    )
    size = None if term is None or not of_it else _size(of_it[0], term)
    if term is None or size is None:
        return outcome
    return replace(
        outcome,
        estimate=size.value,
        low=size.low,
        high=size.high,
        error=abs(size.value - expected) / abs(expected - term.neutral),
        is_inside=size.low <= expected <= size.high,
    )


def _size(identified: IdentifiedEffect, term: Term) -> Interval | None:
    """Return the size of a term's effect, identified or fitted in its place."""
    if identified.effect.name == term.effect:
        return identified.parameters[term.parameter]
    for competitor in identified.competitors:
        if competitor.name == term.effect:
            value = competitor.fitted.values()[term.parameter]
            # A competitor has the relative uncertainty of what it competes with.
            below, above = _relative(identified)
            away = value - term.neutral
            low, high = sorted((term.neutral + below * away, term.neutral + above * away))
            return Interval(value, low, high, "")
    return None


def _relative(identified: IdentifiedEffect) -> tuple[float, float]:
    """Return the bounds of an effect's first interval, of the distance from its neutral value."""
    effect = identified.effect
    size = identified.parameters[effect.parameters[0].name]
    neutral = effect.parameters[0].neutral
    away = size.value - neutral
    return ((size.low - neutral) / away, (size.high - neutral) / away) if away else (1.0, 1.0)
