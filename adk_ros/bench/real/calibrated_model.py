# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A surrogate model of a real car, calibrated on one recording, as the simulation of another."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from adk_ros.bench.mismatch.ablation import calibrate_surrogate
from adk_ros.bench.real.outcome import Outcome
from adk_ros.errors import DataError
from adk_ros.mismatch.inference.observability import (
    ObservableEffects,
    longest_moving_segment,
    observable_effects,
)
from adk_ros.mismatch.inference.result import UNKNOWN, IdentifiedEffect, MismatchResult
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.joined import shifted
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.surrogate.identification import SurrogateModel
from adk_ros.mismatch.validation import open_loop_error

MAX_SECONDS = 240.0
"""s of a recording that are used, in the middle of the driving: longer ones cost time only."""

Sentence = Callable[[MismatchResult], str]
"""Words a result."""


@dataclass(frozen=True, kw_only=True)
class ModelOutcome(Outcome):
    """
    What was said of a recording against a calibrated model.

    `false_claims`: other effects, and "formula". `sentence`: the result in words.
    """

    verdict: str
    sentence: str

    @property
    def is_left_open(self) -> bool:
        """Whether the result says that something unknown is missing."""
        return self.verdict == UNKNOWN


def calibrated_model(
    before: SensorLog, after: SensorLog, nominal: NominalVehicle
) -> tuple[SurrogateModel, ObservableEffects]:
    """
    Return a model that is calibrated on one recording, and what another one can show.

    :raises DataError: the first recording is not usable.
    """
    calibrated = calibrate_surrogate(before, nominal, infer_torque=True)
    car = calibrated.surrogate
    scope = observable_effects(after, nominal.mass, nominal.wheel_radius, after.imu_s.size > 0)
    given = "v_x" in scope.not_predicted()
    return replace(car, open_loop_error=open_loop_error(car, calibrated.drive, given)), scope


def claims(
    found: MismatchResult, right: Collection[str]
) -> tuple[list[IdentifiedEffect], list[str]]:
    """Return the effects with one of the `right` names, also in a tie, and the other claims."""
    named = [x for x in found.effects if not {x.effect.name, *x.alternatives}.isdisjoint(right)]
    others = [x.effect.name for x in found.effects if x not in named]
    if found.unexplained is not None and found.unexplained.expression:
        others.append("formula")
    return named, others


def middle_of_driving(log: SensorLog, nominal: NominalVehicle) -> SensorLog:
    """
    Return the middle `MAX_SECONDS` of the driving of a recording, without dead channels.

    :raises DataError: the car stands still.
    """
    log, _ = without_dead_channels(replace(log, length_scale=nominal.length_scale))
    moving = longest_moving_segment(log) if not log.imu_s.size else log
    if not np.any(np.abs(moving.odometry[:, 0]) > 0.0):
        raise DataError(f"{log.name}: the car stands still")
    begin, end = float(moving.odometry_s[0]), float(moving.odometry_s[-1])
    spare = max(0.5 * (end - begin - MAX_SECONDS), 0.0)
    return between(moving, begin + spare, end - spare)


def between(log: SensorLog, begin_s: float, end_s: float) -> SensorLog:
    """Return an interval of a recording, whose time begins with it: a share of it is held out."""
    part = shifted(log.between(begin_s, end_s), -begin_s)
    return replace(part, duration_s=end_s - begin_s)
