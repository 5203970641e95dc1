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
from adk_ros.fleet.inference.fleet_evidence import FleetEvidence, RecordingTags
from adk_ros.fleet.inference.fleet_result import FleetResult, fleet_result
from adk_ros.fleet.inference.fleet_simulation import FleetSimulation
from adk_ros.fleet.inference.linearisation_point import Point, has_moved, rounded_size
from adk_ros.fleet.inference.nonlinear_candidates import NonlinearCandidates
from adk_ros.fleet.inference.place_evidence import Cell
from adk_ros.fleet.inference.places import Place
from adk_ros.fleet.inference.representative_recordings import representative_recordings

MAX_PASSES, USUAL_PASSES = 6, 3
"""
Linearisations: without effects, at a preliminary estimate, and until none moves. One more where
the early ones are of representative recordings.
"""
_EARLY_PASSES = 2
"""Passes after the first that are not near the estimate yet."""
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
    one, and is not linearised again. The early passes of a large fleet are of representative
    recordings; the others are linearised at the estimate of these.

    :raises DataError: no recording has evidence.
    """
    linearised = _LinearisedFleet(evidence_at)
    linearised.update(None, None)
    tags = tags_of(linearised.every_row())
    ratios = linearised.loss_ratios()
    active = representative_recordings({n: tags.get(n, RecordingTags(n)) for n in ratios})
    passes = MAX_PASSES if len(active) == len(ratios) else MAX_PASSES + 1
    estimate: FleetEstimate | None = None
    places: tuple[Place, ...] = ()
    moved: set[str] = set()
    late: set[str] = set()
    dropped: Counter[Identity] = Counter()
    comparisons, nonlinear = EffectComparisons(), NonlinearCandidates()
    for turn in range(passes):
        if estimate is not None:
            cells = _moved_cells(places, estimate.places)
            passing = linearised.passing(cells, active - late)
            passing |= linearised.passing(cells | _cells_of(estimate.places), late)
            if cells:
                places = _linearised_at(places, estimate.places)
            # All recordings are linearised at the same places.
            farthest = _FIRST_STEP if turn == 1 else np.inf
            estimate = replace(estimate, places=places, farthest=farthest)
            due = moved | passing
            # Claims that are exchanged move most recordings: those that decide come first.
            first = due & comparisons.sampled(estimate, linearised.usable(active))
            linearised.update(estimate, first, passing)
            at_estimate = linearised.usable(active - (due - first))
            estimate = comparisons.exchanged(
                estimate, at_estimate, evidence_at, is_near=turn >= _EARLY_PASSES
            )
            due = (due - first) | linearised.moved_to(estimate, active)
            linearised.update(estimate, due, passing)
            late = set()
        claimed = frozenset() if estimate is None else estimate.identities
        estimate = estimate_fleet(
            [simulation.evidence.to_row(), *linearised.every_row(active)],
            tags,
            progress,
            ROUNDS if turn >= _EARLY_PASSES else _EARLY_ROUNDS,
            places,
            is_at_estimate=turn >= _EARLY_PASSES,
            refused=frozenset(one for one, times in dropped.items() if times >= _MOST_DROPS),
            beside=comparisons.beside,
        )
        if turn > _EARLY_PASSES:
            dropped.update(claimed - estimate.identities)
        if turn == _EARLY_PASSES and len(active) < len(ratios):
            late = set(ratios) - active
            active = frozenset(ratios)
            rows = [simulation.evidence.to_row(), *linearised.every_row()]
            estimate = estimate.of_fleet(FleetEvidence.of(rows, tags))
        further = estimate
        if turn + 1 < passes and not late:
            further = nonlinear.added(estimate, linearised.usable(active), evidence_at)
        moved = linearised.moved_to(further, active)
        is_settled = not late and not _moved_cells(places, estimate.places)
        if turn >= _EARLY_PASSES and is_settled and not moved:
            # Recordings are there already, and the selection has not claimed it.
            break
        estimate = further
    assert estimate is not None
    outdated = linearised.outdated
    result = fleet_result(estimate, ratios, progress, outdated)
    return FleetAnalysis(estimate, result, linearised.failed, outdated)


class _LinearisedFleet:
    """
    The rows of each recording, and where they are linearised.

    `failed`: recordings without evidence -> reason; `outdated`: those with evidence of an earlier
    pass only.
    """

    def __init__(self, evidence_at: EvidenceAt) -> None:
        self._evidence_at = evidence_at
        self._rows: dict[str, list[Row]] = {}
        self._points: dict[str, Point] = {}
        self.failed: dict[str, str] = {}
        self.outdated: dict[str, str] = {}

    def update(
        self,
        at: FleetEstimate | None,
        names: Collection[str] | None,
        passing: Collection[str] = frozenset(),
    ) -> None:
        """Linearise recordings, None for all; `passing`: that pass a place which has moved."""
        if names is not None and not names:
            return
        found, without = self._evidence_at(at, names)
        by_name: dict[str, list[Row]] = {}
        for row in found:
            by_name.setdefault(str(row["recording"]), []).append(row)
        self._rows.update(by_name)
        for name in by_name:
            self._points[name] = {} if at is None else _in_thresholds(at, at.point_of(name))
            self.outdated.pop(name, None)
        for name, why in without.items():
            (self.outdated if name in self._rows else self.failed)[name] = why
            if name in self._rows and name in passing:
                # Others are linearised again at a place of which its rows do not know.
                self._rows[name] = [r for r in self._rows[name] if r["kind"] == RECORDING]

    def every_row(self, names: Collection[str] | None = None) -> list[Row]:
        """Return the rows of recordings, of all by default."""
        chosen = sorted(self._rows if names is None else names)
        return [row for name in chosen for row in self._rows[name]]

    def loss_ratios(self) -> dict[str, float]:
        """Return the loss of each recording over that of a perfect model."""
        return {
            name: float(row["loss_ratio"])
            for name, rows in self._rows.items()
            for row in rows
            if row["kind"] == RECORDING
        }

    def usable(self, names: Collection[str]) -> dict[str, list[Row]]:
        """Return the rows of those recordings that did not fail when they were due."""
        return {n: self._rows[n] for n in self._rows if n in names and n not in self.outdated}

    def moved_to(self, at: FleetEstimate, names: Collection[str]) -> set[str]:
        """Return the recordings whose effects at an estimate are others than those of the rows."""
        return {
            name
            for name in self.usable(names)
            if has_moved(self._points[name], _in_thresholds(at, at.values_of(name)))
        }

    def passing(self, cells: Collection[Cell], names: Collection[str]) -> set[str]:
        """Return the recordings that pass any of these cells."""
        return {n for n, rows in self.usable(names).items() if cells and _passes(rows, cells)}


def _cells_of(places: Sequence[Place]) -> set[Cell]:
    return {cell for place in places for cell in place.cells}


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
