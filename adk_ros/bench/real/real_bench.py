# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run `adk bench real`: what is said of real recordings of which something is known.

Commands answer what they can of each, faults are injected into the readings, terms are removed
from a model of the car, conditions have changed between two recordings, the attitude is withheld,
and what comes next is predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from adk_ros.bags.recording import RecordingOptions
from adk_ros.bench.paper.training_jobs import BenchPlan
from adk_ros.bench.real.answers import Answer, answers
from adk_ros.bench.real.changed_conditions import (
    CONDITIONS_FILE,
    ConditionOutcome,
    condition_outcomes,
    load_pairs,
)
from adk_ros.bench.real.checked_recording import read_checked
from adk_ros.bench.real.fault_cases import Pairing, pairings, recordings_by_vehicle
from adk_ros.bench.real.injected_faults import INJECTIONS
from adk_ros.bench.real.outcome import Outcome
from adk_ros.bench.real.real_predictions import RatioOutcome, prediction_outcomes
from adk_ros.bench.real.removed_terms import TermOutcome, removed_term_outcomes
from adk_ros.bench.real.withheld_attitude import SlopeOutcome, slope_outcomes
from adk_ros.calibration.finding import Verdict
from adk_ros.calibration.from_bag import read_streams
from adk_ros.calibration.reference_check import (
    Prepared,
    ReferenceCheck,
    check_against,
    prepared,
)
from adk_ros.errors import DataError, UsageError
from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle
from adk_ros.mismatch.report.summary import sentence

OTHER_COURSE = "pair, other course"
"""Kind of a comparison with a recording of another course, whose slope, bank and speeds differ."""
PARTS = ("answers", "faults", "terms", "conditions", "slopes", "predictions")
ANSWERS, FAULTS, TERMS, CONDITIONS, SLOPES, PREDICTIONS = PARTS
"""What the benchmark consists of."""
VEHICLE_FILE = "vehicle.yaml"
"""Mass and wheelbase of a vehicle, in the folder of its recordings."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class FaultOutcome(Outcome):
    """
    What was said of one comparison.

    `fault`: the injected one, "" of an untouched recording; `size`: in its unit. `said`: verdict
    of the check on the injected fault.
    """

    kind: str
    fault: str
    size: float
    said: str

    @property
    def is_left_open(self) -> bool:
        """Whether the check says of the fault that it is not decidable."""
        return not self.is_named and self.said == Verdict.NOT_DECIDABLE.value


@dataclass(frozen=True)
class RealBench:
    """
    Outcomes of all comparisons.

    `terms`: of removed terms, `conditions`: of changes between two recordings, `slopes`: of
    withheld attitudes, `predictions`: ratios to the naive predictors, `answers`: what commands say
    of each recording.

    `left_out`: faults that a comparison, and terms that a recording cannot show, by "vehicle,
    comparison". `refused`: a line for each recording or comparison that could not be used.
    """

    outcomes: list[FaultOutcome]
    left_out: dict[str, list[str]]
    refused: list[str]
    terms: list[TermOutcome] = field(default_factory=list)
    conditions: list[ConditionOutcome] = field(default_factory=list)
    slopes: list[SlopeOutcome] = field(default_factory=list)
    predictions: list[RatioOutcome] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)


def bench_real(
    folder: Path,
    sizes: Mapping[str, tuple[float, ...]],
    progress: Progress | None = None,
    selected: Sequence[str] = PARTS,
    plan: BenchPlan | None = None,
) -> RealBench:
    """
    Return the outcomes for all recordings of a folder, in a folder for each vehicle.

    :param sizes: to inject, by the label of the fault.
    :param selected: what to run, of `PARTS`.
    :param plan: training settings and seeds of the predictions; one seed of the default training.
    :raises UsageError: there is no recording.
    """
    bags = recordings_by_vehicle(folder)
    report = progress or (lambda done, total: None)
    out = RealBench([], {}, [])
    if CONDITIONS in selected:
        # What is wrong with a file is said before an hour of other parts.
        for paths in bags.values():
            load_pairs(paths[0].parent)
    if FAULTS in selected:
        out = _with_faults(bags, sizes, report)
    if ANSWERS in selected:
        out = replace(out, answers=_answers(bags, report))
    if TERMS in selected:
        out = _with_terms(out, bags, report)
    if CONDITIONS in selected:
        out = _with_conditions(out, bags, report)
    if SLOPES in selected:
        out = _with_slopes(out, bags)
    if PREDICTIONS in selected:
        refused = list(out.refused)
        predictions = prediction_outcomes(bags, plan or BenchPlan(seeds=1), refused, report)
        out = replace(out, predictions=predictions, refused=refused)
    return out


def _answers(bags: dict[str, list[Path]], report: Progress) -> list[Answer]:
    """Return what the commands say of each recording."""
    found: list[Answer] = []
    count, done = sum(map(len, bags.values())), 0
    for vehicle, paths in bags.items():
        file = paths[0].parent / VEHICLE_FILE
        for path in paths:
            found += answers(vehicle, path, file if file.is_file() else None)
            done += 1
            report(done, count)
    return found


def _with_terms(result: RealBench, bags: dict[str, list[Path]], report: Progress) -> RealBench:
    """Return the result with what is said after terms are removed from a model of the car."""
    terms, left_out, refused = [], dict(result.left_out), list(result.refused)
    count = sum(map(len, bags.values()))
    done = 0
    for vehicle, paths in bags.items():
        file = paths[0].parent / VEHICLE_FILE
        if not file.is_file():
            refused.append(f"{vehicle}: no {VEHICLE_FILE} in its folder: no term is removed")
            done += len(paths)
            continue
        nominal = load_nominal_vehicle(file)
        for path in paths:
            hidden: list[str] = []
            try:
                log = read_checked(path, nominal)
                terms += list(removed_term_outcomes(vehicle, log, nominal, sentence, hidden))
            except (DataError, UsageError) as error:
                refused.append(f"{vehicle}, removed terms: {error}")
            left_out[f"{vehicle}, {path.name}, removed terms"] = hidden
            done += 1
            report(done, count)
    return replace(result, terms=terms, left_out=left_out, refused=refused)


def _with_conditions(
    result: RealBench, bags: dict[str, list[Path]], report: Progress
) -> RealBench:
    """Return the result with what is said of changes between two recordings of a vehicle."""
    conditions, refused = [], list(result.refused)
    for done, (vehicle, paths) in enumerate(bags.items(), start=1):
        folder = paths[0].parent
        file = folder / VEHICLE_FILE
        if file.is_file():
            nominal = load_nominal_vehicle(file)
            conditions += list(condition_outcomes(vehicle, folder, nominal, sentence, refused))
        elif (folder / CONDITIONS_FILE).is_file():
            refused.append(f"{vehicle}: no {VEHICLE_FILE} in its folder: no pair is compared")
        report(done, len(bags))
    return replace(result, conditions=conditions, refused=refused)


def _with_slopes(result: RealBench, bags: dict[str, list[Path]]) -> RealBench:
    """Return the result with the slopes of recordings whose attitude is withheld."""
    slopes, refused = [], list(result.refused)
    for vehicle, paths in bags.items():
        for path in paths:
            try:
                content = read_streams(path, RecordingOptions())
            except (DataError, UsageError) as error:
                refused.append(f"{vehicle}, {path.name}, withheld attitude: {error}")
                continue
            slopes += slope_outcomes(vehicle, path.name, content)
    return replace(result, slopes=slopes, refused=refused)


def _with_faults(
    bags: dict[str, list[Path]], sizes: Mapping[str, tuple[float, ...]], report: Progress
) -> RealBench:
    """Return what is said of recordings with injected faults."""
    refused: list[str] = []
    all_pairings = list(pairings(bags, refused))
    outcomes: list[FaultOutcome] = []
    left_out: dict[str, list[str]] = {}
    for done, given in enumerate(all_pairings, start=1):
        pairing = given
        reference = prepared(pairing.reference)
        untouched = check_against(reference, prepared(pairing.tested))
        if untouched.comparison is None:
            reasons = "; ".join(x.text for x in untouched.of(Verdict.NOT_DECIDABLE))
            refused.append(f"{pairing.vehicle}, {pairing.name}: {reasons}")
            continue
        if given.kind == "pair" and untouched.comparison.is_same_course is False:
            pairing = replace(given, kind=OTHER_COURSE)
        outcomes.append(_scored(pairing, "", 0.0, untouched))
        missing = {fault.label for fault in untouched.comparison.missing}
        left_out[f"{pairing.vehicle}, {pairing.name}"] = [x for x in sizes if x in missing]
        outcomes += _injected(pairing, reference, [x for x in sizes if x not in missing], sizes)
        report(done, len(all_pairings))
    return RealBench(outcomes, left_out, refused)


def _injected(
    pairing: Pairing,
    reference: Prepared,
    labels: Iterable[str],
    sizes: Mapping[str, tuple[float, ...]],
) -> list[FaultOutcome]:
    out = []
    for label in labels:
        for size in sizes[label]:
            is_arm = label.startswith("imu_lever_arm")
            scaled = size * (reference.wheelbase if is_arm else 1.0)
            streams = INJECTIONS[label](pairing.tested.streams, scaled)
            faulty = prepared(replace(pairing.tested, streams=streams))
            out.append(_scored(pairing, label, scaled, check_against(reference, faulty)))
    return out


def _scored(pairing: Pairing, label: str, size: float, checked: ReferenceCheck) -> FaultOutcome:
    changes = [] if checked.comparison is None else list(checked.comparison.changes)
    claims = [change for change in changes if not change.is_of_road]
    named = [
        (fit, change)
        for change in claims
        for fit in (change.fit, *change.candidates)
        if fit.fault.label == label
    ]
    signs = [x.name for x in checked.of(Verdict.FINDING) if x.standard_errors is None]
    false_claims = signs + [
        change.fit.fault.label
        for change in claims
        if label not in {x.fault.label for x in (change.fit, *change.candidates)}
    ]
    said = next((x.verdict.value for x in checked.findings if x.name == label), "")
    outcome = FaultOutcome(
        vehicle=pairing.vehicle,
        recording=pairing.name,
        kind=pairing.kind,
        fault=label,
        size=size,
        is_named=bool(named),
        is_alone=bool(named) and not named[0][1].candidates,
        false_claims=tuple(false_claims),
        said=said,
    )
    if not named:
        return outcome
    fit = named[0][0]
    low, high = fit.size - fit.half_width, fit.size + fit.half_width
    return replace(
        outcome,
        estimate=fit.size,
        low=low,
        high=high,
        error=abs(fit.size - size) / abs(size - fit.fault.nominal),
        is_inside=low <= size <= high,
    )
