# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The analysis of a fleet in passes: evidence of each recording, estimate, and again at the estimate.

Where the evidence comes from is a function: of recordings in memory, or of a dataset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from adk_ros.fleet.inference.evidence import Row
from adk_ros.fleet.inference.fleet_estimate import ROUNDS, FleetEstimate, estimate_fleet
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.fleet_result import FleetResult, fleet_result
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation

PASSES = 3
"""Linearisations: without effects, at a preliminary estimate, and at one near the truth."""
_EARLY_ROUNDS = 2
"""Rounds of effects and places where a further pass follows."""

EvidenceAt = Callable[[FleetEstimate | None], tuple[list[Row], Mapping[str, str]]]
"""
Estimate to linearise at, None for no effects -> rows of the recordings, and name -> why one has
none. With an estimate it returns only recordings that the estimate has.
"""
TagsOf = Callable[[Sequence[Row]], Mapping[str, RecordingTags]]
"""Rows of the recordings -> the tags of each by name."""
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class FleetAnalysis:
    """Estimate and result of a fleet, and the recordings without evidence, with the reason."""

    estimate: FleetEstimate
    result: FleetResult
    failed: Mapping[str, str]


def analyse_fleet(
    evidence_at: EvidenceAt,
    simulation: FleetSimulation,
    tags_of: TagsOf,
    progress: Progress | None = None,
) -> FleetAnalysis:
    """
    Analyse a fleet; recordings without evidence are left out, with the reason.

    :raises DataError: no recording has evidence.
    """
    estimate: FleetEstimate | None = None
    before: Mapping[str, float] = {}
    failed: dict[str, str] = {}
    for turn in range(PASSES):
        rows, without = evidence_at(estimate)
        failed |= without
        estimate = estimate_fleet(
            [simulation.evidence.to_row(), *rows],
            tags_of(rows),
            progress,
            ROUNDS if turn + 1 == PASSES else _EARLY_ROUNDS,
            () if estimate is None else estimate.places,
        )
        before = before or estimate.loss_ratios
    assert estimate is not None
    return FleetAnalysis(estimate, fleet_result(estimate, before, progress), failed)
