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

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import Field, field_validator

from adk_ros.bags.recording import RecordingOptions
from adk_ros.bench.mismatch.ablation import calibrate_surrogate
from adk_ros.bench.real.checked_recording import proposed_sensors
from adk_ros.bench.real.outcome import Outcome
from adk_ros.bench.real.removed_terms import between, middle
from adk_ros.errors import DataError, UsageError
from adk_ros.files.yaml_file import FileModel, load
from adk_ros.mismatch.analysis import identify_mismatch
from adk_ros.mismatch.inference.observability import observable_effects
from adk_ros.mismatch.inference.result import UNKNOWN, MismatchResult
from adk_ros.mismatch.library.catalogue import EFFECTS
from adk_ros.mismatch.library.categories import CALIBRATION, category_of
from adk_ros.mismatch.recording.dead_channels import without_dead_channels
from adk_ros.mismatch.recording.from_bag import read_sensor_log
from adk_ros.mismatch.recording.nominal_vehicle import NominalVehicle
from adk_ros.mismatch.recording.sensor_log import SensorLog
from adk_ros.mismatch.validation import open_loop_error
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
class ConditionOutcome(Outcome):
    """
    What was said of a pair; `recording`: "after, against before".

    `change` and `effects`: of the pair. `false_claims`: other physics, and "formula". `sentence`:
    the result in words.
    """

    change: str
    effects: tuple[str, ...]
    verdict: str
    sentence: str

    @property
    def is_left_open(self) -> bool:
        """Whether the result says that something unknown is missing."""
        return self.verdict == UNKNOWN


Sentence = Callable[[MismatchResult], str]


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
    calibrated = calibrate_surrogate(before, nominal, infer_torque=True)
    car = calibrated.stand_in
    has_imu = after.imu_s.size > 0
    scope = observable_effects(after, nominal.mass, nominal.wheel_radius, has_imu)
    given = "v_x" in scope.not_predicted()
    car = replace(car, open_loop_error=open_loop_error(car, calibrated.drive, given))
    return identify_mismatch(car, after, nominal)


def _prepared(path: Path, nominal: NominalVehicle, sensors: SensorConfig) -> SensorLog:
    """Return the middle of a recording."""
    log = read_sensor_log(path, RecordingOptions(sensors=sensors), needs_imu=False)
    log, _ = without_dead_channels(replace(log, length_scale=nominal.length_scale))
    return between(*middle(log))


def outcome_of(
    vehicle: str, pair: ConditionPair, found: MismatchResult, sentence: Sentence
) -> ConditionOutcome:
    """Return the outcome of a pair, given the result."""
    right = set(pair.effects)
    of_it = [x for x in found.effects if right & {x.effect.name, *x.alternatives}]
    others = [x.effect.name for x in found.effects if x not in of_it]
    false_claims = [name for name in others if category_of(name) != CALIBRATION]
    if found.unexplained is not None and found.unexplained.expression:
        false_claims.append("formula")
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
