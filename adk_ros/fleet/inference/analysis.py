# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The analysis of a fleet in passes: evidence of each recording, estimate, and again at the estimate.

After the first pass only those recordings are linearised again whose effects have moved, or that
pass near a place that has: elsewhere an effect at a place changes nothing. Claims are compared
with similar effects, each linearised at itself, before the estimate.

Where the evidence comes from is a function: of recordings in memory, or of a dataset.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from adk_ros.fleet.inference.effect_comparisons import EffectComparisons
from adk_ros.fleet.inference.evidence import PLACE_ROW, RECORDING, Row
from adk_ros.fleet.inference.fleet_candidates import Identity
from adk_ros.fleet.inference.fleet_estimate import (
    ROUNDS,
    EvidenceAt,
    FleetEstimate,
    estimate_fleet,
)
from adk_ros.fleet.inference.fleet_evidence import RecordingTags
from adk_ros.fleet.inference.fleet_result import FleetResult, fleet_result
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.linearisation_point import Point, has_moved, rounded_size
from adk_ros.fleet.inference.nonlinear_candidates import NonlinearCandidates
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.places import Place

MAX_PASSES, USUAL_PASSES = 6, 3
"""Linearisations: without effects, at a preliminary estimate, and until none moves."""
_EARLY_PASSES = 2
"""Passes that are not near the estimate yet."""
_FIRST_STEP = 10.0
"""
Largest effect, in materiality thresholds, of the first step: it comes from derivatives without any
effect, which mistake two delays for a yaw inertia that is 60 % larger. By choice.
"""
_EARLY_ROUNDS = 2
"""Rounds of effects and places where a further pass follows."""
_MOST_DROPS = 2
"""Times that one linearisation claims what the next does not, until it is not claimed any more."""
TagsOf = Callable[[Sequence[Row]], Mapping[str, RecordingTags]]
"""Rows of the recordings -> the tags of each by name."""
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class FleetAnalysis:
    """
    Estimate and result of a fleet.

    `failed`: recordings without evidence -> reason. `outdated`: recordings that take part with
    the evidence of an earlier pass, since they failed in a later one -> reason.
    """

    estimate: FleetEstimate
    result: FleetResult
    failed: Mapping[str, str]
    outdated: Mapping[str, str] = field(default_factory=dict)


def analyse_fleet(
    evidence_at: EvidenceAt,
    simulation: FleetSimulation,
    tags_of: TagsOf,
    progress: Progress | None = None,
) -> FleetAnalysis:
    """
    Analyse a fleet; recordings without evidence are left out, with the reason.

    One that fails in a later pass, at its time limit for example, keeps its evidence of an earlier
    one, and is not linearised again.

    :raises DataError: no recording has evidence.
    """
    estimate: FleetEstimate | None = None
    before: Mapping[str, float] = {}
    failed: dict[str, str] = {}
    outdated: dict[str, str] = {}
    rows: dict[str, list[Row]] = {}
    points: dict[str, Point] = {}
    places: tuple[Place, ...] = ()
    moved: Collection[str] | None = None
    dropped: Counter[Identity] = Counter()
    comparisons, nonlinear = EffectComparisons(), NonlinearCandidates()

    def linearise(
        at: FleetEstimate | None,
        names: Collection[str] | None,
        passing: Collection[str] = frozenset(),
    ) -> None:
        if names is not None and not names:
            return
        found, without = evidence_at(at, names)
        by_name: dict[str, list[Row]] = {}
        for row in found:
            by_name.setdefault(str(row["recording"]), []).append(row)
        rows.update(by_name)
        for name in by_name:
            points[name] = {} if at is None else _in_thresholds(at, at.point_of(name))
            outdated.pop(name, None)
        for name, why in without.items():
            (outdated if name in rows else failed)[name] = why
            if name in rows and name in passing:
                # Others are linearised again at a place of which its rows do not know.
                rows[name] = [row for row in rows[name] if row["kind"] == RECORDING]

    def moved_to(at: FleetEstimate) -> list[str]:
        up_to_date = (name for name in rows if name not in outdated)
        return [
            name
            for name in up_to_date
            if has_moved(points[name], _in_thresholds(at, at.values_of(name)))
        ]

    for turn in range(MAX_PASSES):
        passing: set[str] = set()
        if estimate is not None:
            if cells := _moved_cells(places, estimate.places):
                passing = {name for name in rows if _passes(rows[name], cells)} - set(outdated)
                places = _linearised_at(places, estimate.places)
                moved = {*(moved or ()), *passing}
            # All recordings are linearised at the same places.
            farthest = _FIRST_STEP if turn == 1 else np.inf
            estimate = replace(estimate, places=places, farthest=farthest)
        linearise(estimate, moved, passing)
        if estimate is not None:
            at_estimate = {name: rows[name] for name in rows if name not in outdated}
            estimate = comparisons.exchanged(
                estimate, at_estimate, evidence_at, is_near=turn >= _EARLY_PASSES
            )
            linearise(estimate, moved_to(estimate))
        every = [row for name in sorted(rows) for row in rows[name]]
        claimed = frozenset() if estimate is None else estimate.identities
        estimate = estimate_fleet(
            [simulation.evidence.to_row(), *every],
            tags_of(every),
            progress,
            ROUNDS if turn >= _EARLY_PASSES else _EARLY_ROUNDS,
            places,
            is_at_estimate=turn >= _EARLY_PASSES,
            refused=frozenset(one for one, times in dropped.items() if times >= _MOST_DROPS),
            beside=comparisons.beside,
        )
        if turn > _EARLY_PASSES:
            dropped.update(claimed - estimate.identities)
        before = before or estimate.loss_ratios
        further = estimate
        if turn + 1 < MAX_PASSES:
            at_estimate = {name: rows[name] for name in rows if name not in outdated}
            further = nonlinear.added(estimate, at_estimate, evidence_at)
        moved = moved_to(further)
        is_settled = not _moved_cells(places, estimate.places)
        if turn >= _EARLY_PASSES and is_settled and not moved:
            # Recordings are there already, and the selection has not claimed it.
            break
        estimate = further
    assert estimate is not None
    result = fleet_result(estimate, before, progress, outdated)
    return FleetAnalysis(estimate, result, failed, outdated)


def _in_thresholds(estimate: FleetEstimate, values: Mapping[str, float]) -> Point:
    columns = estimate.fleet.columns
    return {key: value / columns.column(key).materiality for key, value in values.items()}


def _linearised_at(before: Sequence[Place], after: Sequence[Place]) -> tuple[Place, ...]:
    """
    Return the places `after`, with the sizes at which recordings are linearised, rounded.

    A place that has not moved keeps its size: recordings that pass it are not linearised again.
    """
    known = {(p.key, p.cells): p.size for p in before}
    out = []
    for place in after:
        size = known.get((place.key, place.cells), 0.0)
        if has_moved({"": size}, {"": place.size}):
            size = rounded_size(place.size)
        out.append(replace(place, size=size))
    return tuple(out)


def _moved_cells(before: Sequence[Place], after: Sequence[Place]) -> set[Cell]:
    """Return the cells in which the effects at places have moved."""
    sizes, sizes_after = ({(p.key, p.cells): p.size for p in places} for places in (before, after))
    return {
        cell
        for one in {*sizes, *sizes_after}
        if has_moved({"": sizes.get(one, 0.0)}, {"": sizes_after.get(one, 0.0)})
        for cell in one[1]
    }


def _passes(rows: Sequence[Row], cells: Collection[Cell]) -> bool:
    """
    Whether a recording passes any of these cells, or one beside it.

    One that only cuts a corner of a cell has no row of it, but one of a neighbour.
    """
    near = {(c.x + i, c.y + j) for c in cells for i in (-1, 0, 1) for j in (-1, 0, 1)}
    driven = (Cell.of_text(str(row["cell"])) for row in rows if row["kind"] == PLACE_ROW)
    return any((cell.x, cell.y) in near for cell in driven)
