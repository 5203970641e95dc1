# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Pairs of real recordings of one vehicle between which something is known to have changed.

Tyres, a load or the surface: a surrogate model is calibrated on the recording before the change
and is the simulation of the one after it. What has changed must be named; of a pair without a
change, nothing may be. `conditions.yaml` in the folder of a vehicle lists the pairs.

Both are read with the parameters that `adk check` proposes for the reference: those of the other
one might hide what has changed. Calibrations of the sensors are not counted: the surrogate model
contains no errors of sensors, so that those of both recordings appear as differences.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, field_validator

from adk_ros.bags.recording import RecordingOptions
from adk_ros.bench.real.calibrated_model import (
    ModelOutcome,
    Sentence,
    calibrated_model,
    claims,
    middle_of_driving,
)
from adk_ros.bench.real.checked_recording import proposed_sensors
from adk_ros.errors import DataError, UsageError
from adk_ros.files.yaml_file import FileModel, load
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.result import MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.categories import CALIBRATION, category_of
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.signals.decode import SensorConfig

CONDITIONS_FILE = "conditions.yaml"
"""Pairs of a vehicle's recordings, in their folder."""


class ConditionPair(FileModel):
    """
    Two recordings, and what has changed from the first to the second.

    `change`: what was done, in words; `effects`: names of the catalogue, any of which is right;
    none if nothing has changed.
    """

    reference: str
    recording: str
    change: str
    effects: list[str] = Field(default_factory=list)

    @field_validator("effects")
    @classmethod
    def _known(cls, names: list[str]) -> list[str]:
        for name in names:
            if name not in EFFECTS:
                raise ValueError(f"no effect is called {name!r}")
        return names


class ConditionPairs(FileModel):
    """Content of `conditions.yaml`."""

    pairs: list[ConditionPair]


@dataclass(frozen=True, kw_only=True)
class ConditionOutcome(ModelOutcome):
    """
    What was said of a pair; `recording`: "after, against before".

    `change` and `effects`: of the pair. `false_claims` are of physics only.
    """

    change: str
    effects: tuple[str, ...]


def load_pairs(folder: Path) -> list[ConditionPair]:
    """
    Return the pairs of a vehicle's folder, none without `conditions.yaml`.

    :raises UsageError: the file is wrong, or a recording that it names is missing.
    """
    file = folder / CONDITIONS_FILE
    if not file.is_file():
        return []
    pairs = load(file, "conditions", ConditionPairs).pairs
    for pair in pairs:
        for name in (pair.reference, pair.recording):
            if not (folder / name).is_dir():
                raise UsageError(f"{file}: there is no recording {name} in this folder")
    return pairs


def condition_outcomes(
    vehicle: str, folder: Path, nominal: NominalVehicle, sentence: Sentence, refused: list[str]
) -> Iterator[ConditionOutcome]:
    """
    Yield what is said of each pair of a vehicle's folder.

    :param sentence: words a result.
    :param refused: receives a line for each pair of which a recording is not usable.
    """
    for pair in load_pairs(folder):
        try:
            sensors = proposed_sensors(folder / pair.reference, nominal)
            before, after = (
                _prepared(folder / name, nominal, sensors)
                for name in (pair.reference, pair.recording)
            )
            found = compare(before, after, nominal)
        except (DataError, UsageError) as error:
            refused.append(f"{vehicle}, changed condition: {error}")
            continue
        yield outcome_of(vehicle, pair, found, sentence)


def compare(before: SensorLog, after: SensorLog, nominal: NominalVehicle) -> MismatchResult:
    """
    Return what a surrogate that is calibrated on one recording lacks for another one.

    :raises DataError: a recording is not usable.
    """
    car, _ = calibrated_model(before, after, nominal)
    return identify_mismatch(car, after, nominal)


def _prepared(path: Path, nominal: NominalVehicle, sensors: SensorConfig) -> SensorLog:
    """Return the middle of a recording."""
    log = read_sensor_log(path, RecordingOptions(sensors=sensors), needs_imu=False)
    return middle_of_driving(log, nominal)


def outcome_of(
    vehicle: str, pair: ConditionPair, found: MismatchResult, sentence: Sentence
) -> ConditionOutcome:
    """Return the outcome of a pair, given the result."""
    of_it, others = claims(found, pair.effects)
    false_claims = [x for x in others if x not in EFFECTS or category_of(x) != CALIBRATION]
    return ConditionOutcome(
        vehicle=vehicle,
        recording=f"{pair.recording}, against {pair.reference}",
        change=pair.change,
        effects=tuple(pair.effects),
        is_named=bool(of_it),
        is_alone=bool(of_it) and not of_it[0].alternatives,
        false_claims=tuple(false_claims),
        verdict=found.verdict,
        sentence=sentence(found),
    )
