# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Run `adk bench real`: inject faults into real recordings, and score what is said of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from adk_ros.bench.real.fault_cases import Pairing, pairings, recordings_by_vehicle
from adk_ros.bench.real.injected_faults import INJECTIONS
from adk_ros.calibration.finding import Verdict
from adk_ros.calibration.reference_check import (
    Prepared,
    ReferenceCheck,
    check_against,
    prepared,
)

OTHER_COURSE = "pair, other course"
"""Kind of a comparison with a recording of another course, whose slope, bank and speeds differ."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Outcome:
    """
    What was said of one comparison.

    `fault`: the injected one, "" of an untouched recording; `size`: in its unit. `is_named`: it is
    the change or one of its candidates; `is_alone`: the only one. `estimate`, `low`, `high`: its
    size with the 90 % interval, None unless named; `error`: relative to the injected size.
    `is_inside`: the injected size is inside the interval. `false_claims`: changes that do not
    have it among their candidates. `said`: verdict of the check on the injected fault.
    """

    vehicle: str
    recording: str
    kind: str
    fault: str
    size: float
    is_named: bool
    is_alone: bool
    estimate: float | None
    low: float | None
    high: float | None
    error: float | None
    is_inside: bool
    false_claims: tuple[str, ...]
    said: str

    def as_dict(self) -> dict[str, object]:
        """Return the outcome for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class RealBench:
    """
    Outcomes of all comparisons.

    `left_out`: faults that a comparison cannot show, by "vehicle, comparison". `refused`: a line
    for each recording or comparison that could not be used.
    """

    outcomes: list[Outcome]
    left_out: dict[str, list[str]]
    refused: list[str]


def bench_real(
    folder: Path, sizes: Mapping[str, tuple[float, ...]], progress: Progress | None = None
) -> RealBench:
    """
    Return the outcomes for all recordings of a folder, in a folder for each vehicle.

    :param sizes: to inject, by the label of the fault.
    :raises UsageError: there is no recording.
    """
    refused: list[str] = []
    all_pairings = list(pairings(recordings_by_vehicle(folder), refused))
    outcomes: list[Outcome] = []
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
        if progress is not None:
            progress(done, len(all_pairings))
    return RealBench(outcomes, left_out, refused)


def _injected(
    pairing: Pairing,
    reference: Prepared,
    labels: Iterable[str],
    sizes: Mapping[str, tuple[float, ...]],
) -> list[Outcome]:
    out = []
    for label in labels:
        for size in sizes[label]:
            is_arm = label.startswith("imu_lever_arm")
            scaled = size * (reference.wheelbase if is_arm else 1.0)
            streams = INJECTIONS[label](pairing.tested.streams, scaled)
            faulty = prepared(replace(pairing.tested, streams=streams))
            out.append(_scored(pairing, label, scaled, check_against(reference, faulty)))
    return out


def _scored(pairing: Pairing, label: str, size: float, checked: ReferenceCheck) -> Outcome:
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
    if not named:
        return Outcome(
            pairing.vehicle, pairing.name, pairing.kind, label, size, False, False,
            None, None, None, None, False, tuple(false_claims), said,
        )  # fmt: skip
    fit, change = named[0]
    low, high = fit.size - fit.half_width, fit.size + fit.half_width
    error = abs(fit.size - size) / abs(size - fit.fault.nominal)
    return Outcome(
        pairing.vehicle, pairing.name, pairing.kind, label, size, True, not change.candidates,
        fit.size, low, high, error, low <= size <= high, tuple(false_claims), said,
    )  # fmt: skip
