# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Remove a known term from a surrogate model of a real car, and ask `adk mismatch` what is missing.

Nobody knows what a simulation of a real car lacks. So a surrogate model is calibrated on the first
part of a recording, one term is taken out of it, and it is the simulation of the rest: the term
must be named with its size. With nothing removed, nothing may be named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.bench.mismatch.ablation import calibrate_surrogate
from adk_ros.bench.real.outcome import Outcome
from adk_ros.errors import DataError
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.observability import longest_moving_segment, observable_effects
from adk_ros.mismatch.inference.result import (
    UNKNOWN,
    IdentifiedEffect,
    Interval,
    MismatchResult,
)
from adk_ros.mismatch.library.surrogate_parameters import INDEX
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.validation import open_loop_error

CALIBRATION_SHARE = 0.6
"""Share of a recording on which the surrogate model is calibrated, as in `adk bench paper`."""
MAX_SECONDS = 240.0
"""s of a recording that are used, in the middle of the driving: longer ones cost time only."""


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
class TermOutcome(Outcome):
    """
    What was said after the removal of a term, `term` "" for none.

    `expected`: size of the effect. `false_claims`: other effects, and "formula". `sentence`: the
    result in words.
    """

    term: str
    expected: float
    verdict: str
    sentence: str

    @property
    def is_left_open(self) -> bool:
        """Whether the result says that something unknown is missing."""
        return self.verdict == UNKNOWN


Sentence = Callable[[MismatchResult], str]


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
    log, _ = without_dead_channels(replace(recording, length_scale=nominal.length_scale))
    first, rest = parts(log)
    calibrated = calibrate_surrogate(first, nominal, infer_torque=True)
    car = calibrated.stand_in
    has_imu = log.imu_s.size > 0
    scope = observable_effects(rest, nominal.mass, nominal.wheel_radius, has_imu)
    given = "v_x" in scope.not_predicted()
    car = replace(car, open_loop_error=open_loop_error(car, calibrated.drive, given))
    hidden = scope.unobservable
    left_out += [term.effect for term in TERMS if term.effect in hidden]
    yield _outcome(vehicle, log.name, None, car, identify_mismatch(car, rest, nominal), sentence)
    for term in TERMS:
        if term.effect not in hidden:
            found = identify_mismatch(term.out_of(car), rest, nominal)
            yield _outcome(vehicle, log.name, term, car, found, sentence)


def parts(log: SensorLog) -> tuple[SensorLog, SensorLog]:
    """
    Return the part of a recording to calibrate on, and the rest, at most `MAX_SECONDS` in all.

    :raises DataError: the car hardly moves.
    """
    moving, begin, end = middle(log)
    at = begin + CALIBRATION_SHARE * (end - begin)
    return between(moving, begin, at), between(moving, at, end)


def middle(log: SensorLog) -> tuple[SensorLog, float, float]:
    """
    Return the driving of a recording, and begin and end of its middle `MAX_SECONDS`, s.

    :raises DataError: the car stands still.
    """
    moving = longest_moving_segment(log) if not log.imu_s.size else log
    if not np.any(np.abs(moving.odometry[:, 0]) > 0.0):
        raise DataError(f"{log.name}: the car stands still")
    begin, end = float(moving.odometry_s[0]), float(moving.odometry_s[-1])
    spare = max(0.5 * (end - begin - MAX_SECONDS), 0.0)
    return moving, begin + spare, end - spare


def between(log: SensorLog, begin_s: float, end_s: float) -> SensorLog:
    """Return an interval of a recording, whose time begins with it: a share of it is held out."""
    part = log.between(begin_s, end_s)
    return replace(
        part,
        duration_s=end_s - begin_s,
        imu_s=part.imu_s - begin_s,
        odometry_s=part.odometry_s - begin_s,
        command_s=part.command_s - begin_s,
        start_ns=part.start_ns + round(1e9 * begin_s),
    )


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
    of_it = [x for x in found.effects if effect in {x.effect.name, *x.alternatives}]
    false_claims = [x.effect.name for x in found.effects if x not in of_it]
    if found.unexplained is not None and found.unexplained.expression:
        false_claims.append("formula")
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
