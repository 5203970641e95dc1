# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The analysis of a fleet in passes: evidence of each recording, estimate, and again at the estimate.

The work per recording is one function of plain arguments, which any `map` may distribute.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from adk_ros.errors import AdkError
from adk_ros.fleet.inference.evidence import RECORDING, Row
from adk_ros.fleet.inference.fleet_estimate import ROUNDS, FleetEstimate, estimate_fleet
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.fleet_result import FleetResult, fleet_result
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.recording_evidence import PlacedValue, evidence_rows
from adk_ros.mismatch.recording.sensor_log import SensorLog

PASSES = 3
"""Linearisations: without effects, at a preliminary estimate, and at one near the truth."""
_EARLY_ROUNDS = 2
"""Rounds of effects and places where a further pass follows."""

Load = Callable[[str], SensorLog]
"""Reads the recording with a name."""
Job = tuple[str, Mapping[str, float]]
"""Name of a recording, and the effects in it at which to linearise."""
Answer = tuple[str, list[Row], str]
"""Name of a recording, its rows, and why it has none."""
Map = Callable[[Callable[[Job], Answer], Iterable[Job]], Iterable[Answer]]


@dataclass(frozen=True)
class FleetAnalysis:
    """Estimate and result of a fleet, the rows of the last pass, and recordings without, why."""

    estimate: FleetEstimate
    result: FleetResult
    rows: tuple[Row, ...]
    failed: Mapping[str, str]


def analyse_fleet(
    names: Sequence[str],
    load: Load,
    simulation: FleetSimulation,
    tags: Mapping[str, RecordingTags],
    passes: int = PASSES,
    distribute: Map = map,
) -> FleetAnalysis:
    """
    Analyse the recordings `names` of a fleet; `distribute` maps the work per recording.

    A recording that cannot be read or analysed is left out, with the reason.
    :raises DataError: no recording can be analysed.
    """
    estimate: FleetEstimate | None = None
    before: dict[str, float] = {}
    failed: dict[str, str] = {}
    rows: list[Row] = []
    for turn in range(passes):
        local = [] if estimate is None else estimate.local_values()
        usable = names if estimate is None else estimate.fleet.names
        jobs = [(name, {} if estimate is None else estimate.values_of(name)) for name in usable]
        rows = [simulation.evidence.to_row()]
        for name, found, why in distribute(partial(recorded, load, simulation, local), jobs):
            rows += found
            if why:
                failed[name] = why
        if turn == 0:
            before = {
                row["recording"]: row["loss_ratio"] for row in rows if row["kind"] == RECORDING
            }
        last = turn + 1 == passes
        estimate = estimate_fleet(
            rows,
            tags,
            rounds=ROUNDS if last else _EARLY_ROUNDS,
            known_places=() if estimate is None else estimate.places,
        )
    assert estimate is not None
    return FleetAnalysis(estimate, fleet_result(estimate, before), tuple(rows), failed)


def recorded(
    load: Load, simulation: FleetSimulation, local: Sequence[PlacedValue], job: Job
) -> Answer:
    """Return the evidence of one recording, or why it has none."""
    name, values = job
    try:
        return name, evidence_rows(load(name), simulation, values, local, name=name), ""
    except AdkError as error:
        return name, [], str(error)
